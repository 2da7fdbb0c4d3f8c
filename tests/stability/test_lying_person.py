"""A person who lies in the scene and stands in the reference: their sizes have no side of the frame in common."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.run.flags import run_flags
from cltransfer.scenes import Scene
from cltransfer.scenes.person.lifted import save_labels
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.splats import Splats
from cltransfer.shots import Setup, shot
from cltransfer.transfer import Inputs, Result, transfer

SMALL = ("frames=3", "search_side=64", "output_side=64", "threads=1", "extract.verify=false")


@pytest.fixture(scope="module")
def lying(courtyard: Scene) -> Scene:
    """The courtyard's person on their back, on the ground; its Gaussians stay as they were turned."""
    person, splats = courtyard.subject, courtyard.geometry
    assert person is not None
    assert isinstance(splats, Splats)
    axes, new = (torch.stack([person.left, *two]) for two in ((person.facing, person.up), (person.up, -person.facing)))

    def laid(points: torch.Tensor) -> torch.Tensor:
        return person.anchor - 0.35 * person.height * person.up + (points.double() - person.anchor) @ axes.T @ new

    body = splats.label > 0.5
    means = torch.where(body[:, None], laid(splats.means).to(splats.means), splats.means)
    digest = hashlib.sha256(f"lying in {courtyard.digest}".encode()).hexdigest()
    laid_down = replace(person, joints=laid(person.joints))
    return Scene(replace(splats, means=means), laid_down, courtyard.up, "lying", digest)


def own(scene: Scene, folder: Path) -> str:
    """A shot of the scene's person, from their front and a little from aside, as a reference."""
    assert scene.subject is not None
    assert isinstance(scene.geometry, Splats)
    write_splats(folder / "scene.ply", scene.geometry)
    scene.subject.save(folder / "subject.json")
    save_labels(folder, scene.geometry.label)
    shot("push_in", scene.subject, (64, 36), 3, setup=Setup(azimuth=0.6)).save(folder / "shot.json")
    return f"{folder / 'scene.ply'}@{folder / 'shot.json'}"


def told(scene: Scene, reference: str) -> list[str]:
    found: Result = transfer(Inputs(scene, reference), load_config("fast", overrides=SMALL))
    return [flag.reason for flag in run_flags(found) if "trunk" in flag.reason]


def test_one_who_lies_and_stands_in_the_reference_is_told_of(lying: Scene) -> None:
    """The lens is then one of 10 degrees, so that what little they span fills as much of the frame."""
    (reason,) = told(lying, "builtin:push_in")
    assert reason.startswith("the person's trunk leans by 90 degrees in the scene, by less than 45 in the reference")


def test_one_who_stands_and_lies_in_the_reference_is_told_of(courtyard: Scene, lying: Scene, tmp_path: Path) -> None:
    (reason,) = told(courtyard, own(lying, tmp_path))
    assert reason.startswith("the person's trunk leans by 0 degrees in the scene, by more than 45 in the reference")


def test_one_who_lies_on_both_sides_is_filmed_as_anybody(lying: Scene, tmp_path: Path) -> None:
    assert told(lying, own(lying, tmp_path)) == []
