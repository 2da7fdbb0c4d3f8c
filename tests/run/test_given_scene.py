"""A scene that Python has made is transferred into as one from a file is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from cltransfer.config import load_config
from cltransfer.errors import CltransferError, UsageError
from cltransfer.run.folder import write_run
from cltransfer.run.inputs import Inputs, given_scene
from cltransfer.scenes import Scene
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import load_person
from cltransfer.transfer import transfer


def test_a_scene_from_python_is_found_the_same_cameras_in(tmp_path: Path) -> None:
    config = load_config(overrides=["preset=fast", "frames=2", "search_side=48", "output_side=96"])
    scene = load_scene("builtin:plaza")
    inputs = Inputs(replace(scene, name="mine"), "builtin:push_in")
    found, same = transfer(inputs, config), transfer(Inputs("builtin:plaza", "builtin:push_in"), config)
    assert torch.equal(found.trajectory.camera.w2c, same.trajectory.camera.w2c)
    report = write_run(tmp_path, found, inputs, config)
    told = json.loads((tmp_path / "manifest.json").read_text())["scene"]
    assert (told["name"], told["sha256"], told["file"]) == ("mine", scene.digest, None)
    assert report.command == ""
    again = given_scene(Inputs(replace(scene, subject=None), "builtin:push_in", subject=tmp_path / "subject.json"))
    assert again.subject is not None
    assert torch.equal(again.geometry.label, load_person(scene, tmp_path / "subject.json").geometry.label)


PLAZA = load_scene("builtin:plaza")


@pytest.mark.parametrize(
    ("scene", "line"),
    [
        (replace(PLAZA, name=""), "scene: expected a name, got none"),
        (replace(PLAZA, digest="mine"), r"digest: expected a SHA-256 in hex, got 'mine' \(caches .*hexdigest\(\)\)"),
        (
            replace(PLAZA, geometry=[0.0]),
            "scene: expected a geometry, got list without renderer, means, label, with_lab",
        ),
    ],
)
def test_a_scene_that_could_not_be_known_again_or_drawn_is_refused(scene: Scene, line: str) -> None:
    with pytest.raises(CltransferError, match=line):
        given_scene(Inputs(scene, "builtin:push_in"))


@pytest.mark.parametrize("subject", ["nowhere/person.json", Path("nowhere/person.json")])
def test_a_person_given_as_text_is_a_file_too(subject: str | Path) -> None:
    inputs = Inputs("builtin:plaza", "builtin:push_in", subject=subject)  # type: ignore[arg-type]
    with pytest.raises(CltransferError, match=r"nowhere/person\.json: no such file"):
        given_scene(inputs)


@pytest.mark.parametrize("subject", [1, np.int64(1), "1.5", 1.5, True])
def test_a_person_is_given_by_a_whole_number_or_a_file(subject: object) -> None:
    if isinstance(subject, float | bool):
        with pytest.raises(UsageError, match=r"subject: expected a path or a whole number, got (float|bool)"):
            Inputs("builtin:plaza", "builtin:push_in", subject=subject)  # type: ignore[arg-type]
        return
    kept = Inputs("builtin:plaza", "builtin:push_in", subject=subject).subject  # type: ignore[arg-type]
    assert (type(kept), kept) == ((type(Path()), Path("1.5")) if isinstance(subject, str) else (int, 1))


def test_a_scene_has_its_own_up() -> None:
    with pytest.raises(CltransferError, match="plaza: up: a scene has its own"):
        given_scene(Inputs(PLAZA, "builtin:push_in", up=(0.0, 0.0, 1.0)))


def test_a_path_is_taken_where_text_is() -> None:
    given = Inputs(Path("scene.ply"), Path("clip.mp4"), Path("view.json"))
    assert (given.scene, given.reference, given.init) == ("scene.ply", "clip.mp4", "view.json")


def test_nobody_is_lifted_where_the_scene_tells_its_person() -> None:
    small = load_config(overrides=["preset=fast", "frames=1", "search_side=48", "output_side=64", "threads=1"])
    with pytest.raises(UsageError, match=r"--subject: this scene tells its person itself, nobody is lifted"):
        transfer(Inputs("builtin:plaza", "builtin:static", subject=1), small)
