"""Stress by the first view: it stands elsewhere about the person, or too near or far."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix

from ...camera import Camera
from .case import Case, Stressor


def turned_view(case: Case, degrees: float, rng: np.random.Generator) -> Case:
    """The first view, led about the person by so many degrees to one side."""
    subject = case.scene.person
    angle = math.radians(degrees) * float(rng.choice([-1.0, 1.0]))
    turn = torch.eye(4, dtype=torch.float64)
    turn[:3, :3] = axis_angle_to_rotation_matrix((angle * subject.up)[None])[0]
    turn[:3, 3] = subject.anchor - turn[:3, :3] @ subject.anchor
    return _seen_from(case, case.view.w2c @ turn.inverse())


def nearer_view(case: Case, share: float, rng: np.random.Generator) -> Case:
    """The first view, nearer to the person by ``share`` of its distance."""
    return _at_distance(case, 1 - share)


def farther_view(case: Case, share: float, rng: np.random.Generator) -> Case:
    """The first view, farther from the person by ``share`` of its distance."""
    return _at_distance(case, 1 + share)


def _at_distance(case: Case, factor: float) -> Case:
    """The first view, as it looks, at so many times its distance to the person."""
    subject = case.scene.person
    center = subject.anchor + factor * (case.view.center[0] - subject.anchor)
    w2c = case.view.w2c.clone()
    w2c[0, :3, 3] = -w2c[0, :3, :3] @ center
    return _seen_from(case, w2c)


def _seen_from(case: Case, w2c: torch.Tensor) -> Case:
    return replace(case, view=Camera(w2c, case.view.K, case.view.size))


VIEWING = {
    "turned_view": Stressor("the first view beside the true one", "degrees", (20, 45, 90, 135, 180), turned_view),
    "nearer_view": Stressor("the first view too near", "of the distance", (0.1, 0.2, 0.4, 0.6, 0.8), nearer_view),
    "farther_view": Stressor("the first view too far", "of the distance", (0.1, 0.2, 0.4, 0.6, 0.8), farther_view),
}
