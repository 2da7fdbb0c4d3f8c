"""A reference from far above: over the person's head azimuth and roll are one, and the camera is found all the same."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera, intrinsics, w2c_of
from cltransfer.config import load_config
from cltransfer.run.flags import run_flags
from cltransfer.scenes import Scene
from cltransfer.subject import Subject
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, Result, transfer

SMALL = ("frames=4", "search_side=64", "output_side=64", "threads=1", "extract.verify=false")
SIZE = (64, 36)


def descent(person: Subject, degrees: float) -> Trajectory:
    """A lens of 40 degrees from four to three heights, so steeply above, the image turned by 70 degrees."""
    pitch, turn = math.radians(degrees), math.radians(70)
    outward = math.cos(pitch) * person.facing + math.sin(pitch) * person.up
    top = -(math.cos(turn) * person.facing + math.sin(turn) * person.left)
    right = torch.nn.functional.normalize(torch.linalg.cross(-outward, top), dim=0)
    axes = torch.stack([right, torch.linalg.cross(-outward, right), -outward]).expand(4, 3, 3)
    away = torch.linspace(4, 3, 4, dtype=torch.float64)[:, None] * person.height
    focal = torch.full((4,), SIZE[1] / (2 * math.tan(math.radians(20))), dtype=torch.float64)
    camera = Camera(w2c_of(axes, person.anchor + away * outward), intrinsics(focal, SIZE), SIZE)
    return Trajectory(camera, torch.arange(4, dtype=torch.float64) / 12)


def to_itself(scene: Scene, degrees: float, folder: Path, *overrides: str) -> Result:
    assert scene.subject is not None
    descent(scene.subject, degrees).save(folder / "shot.json")
    reference = f"builtin:courtyard@{folder / 'shot.json'}"
    return transfer(Inputs(scene, reference), load_config("fast", overrides=[*SMALL, *overrides]))


@pytest.mark.parametrize("degrees", [75.0, 85.0, 90.0])
def test_the_camera_of_a_steep_view_is_found(courtyard: Scene, tmp_path: Path, degrees: float) -> None:
    # measured 0.007, 0.07 and 0.12; the last two 2.7 and 2.5 where a camera stood no higher than 80 degrees
    assert to_itself(courtyard, degrees, tmp_path).searched.total < 0.3


def test_a_camera_that_may_stand_no_higher_is_told_by_which_option(courtyard: Scene, tmp_path: Path) -> None:
    found = to_itself(courtyard, 85.0, tmp_path, "search.subject_orbit.elevation=1.4")
    told = {flag.reason for flag in run_flags(found) if flag.reason.startswith("elevation")}
    assert told == {"elevation at its bound (search.subject_orbit.elevation=1.4)"}
