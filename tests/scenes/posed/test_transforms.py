"""Focal lengths of a transforms.json, as it states them once and per frame."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.errors import InputError
from cltransfer.scenes.posed import read_posed


def focal(root: Path, once: dict[str, Any], frame: dict[str, Any]) -> tuple[float, float]:
    """fx and fy of the frame that states ``frame``, of a set that states ``once``."""
    bare = {"file_path": "a.png", "transform_matrix": torch.eye(4).tolist()}
    data = {"w": 80, "h": 60, **once, "frames": [bare, {**bare, **frame}]}
    (root / "transforms.json").write_text(json.dumps(data))
    fx, fy = read_posed(root).lenses[1].focal
    return fx, fy


def angle(side: float, length: float) -> float:
    """What a ``side`` [px] is seen under at a focal length [px]."""
    return 2 * math.atan(side / (2 * length))


@pytest.mark.parametrize(
    ("once", "frame", "expected"),
    [
        ({"fl_x": 100}, {"camera_angle_x": angle(80, 50)}, (50, 50)),
        ({"fl_x": 100, "fl_y": 100}, {"camera_angle_x": angle(80, 50)}, (50, 50)),
        ({"fl_x": 100, "fl_y": 110}, {"fl_x": 50}, (50, 50)),
        ({"camera_angle_x": 1.0}, {"fl_x": 50}, (50, 50)),
        ({"fl_x": 100, "fl_y": 110}, {"fl_y": 90}, (100, 90)),
        ({"fl_x": 100, "fl_y": 110}, {"cx": 30}, (100, 110)),
    ],
)
def test_a_focal_length_of_a_frame_goes_before_any_of_the_file(
    tmp_path: Path, once: dict[str, Any], frame: dict[str, Any], expected: tuple[float, float]
) -> None:
    assert focal(tmp_path, once, frame) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("once", "frame", "expected"),
    [
        ({"camera_angle_x": angle(80, 50), "camera_angle_y": angle(60, 70)}, {}, (50, 70)),
        ({"fl_x": 50, "camera_angle_y": angle(60, 70)}, {}, (50, 70)),
        ({"fl_x": 50, "fl_y": 60, "camera_angle_y": angle(60, 70)}, {}, (50, 60)),
        ({"fl_x": 50, "fl_y": 60}, {"camera_angle_y": angle(60, 70)}, (50, 70)),
    ],
)
def test_a_focal_length_is_told_by_an_angle_on_either_axis(
    tmp_path: Path, once: dict[str, Any], frame: dict[str, Any], expected: tuple[float, float]
) -> None:
    assert focal(tmp_path, once, frame) == pytest.approx(expected)


@pytest.mark.parametrize("value", [0, -1, 180, 3.1415927])
def test_a_vertical_angle_that_no_lens_has_is_refused(tmp_path: Path, value: float) -> None:
    with pytest.raises(InputError, match=r"frames\[0\].camera_angle_y: expected an angle above 0 and below pi, got"):
        focal(tmp_path, {"fl_x": 50, "camera_angle_y": value}, {})
