"""Which way is up in the world of a set of photographs, by how their cameras were held."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..camera import Camera

HELD = 0.3  # length of the mean of the cameras' own up, below which they were held every way
LEVEL = 0.05  # weight of that mean beside what is at right angles to all horizons, which views of one side tell badly
SNAP = math.radians(30)  # to an axis that is as near, up is along it if the horizons allow: worlds are made so
ALLOWED = math.radians(3)  # that horizons may lean more of the axis than of up: nobody holds so exactly
EXACT = math.radians(5)  # to an axis that is as near, up is along it, whatever the horizons say


def upward(camera: Camera) -> tuple[float, float, float] | None:
    """Upwards in the world of cameras (B) that were held about level, unit length; None where no way is told.

    It is their mean up, less what of it lies along the horizons: cameras that look down from one side lean with it.
    """
    right, mean = camera.w2c[:, 0, :3], -camera.w2c[:, 1, :3].mean(0)
    if float(mean.norm()) < HELD:
        return None
    along = right.T @ right / len(right) + LEVEL * torch.eye(3).to(right)
    up = torch.nn.functional.normalize(torch.linalg.solve(along, mean), dim=0)
    x, y, z = (round(value, 3) + 0.0 for value in _snapped(up, right).tolist())  # no -0
    return x, y, z


def _snapped(up: Tensor, right: Tensor) -> Tensor:
    """The axis (3,) that ``up`` is near, if cameras of these horizons (B, 3) may stand along it; else ``up``."""
    index = int(up.abs().argmax())
    axis = torch.zeros_like(up).index_fill(0, torch.tensor(index), math.copysign(1.0, float(up[index])))
    allowed = _lean(axis, right) <= _lean(up, right) + ALLOWED
    return axis if float(up @ axis) >= math.cos(SNAP if allowed else EXACT) else up


def _lean(up: Tensor, right: Tensor) -> float:
    """How far the horizons (B, 3) are from level, of all together [rad, of small ones]."""
    return float((right @ up).square().mean().sqrt())
