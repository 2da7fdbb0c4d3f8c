"""A scene with a trajectory that networks read as a reference is read as its result is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.reading.named_scenes import load_reference_scene
from cltransfer.reading.reference import Reading, Reference, read_reference
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import save_labels
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.splats import Splats
from cltransfer.trajectory import Trajectory


@dataclass(frozen=True)
class Two:
    """A detector of one at the left edge and one in the middle, each so high in each frame [frame heights]."""

    left: tuple[float, ...]
    middle: tuple[float, ...]
    requires, provides, family = ("image",), ("box",), "image"

    def persons(self, now: Features) -> list[np.ndarray]:
        (w, h), sure = now.size, 0.9
        rows = [[[0, 0, 0.1, a], [0.45, 0.5 - b / 2, 0.1, b]] for a, b in zip(self.left, self.middle)]
        return [np.hstack([np.array(row) * [w, h, w, h], np.full((2, 1), sure)]) for row in rows]

    def __call__(self, now: Features, before: Features | None) -> Features:
        largest = [found[found[:, 3].argmax()] for found in self.persons(now)]
        return replace(now, box=torch.from_numpy(np.stack(largest)).float())


@dataclass(frozen=True)
class MiddleOfBox:
    requires, provides, family = ("box",), ("mine",), "image"

    def __call__(self, now: Features, before: Features | None) -> Features:
        box = now.require("box")
        return now.having("mine", box[:, :1] + box[:, 2:3] / 2)


@dataclass(frozen=True)
class OfMine:
    requires = ("mine",)


def read_by(detector: Two, name: str, path: Path, scene: str = "") -> Reference:
    """What is read of frames of a built-in scene, or of its copy ``scene``, that have its person in the middle."""
    seen, count = load_scene(name), len(detector.left)
    person = seen.subject
    assert person is not None
    eye = (person.anchor + 3 * person.height * person.facing).expand(count, 3)
    Trajectory(Camera.look_at(eye, person.anchor, seen.up, 0.7, (64, 36)), torch.arange(count) / 24).save(path)
    parts = Components.build(load_config())
    parts = replace(parts, losses={"of_mine": OfMine()}, extractors={"persons": detector, "middle": MiddleOfBox()})
    return read_reference(f"{scene or name}@{path}", parts, Reading(count, 64, "image"))


@pytest.mark.parametrize(("name", "people"), [("builtin:stage-1", 2), ("builtin:plaza", 1)])
def test_of_two_whom_networks_see_in_a_scene_that_teaches_they_read_who_is_filmed(
    name: str, people: int, tmp_path: Path
) -> None:
    subject = load_scene(name).subject
    assert subject is not None
    assert subject.people == people
    read = read_by(Two((1.0, 1.0), (0.4, 0.4)), name, tmp_path / "shot.json")
    torch.testing.assert_close(read.features.require("mine"), torch.full((2, 1), 32.0))
    assert read.flags == ()


def test_in_a_scene_that_teaches_without_a_person_the_largest_is_followed_and_told(tmp_path: Path) -> None:
    plaza = load_scene("builtin:plaza")
    assert isinstance(plaza.geometry, Splats)
    write_splats(tmp_path / "scene.ply", plaza.geometry)
    one_by_one = Two((0.6, 0.5, 0.6, 0.6), (0.4, 0.55, 0.4, 0.4))  # the other is larger once
    read = read_by(one_by_one, "builtin:plaza", tmp_path / "shot.json", str(tmp_path / "scene.ply"))
    torch.testing.assert_close(read.features.require("mine"), torch.full((4, 1), 3.2))
    assert read.flags == ("person 0 is followed, seen in 4 frames; also seen: 1 in 4 frames",)


def test_a_scene_that_teaches_with_its_person_cut_is_told_with_what_would_draw_them() -> None:
    def told(*overrides: str) -> tuple[str, ...]:
        parts = Components.build(load_config(overrides=overrides))
        return read_reference("builtin:push_in", parts, Reading(2, 64)).flags

    assert told() == ()
    (note,) = told("renderer.gaussian_splats.near=5", "renderer.gaussian_splats.near_fade=0")
    assert note.startswith("the person is faded or cut in 1 of 2 frames, as near as ")
    assert told(*note.partition(": set ")[2].split()) == ()


def test_a_scene_that_teaches_in_a_small_unit_is_told_to_be_cut(tmp_path: Path) -> None:
    scene, path = load_reference_scene("builtin:push_in", 2, 64)
    geometry, person = scene.geometry, scene.person
    write_splats(tmp_path / "mm.ply", replace(geometry, means=geometry.means / 1000, scales=geometry.scales / 1000))
    replace(person, joints=person.joints / 1000, height=person.height / 1000).save(tmp_path / "subject.json")
    save_labels(tmp_path, geometry.label)
    w2c = path.camera.w2c.clone()
    w2c[:, :3, 3] /= 1000
    replace(path, camera=replace(path.camera, w2c=w2c)).save(tmp_path / "path.json")
    parts = Components.build(load_config())
    (note,) = read_reference(f"{tmp_path}/mm.ply@{tmp_path}/path.json", parts, Reading(2, 64)).flags
    assert note.startswith("the person is faded or cut in 2 of 2 frames, as near as 0.00")
