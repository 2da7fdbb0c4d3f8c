"""From how high a camera looks is told of what the frame shows, as a viewer tells it."""

from __future__ import annotations

import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.describe.angle import HEIGHTS, height_class
from cltransfer.describe.sources import path_features
from cltransfer.testing import sample_subject
from cltransfer.trajectory import Trajectory


@pytest.mark.parametrize("distance", [0.35, 0.6, 1.0, 3.0])
@pytest.mark.parametrize(("over", "word"), [(0.0, "eye level"), (-0.7, "low angle"), (0.8, "high angle")])
def test_a_camera_is_as_high_as_the_face_that_it_shows(distance: float, over: float, word: str) -> None:
    """``over`` the head by this part of the distance."""
    person = sample_subject()
    head = person.key_joints[0, :3]
    eye = head + distance * person.height * (person.facing + over * person.up)
    camera = Camera.look_at(eye[None], head[None], person.up, math.radians(30), (640, 360))
    seen = path_features(Trajectory(camera, torch.zeros(1, dtype=torch.float64)), person)
    assert HEIGHTS[int(height_class(seen.require("orientation"))[0])] == word
