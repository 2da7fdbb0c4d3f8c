"""The camera's motion where the cameras are known: exact, in the same words as a clip's."""

from __future__ import annotations

import torch
from kornia.geometry.conversions import rotation_matrix_to_axis_angle

from ..subject import Subject
from ..trajectory import Trajectory
from .motion import PRIMITIVES, Motion, frame_side

HELD = 0.6  # a subject moving by less than this part of what the travel alone would move it is held in place


def path_motion(path: Trajectory, subject: Subject) -> Motion:
    """Motion of the cameras of ``path`` about ``subject``."""
    camera = path.camera
    rates = torch.zeros(len(camera), len(PRIMITIVES), dtype=torch.float64)
    if len(camera) > 1:
        lens = (camera.focal / frame_side(camera.size))[1:, None]  # [frame sides]
        R = camera.w2c[:, :3, :3]
        turn = rotation_matrix_to_axis_angle(R[1:] @ R[:-1].transpose(1, 2))  # how the world turns before the camera
        pan, tilt, roll = -turn[:, 1:2] * lens, -turn[:, :1] * lens, -turn[:, 2:]
        anchor = camera.to_camera(subject.anchor[None])[:, 0]
        distance = anchor.norm(dim=1)
        step = (R[1:] @ (camera.center[1:] - camera.center[:-1])[..., None])[..., 0]  # [scene units], along the axes
        forward = step[:, 2] / (distance[1:] * distance[:-1]).sqrt()  # towards the person the log of the distances
        step = step / distance[1:, None] * lens
        rates[1:, 2:3] = roll
        rates[1:, 3] = camera.focal.log().diff()
        rates[1:, 4] = forward
        rates[1:, [0, 5, 7]] = _split(pan, step[:, :1], spare=True)
        rates[1:, [1, 6]] = _split(tilt, -step[:, 1:2], spare=False)
    return Motion(rates, path.times, float("nan"))


def _split(turn: torch.Tensor, travel: torch.Tensor, spare: bool) -> torch.Tensor:
    """Turn (M, 1) and travel (M, 1) along one axis as turn, travel and, where ``spare``, travel round, (M, 2 or 3).

    A turn that keeps the subject in place while the camera travels belongs to the travel: by the slope of one over the
    other, as both may come back to where they were.
    """
    along = (travel * travel).sum()
    held = bool(along > 0) and bool((1 + (turn * travel).sum() / along).abs() < HELD)
    none = torch.zeros_like(turn)
    if not spare:
        return torch.cat([none if held else turn, travel], dim=1)
    return torch.cat([none, none, travel] if held else [turn, travel, none], dim=1)
