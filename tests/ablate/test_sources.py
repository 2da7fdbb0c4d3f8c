"""Whatever a sweep names and is not there is told before its first trial, once, with its file and its key."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.run import Options, ablate
from cltransfer.ablate.sources import check_sources
from cltransfer.errors import CltransferError, InputError, UsageError

PLAZZA = "scene 'plazza': no such built-in scene (known: courtyard, path, plaza, room, stage)"

REFUSED: dict[str, tuple[type[CltransferError], str]] = {
    "rows: {a: {}, b: {scene: 'builtin:plazza'}}": (UsageError, f"rows.b.scene.scene: {PLAZZA}"),
    "rows: {a: {}, b: {scene: 'builtin:plaza-0-gird'}}": (
        UsageError,
        "rows.b.scene.scene: scene plaza: no form 'gird'",
    ),
    "rows: {a: {}, b: {scene: 'builtin:plaza-one'}}": (UsageError, "rows.b.scene.scene: scene 'plaza-one': expected"),
    "rows: {a: {}, b: {scene: nope.ply}}": (InputError, "rows.b.scene.scene: {folder}/nope.ply: no such file"),
    "rows: {a: {}, b: {scene: {init: nope.json}}}": (InputError, "rows.b.scene.init: {folder}/nope.json: no such file"),
    "rows: {a: {}}\nscenes: ['builtin:room', 'builtin:plazza']": (UsageError, f"scenes[1].scene: {PLAZZA}"),
    "rows: {a: {}}\nscenes: [{scene: 'builtin:room', subject: nobody.json}]": (
        InputError,
        "scenes[0].subject: {folder}/nobody.json: no such file",
    ),
    "rows: {a: {}}\nreferences: ['drawn:pan', nope.mp4]": (
        InputError,
        "references[1]: {folder}/nope.mp4: no such file",
    ),
    "rows: {a: {}}\nreferences: ['builtin:orbitt']": (UsageError, "references[0]: shot 'orbitt': no such shot"),
    "rows: {a: {}}\nreferences: ['builtin:pan', 'drawn:orbitt']": (
        UsageError,
        "references[1]: shot 'orbitt': no such shot",
    ),
    "rows: {a: {}}\nreferences: ['builtin:plazza@shot.json']": (UsageError, f"references[0]: {PLAZZA}"),
}


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], str]:
    """An ablation file, beside a trajectory that is one."""

    def write(text: str) -> str:
        (tmp_path / "shot.json").write_text("{}")
        (tmp_path / "sweep.yaml").write_text(text)
        return str(tmp_path / "sweep.yaml")

    return write


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_not_there_is_refused_before_the_first_trial(
    written: Callable[[str], str], tmp_path: Path, text: str
) -> None:
    kind, line = REFUSED[text]
    with pytest.raises(kind) as caught:
        ablate(read_sweep(written(text), ["preset=fast", "frames=1", "output_side=32"]), Options(tmp_path / "out"))
    assert str(caught.value).startswith(f"{tmp_path}/sweep.yaml: {line.format(folder=tmp_path)}")
    assert not (tmp_path / "out").exists()


def test_a_scene_in_whose_place_every_row_has_its_own_is_not_looked_for(written: Callable[[str], str]) -> None:
    text = "scenes: [nope.ply]\nrows: {{a: {{scene: 'builtin:room'}}, b: {}}}\n"
    check_sources(read_sweep(written(text.format("{scene: 'builtin:room-3-mesh'}"))))
    with pytest.raises(InputError, match=r"sweep\.yaml: scenes\[0\]\.scene: "):
        check_sources(read_sweep(written(text.format("{}"))))


def test_a_person_by_number_is_no_file_to_look_for(written: Callable[[str], str]) -> None:
    check_sources(read_sweep(written("scenes: [{scene: 'builtin:room', subject: 1}]\nrows: {a: {}}\n")))


def test_what_the_command_line_names_is_told_as_that(written: Callable[[str], str]) -> None:
    sweep = read_sweep(written("rows: {a: {}}\nreferences: ['builtin:pan']"), ["references=[nope.mp4]"])
    with pytest.raises(InputError, match=r"^command line: references\[0\]: .*nope\.mp4: no such file"):
        check_sources(sweep)
