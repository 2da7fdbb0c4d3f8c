"""How clips and methods are named for `evaluate`, and what is said of those that it cannot take."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.cli.evaluate import methods_of
from cltransfer.clips.clip import write_video
from cltransfer.config import load_config
from cltransfer.errors import InputError, UsageError
from cltransfer.evaluate import evaluate
from cltransfer.evaluate_kept import KEPT
from cltransfer.features import Features
from cltransfer.registry import LOSSES


@pytest.fixture
def clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a folder ``refs`` of two clips, and ``ours`` of one, in which the test works."""
    for name in ("refs/a", "refs/b", "ours/a"):
        image = torch.zeros(2, 3, 16, 16, dtype=torch.uint8)
        write_video(tmp_path / f"{name}.mkv", image, torch.arange(2).double() / 8, lossless=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("second", ["ours/a.mkv", "refs/b.mkv#t=0,1", "ours"])
def test_a_second_render_of_one_clip_is_refused(clips: Path, second: str) -> None:
    line = f"{second}: expected one render, as refs/a.mkv is one clip \\(score one after the other"
    with pytest.raises(UsageError, match=line):
        methods_of("refs/a.mkv", "refs/b.mkv", [second, "frames=4"])
    assert methods_of("refs/a.mkv", "refs/b.mkv", ["frames=4"]) == ({}, ["frames=4"])


@pytest.mark.parametrize("name", ["", " ", "\t"])
def test_a_method_without_a_name_is_refused(clips: Path, name: str) -> None:
    for words in ([f"{name}=ours"], ["ours", f"{name}=refs"]):
        with pytest.raises(UsageError, match=r"=(ours|refs): expected the name of a method before the ="):
            methods_of("refs", words[0], words[1:])


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ("refs/b.mkv", "ours"),
            "ours: holds clips, expected one, as refs/b.mkv is a file (name one, as ours/a.mkv; or",
        ),
        (
            ("refs/a.mkv#t=0,1", "refs"),
            "refs: holds clips, expected one, as refs/a.mkv#t=0,1 is a file (name one, as refs",
        ),
        (
            ("refs/a.mkv", "ours=ours/a.mkv"),
            "ours=ours/a.mkv: expected one render, and no method, as refs/a.mkv is a file (METHOD= goes with folders",
        ),
        (
            ("refs", "ours=ours/a.mkv#t=0,1"),
            "ours=ours/a.mkv#t=0,1: ours/a.mkv is a file, expected a folder of clips, as refs is one (name the folder "
            "that it lies in: ours=ours)",
        ),
        (
            ("refs", "$(ours)=ours/a.mkv"),
            "$(ours)=ours/a.mkv: ours/a.mkv is a file, expected a folder of clips, as refs is one (name the folder "
            "that it lies in: '$(ours)=ours')",
        ),
        (
            ("refs/a.mkv", "ours=ours/a.mkv#t=0,1"),
            "ours=ours/a.mkv#t=0,1: expected one render, and no method, as refs/a.mkv is a file (METHOD= goes with "
            "folders only: 'ours/a.mkv#t=0,1')",
        ),
    ],
)
def test_what_is_no_clip_or_no_folder_of_them_is_told_to_be_none(
    clips: Path, words: tuple[str, str], line: str
) -> None:
    with pytest.raises(UsageError) as caught:
        methods_of(*words, [])
    assert str(caught.value).startswith(line)


def test_a_clip_is_offered_by_the_name_of_its_reference(clips: Path) -> None:
    with pytest.raises(UsageError, match=r"name one, as refs/b\.mkv;"):
        methods_of("refs/b.mkv", "refs", [])
    (clips / "imgs").mkdir()
    (clips / "imgs" / "0.png").touch()
    with pytest.raises(UsageError, match=r"as imgs holds 0\.png .name one, as ours/a\.mkv;"):
        methods_of("imgs", "ours", [])
    (clips / "ours" / "a.mkv").rename(clips / "ours" / "$(a).mkv")
    with pytest.raises(UsageError, match=r"name one, as 'ours/\$\(a\)\.mkv';"):
        methods_of("imgs", "ours", [])


def test_a_scene_with_a_trajectory_is_no_clip(clips: Path) -> None:
    for words in (("a.ply@b.json", "refs/a.mkv"), ("refs/a.mkv", "a.ply@b.json")):
        assert methods_of(*words, []) == ({}, [])
        with pytest.raises(InputError, match=r"^a\.ply@b\.json: is a scene with a trajectory, no clip .*`describe`"):
            evaluate(*words, load_config())


@dataclass(frozen=True)
class Stopping:
    """A loss by which the process is terminated once a clip was scored."""

    weight: float = 1.0

    requires: ClassVar[tuple[str, ...]] = ("flow",)
    unit: ClassVar[str] = "px"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        if (Path("out") / KEPT).is_file():
            signal.raise_signal(signal.SIGTERM)
        return torch.zeros(len(rendered))


@pytest.fixture
def stopping() -> Iterator[str]:
    LOSSES.register("stopping")(Stopping)
    yield "losses.stopping={}"
    LOSSES._classes.pop("stopping")


def test_that_the_same_command_goes_on_is_told_where_it_is_stopped(
    clips: Path, mean_flow: tuple[str, ...], stopping: str, command: Callable[..., Any]
) -> None:
    shutil.copy(clips / "refs" / "b.mkv", clips / "ours")
    words = ("evaluate", "refs", "ours", *mean_flow, stopping, "--quiet")
    answer = command(*words, "--out", "out")
    assert (answer.code, answer.out) == (143, "")
    assert answer.err == "error: terminated (the same command goes on from here: out)\n"
    assert len((clips / "out" / KEPT).read_text().splitlines()) == 1
    assert command(*words, "--out", "elsewhere").err == "error: terminated\n"


def test_scores_of_one_clip_and_of_folders_do_not_go_into_one_folder(
    clips: Path, mean_flow: tuple[str, ...], command: Callable[..., Any]
) -> None:
    one, folders = ("evaluate", "refs/a.mkv", "ours/a.mkv"), ("evaluate", "refs", "ours")
    for first, other, held in ((one, folders, "one clip"), (folders, one, "folders")):
        out = held.replace(" ", "_")
        for _ in range(2):
            assert command(*first, *mean_flow, "--quiet", "--out", out).code == 0
        found = {file.name: file.read_bytes() for file in (clips / out).iterdir()}
        answer = command(*other, *mean_flow, "--quiet", "--out", out)
        told = f"holds the scores of {held}, of which a part would stay (name another folder)"
        assert (answer.code, answer.err) == (2, f"error: {out}: --out: {told}\n")
        assert {file.name: file.read_bytes() for file in (clips / out).iterdir()} == found
