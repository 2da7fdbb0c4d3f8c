"""A person of another scene, or of this one before it was scaled, turned or moved."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from scipy.spatial.transform import Rotation

from cltransfer.errors import InputError
from cltransfer.scenes import Scene
from cltransfer.scenes.bake import bake_grid
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.person.lifted import load_person, save_labels


def changed(scale: float = 1.0, turn: float = 0.0, move: float = 0.0, shown: float = 1.0) -> Scene:
    """The courtyard, scaled, turned about its up [rad] and moved aside [m], marked up to ``shown`` of the person."""
    scene = named_scene("courtyard")
    geometry, person = scene.geometry, scene.person
    height = geometry.means.double() @ person.up
    lowest = height[geometry.label > 0.5].min()
    marked = geometry.label * (height - lowest <= shown * person.height)
    R = torch.from_numpy(Rotation.from_rotvec(turn * person.up.numpy()).as_matrix())
    means = scale * geometry.means.double() @ R.T + move * person.left
    return replace(scene, geometry=replace(geometry, means=means.to(geometry.means), label=marked))


def lifted(folder: Path, scene: Scene) -> Path:
    """What a lift leaves of ``scene``."""
    scene.person.save(folder / "subject.json")
    save_labels(folder, scene.geometry.label)
    return folder / "subject.json"


@pytest.mark.parametrize("change", [{"scale": 2.0}, {"scale": 1000.0}, {"turn": math.pi / 2, "move": 1.0}])
def test_a_person_of_a_scene_that_was_changed_since_is_refused(tmp_path: Path, change: dict[str, float]) -> None:
    scene = changed(**change)
    told = r"subject.json: joints: expected the primitives that are labelled within 0.22 heights of the bones, got \d"
    with pytest.raises(InputError, match=told):
        load_person(scene, lifted(tmp_path, scene))


def test_who_is_marked_by_the_scene_itself_must_lie_there_too(tmp_path: Path) -> None:
    scene = changed(scale=2.0)
    scene.person.save(tmp_path / "subject.json")
    with pytest.raises(InputError, match=r"expected the primitives that are labelled within 0.22 heights of the bones"):
        load_person(scene, tmp_path / "subject.json")


@pytest.mark.parametrize(("scale", "alone"), [(0.5, 4), (0.1, 10)])
def test_a_person_who_is_larger_than_what_is_marked_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, scale: float, alone: int
) -> None:
    """A smaller body at the same place lies along the bones of the larger one."""
    scene = changed(scale=scale)
    load_person(scene, lifted(tmp_path, scene))
    (line,) = caplog.messages
    told = f"joints: expected primitives that are labelled within 0.22 heights of each joint, {alone} of 14 have none"
    assert told in line


@pytest.mark.parametrize("shown", [1.0, 0.75])
def test_a_person_is_taken_who_lies_where_it_was_lifted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, shown: float
) -> None:
    """And one of whom nobody has marked the head."""
    scene = changed(shown=shown)
    load_person(scene, lifted(tmp_path, scene))
    assert not caplog.messages


@pytest.mark.parametrize("form", ["splats", "mesh", "grid"])
def test_a_person_fits_each_form_of_a_scene(tmp_path: Path, caplog: pytest.LogCaptureFixture, form: str) -> None:
    scene = named_scene("stage-5" if form == "splats" else "stage-5-mesh")
    if form == "grid":
        scene = replace(scene, geometry=bake_grid(scene.geometry, 32))
    scene.person.save(tmp_path / "subject.json")
    assert load_person(scene, tmp_path / "subject.json").subject is not None
    assert not caplog.messages


def test_where_nobody_is_marked_nobody_is_held_against_it(tmp_path: Path) -> None:
    scene = changed(scale=2.0, shown=-1.0)
    assert load_person(scene, lifted(tmp_path, scene)).subject is not None
