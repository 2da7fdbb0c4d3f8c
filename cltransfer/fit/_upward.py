"""Which way is up in the world of a set of photographs, by how their cameras were held."""

from __future__ import annotations

import math

import torch

from ..camera import Camera

HELD = 0.3  # length of the mean of the cameras' own up, below which they were held every way
LEVEL = 0.05  # weight of that mean beside what is at right angles to all horizons, which views of one side tell badly
SNAP = math.radians(30)  # to an axis that is as near, up is along it: worlds are made so, and nobody holds so exactly


def upward(camera: Camera) -> tuple[float, float, float] | None:
    """Upwards in the world of cameras (B) that were held about level, unit length; None where no way is told.

    It is their mean up, less what of it lies along the horizons: cameras that look down from one side lean with it.
    """
    right, mean = camera.w2c[:, 0, :3], -camera.w2c[:, 1, :3].mean(0)
    if float(mean.norm()) < HELD:
        return None
    along = right.T @ right / len(right) + LEVEL * torch.eye(3).to(right)
    up = torch.nn.functional.normalize(torch.linalg.solve(along, mean), dim=0)
    axis = int(up.abs().argmax())
    if float(up[axis].abs()) >= math.cos(SNAP):
        up = torch.zeros_like(up).index_fill(0, torch.tensor(axis), math.copysign(1.0, float(up[axis])))
    x, y, z = (round(value, 3) + 0.0 for value in up.tolist())  # no -0
    return x, y, z
