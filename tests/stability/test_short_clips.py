"""One frame, two frames, a tenth of a second, nothing that moves."""

from collections.abc import Callable
from typing import Any

import pytest
import torch


@pytest.mark.parametrize("frames", [1, 2])
def test_one_and_two_frames_are_clips(
    filmed: Callable[..., Any], solve: Callable[..., Any], sound: Callable[..., None], frames: int
) -> None:
    reference, _ = filmed("push_in", frames=2)
    found = solve(reference, f"frames={frames}")
    sound(found)
    assert len(found.trajectory) == frames
    assert float(found.verified.term("framing").values.max()) < 0.02
    assert found.verified.term("camera_movement").defined == frames - 1


@pytest.mark.parametrize("frames", [3, 2])
def test_smoothing_a_short_clip_keeps_it_sound(
    filmed: Callable[..., Any], solve: Callable[..., Any], sound: Callable[..., None], frames: int
) -> None:
    reference, _ = filmed("push_in", frames=3)
    found = solve(reference, "path=smooth", f"frames={frames}", "joint=1")
    sound(found)
    assert float(found.verified.term("framing").values.max()) < 0.02


def test_one_frame_has_no_path(filmed: Callable[..., Any], solve: Callable[..., Any]) -> None:
    reference, _ = filmed("push_in", frames=2)
    path = solve(reference, "path=smooth", "frames=1").kept.path
    assert path.name == "every frame"
    assert path.total == path.free


def test_a_still_shot_stays_still(
    filmed: Callable[..., Any], solve: Callable[..., Any], sound: Callable[..., None]
) -> None:
    reference, _ = filmed("static", frames=4)
    found = solve(reference)
    sound(found)
    assert found.scene.subject is not None
    drift = (found.trajectory.camera.center - found.trajectory.camera.center[:1]).norm(dim=1)
    assert float(drift.max()) < 0.02 * found.scene.subject.height
    torch.testing.assert_close(
        found.trajectory.camera.focal, found.trajectory.camera.focal[:1].expand(4), rtol=0.02, atol=0
    )
