"""Frames that are not evenly spaced, as thinning a clip leaves them: a steady move stays steady."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.clips.thinned import evenly
from cltransfer.config import load_config
from cltransfer.scenes.load import load_scene
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, transfer

SIZE = (96, 54)


def truck(times: Tensor) -> Trajectory:
    """A camera that goes past the person of the room by 0.6 heights a second, three heights away."""
    subject = load_scene("builtin:room-3").subject
    assert subject is not None
    toward = subject.anchor + 3 * subject.height * subject.facing
    first = Camera.look_at(toward[None], subject.anchor[None], subject.up, 0.9, SIZE)
    aside = 0.6 * subject.height * (times - times[-1] / 2)[:, None] * first.w2c[0, 0, :3]
    w2c = first.w2c.repeat(len(times), 1, 1)
    w2c[:, :3, 3] = -(w2c[:, :3, :3] @ (toward + aside)[..., None])[..., 0]
    return Trajectory(Camera(w2c, first.K.repeat(len(times), 1, 1), SIZE), times)


@pytest.mark.parametrize("frames", [60, 100])
def test_a_steady_move_of_a_thinned_clip_has_a_steady_speed(tmp_path: Path, frames: int) -> None:
    every = torch.arange(frames).double()
    times = every[evenly(every, 24 if frames == 60 else 60)][:12] / 30
    assert not torch.allclose(times.diff(), times.diff().mean().expand(11))
    truck(times).save(tmp_path / "truck.json")
    config = load_config(overrides=["preset=fast", "search_side=64", "output_side=64"])
    found = transfer(Inputs("builtin:room-4", f"builtin:room-3@{tmp_path / 'truck.json'}"), config).trajectory
    speed = found.camera.center.diff(dim=0).norm(dim=1) / found.times.diff()
    ripple = float(speed.log().diff().abs().max())
    assert ripple < 0.1, ripple
