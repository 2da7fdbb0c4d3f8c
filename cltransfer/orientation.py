"""From which side a camera sees a body: one formula for networks, renders and lifted subjects."""

from __future__ import annotations

import math

import torch
from torch import Tensor

PARALLEL = 1e-6  # sine of the angle between two axes below which rounding in float32, 4e-7 at most, may be all of it


def orientation_from_axes(left: Tensor, up: Tensor, toward_camera: Tensor) -> Tensor:
    """Yaw, pitch and roll of the camera about a body (paper Eq. 13-14).

    Args:
        left: towards the body's left, (..., 3), in camera axes (x right, y down, z forward), any length.
        up: towards the body's head, (..., 3), likewise. ``left`` is made orthogonal to it.
        toward_camera: from the body to the camera, (..., 3), likewise; (0, 0, -1) on the optical axis.

    Returns:
        (..., 3) [rad]. Yaw in (-pi, pi] is 0 in front of the body and positive on its left, pitch in
        [-pi/2, pi/2] is positive from above, roll in (-pi, pi] is positive when the body leans right in the
        image of a camera that is turned, the shortest way, to look at it: beside the optical axis a level camera
        that looks down shows a body lean that stands upright, and what reads a crop sees none of that. NaN where
        an axis is NaN or zero or the two are parallel; looking straight along ``up`` leaves yaw without meaning,
        and a body right behind the camera roll.

    >>> orientation_from_axes(*torch.tensor([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])).abs()
    tensor([0., 0., 0.])
    """
    up = unit(up)
    along = (left * up).sum(-1, keepdim=True)
    left = left - along * up
    length = torch.linalg.vector_norm(left, dim=-1, keepdim=True)
    left = left / length.masked_fill(length <= PARALLEL * along.abs(), torch.nan)
    front = torch.linalg.cross(left, up)
    toward_camera = unit(toward_camera)
    on_left, on_front, on_up = ((toward_camera * axis).sum(-1) for axis in (left, front, up))
    yaw = torch.atan2(on_left, on_front)
    pitch = torch.asin(on_up.clamp(-1, 1))
    right, down = _turned(up, -toward_camera)
    roll = torch.atan2(right, -down)
    return torch.stack([yaw, pitch, roll.expand_as(yaw)], dim=-1)


def _turned(vector: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
    """x and y (...) of ``vector`` (..., 3) after the least rotation that brings the unit ``ray`` to the axis z."""
    along = ((vector * ray).sum(-1) + vector[..., 2]) / (1 + ray[..., 2])
    return vector[..., 0] - along * ray[..., 0], vector[..., 1] - along * ray[..., 1]


def unit(vector: Tensor) -> Tensor:
    """``vector`` (..., 3) at length 1; NaN where its length is 0."""
    return vector / torch.linalg.vector_norm(vector, dim=-1, keepdim=True)


def wrap(angle: Tensor) -> Tensor:
    """Angle [rad] brought into (-pi, pi].

    >>> wrap(torch.tensor([-math.pi, 0.5, 2 * math.pi + 0.5]))
    tensor([3.1416, 0.5000, 0.5000])
    """
    return math.pi - torch.remainder(math.pi - angle, 2 * math.pi)
