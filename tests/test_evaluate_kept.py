"""Scores of folders on disk: which are taken from there, and which another run may better."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.clips.clip import write_video
from cltransfer.computer import memory
from cltransfer.config import load_config
from cltransfer.config.options import RunConfig
from cltransfer.errors import InputError, ResourceError
from cltransfer.evaluate_kept import KEPT, ClipScore, Kept
from cltransfer.evaluate_many import evaluate_many
from cltransfer.features import Features, OfThisRun
from cltransfer.pipeline.components import Components
from cltransfer.registry import EXTRACTORS, LOSSES
from cltransfer.storage.kept_lines import keep


@dataclass(frozen=True)
class Grey:
    """Reads whole clips; of those whose turn is in ``late`` its time runs out."""

    late: ClassVar[set[int]] = set()
    turns: ClassVar[list[int]] = []

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("grey",)
    family: ClassVar[str] = "image"
    whole_clip: ClassVar[bool] = True

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        self.turns.append(len(self.turns))
        if self.turns[-1] in self.late:
            return replace(found, reasons={"grey": OfThisRun("time ran out")})
        return found.having("grey", load(0, len(found)).require("image").flatten(1).mean(1))


@dataclass(frozen=True)
class OfGrey:
    """Difference of the grey of frames."""

    weight: float = 1.0

    requires: ClassVar[tuple[str, ...]] = ("grey",)
    unit: ClassVar[str] = "grey"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return (reference.require("grey") - rendered.require("grey")).abs()


@pytest.fixture
def config(mean_flow: tuple[str, ...]) -> Iterator[RunConfig]:
    """By which the movement and the grey of clips are scored, each clip read in one turn."""
    EXTRACTORS.register("grey")(Grey)
    LOSSES.register("of_grey")(OfGrey)
    Grey.late.clear()
    Grey.turns.clear()
    yield load_config(overrides=[*mean_flow, "extractors.grey={}", "losses.of_grey={}"])
    EXTRACTORS._classes.pop("grey")
    LOSSES._classes.pop("of_grey")


def folder_of(path: Path, *clips: str) -> Path:
    """Clips of three frames of noise."""
    for name in clips:
        image = torch.randint(256, (3, 3, 32, 48), generator=torch.Generator().manual_seed(0), dtype=torch.uint8)
        write_video(path / f"{name}.mkv", image, torch.arange(3).double() / 8, lossless=True)
    return path


@pytest.mark.parametrize("late", [0, 1])  # the reference, the render
def test_a_score_that_another_run_may_better_is_not_kept(config: RunConfig, tmp_path: Path, late: int) -> None:
    references, ours = folder_of(tmp_path / "references", "a", "b"), folder_of(tmp_path / "ours", "a", "b")
    Grey.late.add(late)
    runs = [evaluate_many(references, {"ours": ours}, config, folder=tmp_path / "out") for _ in range(3)]
    assert [[row.means["of_grey"] for row in rows] for rows in runs] == [[None, 0.0], [0.0, 0.0], [0.0, 0.0]]
    assert all(row.means["mean_flow"] == 0.0 for rows in runs for row in rows)  # the others had a value at once
    assert len(Grey.turns) == 4 + 2  # of the second run those of the first clip, of the third none


SCORE = ClipScore("ours", "a", {"size": 0.5, "angle": None}, {"size": 3, "angle": 0}, 3, notes=("dark",), had=("size",))


def known(folder: Path, config: RunConfig) -> dict[str, ClipScore]:
    return dict(Kept.of(folder, Components.build(config), config).known)


@pytest.mark.parametrize(
    "change",
    [
        {"method": 1}, {"clip": None}, {"means": {"size": "0.5"}}, {"means": [0.5]}, {"means": {"size": [[]] * 9}},
        {"means": {"size": 10**400}}, {"defined": {"size": 1.5}}, {"frames": True}, {"notes": [1]}, {"lacking": [""]},
        {"lacking": {"size": []}}, {"seconds": "1"}, {"had": 3}, {"lasts": 1}, {"key": []}, {"more": 1},
    ],
)  # fmt: skip
def test_a_line_of_other_values_is_no_score(config: RunConfig, tmp_path: Path, change: dict[str, Any]) -> None:
    keep(tmp_path / KEPT, {"key": "k", **asdict(SCORE)})
    assert known(tmp_path, config) == {"k": SCORE}
    keep(tmp_path / KEPT, {"key": "l", **asdict(SCORE), **change})
    with pytest.raises(InputError, match=r"scores\.jsonl: line 2: is no score"):
        known(tmp_path, config)


def test_scores_are_held_against_the_memory(config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep(tmp_path / KEPT, {"key": "k", **asdict(SCORE)})
    monkeypatch.setattr(memory, "free_bytes", lambda: 1000)
    with pytest.raises(ResourceError, match=r"scores\.jsonl: memory: values of \d+ bytes of JSON need"):
        known(tmp_path, config)
