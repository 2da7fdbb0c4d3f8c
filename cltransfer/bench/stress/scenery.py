"""Stress by the scene: reconstructions with holes and floaters, things and people in the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ...scenes.columns import SH0
from ...scenes.simplify import PARTS, joined, subset
from ...scenes.splats import Splats
from .case import Case, Stressor

SPACING = 0.02  # subject heights between the Gaussians of an occluder
REACH = 4.0  # subject heights around the person in which floaters hang


def pruned(case: Case, share: float, rng: np.random.Generator) -> Case:
    """``share`` of the Gaussians are gone, as after too few training views."""
    splats = _splats(case)
    keep = torch.from_numpy(rng.permutation(len(splats))[round(share * len(splats)) :].copy()).sort().values
    return _with(case, subset(splats, keep))


def floaters(case: Case, count: float, rng: np.random.Generator) -> Case:
    """So many large, half transparent Gaussians hang in the air about the person."""
    subject, n = case.scene.person, round(count)
    directions = rng.normal(size=(n, 3))
    drawn = directions / np.linalg.norm(directions, axis=1, keepdims=True) * rng.uniform(0.5, REACH, (n, 1))
    offset = torch.from_numpy(drawn)
    upward = offset @ subject.up
    offset = offset + (upward.abs() - upward)[:, None] * subject.up  # none below the ground
    sizes = torch.from_numpy(rng.uniform(0.04, 0.16, (n, 1))).expand(n, 3)
    opacity = torch.from_numpy(rng.uniform(0.5, 0.9, n))
    color = torch.from_numpy(rng.uniform(0, 1, (n, 3)))
    means = subject.anchor + subject.height * offset
    return _with(case, _add(_splats(case), means, subject.height * sizes, opacity, color))


def occluder(case: Case, width: float, rng: np.random.Generator) -> Case:
    """A board ``width`` subject heights wide, as high as the person, stands halfway to the first view."""
    subject = case.scene.person
    middle = (subject.anchor + case.view.center[0]) / 2
    right, down, _ = case.view.w2c[0, :3, :3]
    steps = [torch.arange(-e / 2, e / 2, SPACING, dtype=torch.float64) for e in (width, 1.0)]
    across, along = torch.meshgrid(*steps, indexing="ij")
    means = middle + subject.height * (across.reshape(-1, 1) * right + along.reshape(-1, 1) * down)
    n = len(means)
    grey = torch.full((n, 3), float(rng.uniform(0.2, 0.6)), dtype=torch.float64)
    sizes = torch.full((n, 3), 0.7 * SPACING * subject.height, dtype=torch.float64)
    return _with(case, _add(_splats(case), means, sizes, torch.ones(n, dtype=torch.float64), grey))


def second_person(case: Case, apart: float, rng: np.random.Generator) -> Case:
    """The person's double, of whom nobody knows, stands ``apart`` subject heights to one side."""
    splats, subject = _splats(case), case.scene.person
    double = subset(splats, (splats.label > 0.5).nonzero()[:, 0])
    side = float(rng.choice([-1.0, 1.0])) * apart * subject.height * subject.left
    double = replace(double, means=double.means + side.to(double.means), label=torch.zeros_like(double.label))
    return _with(case, joined(splats, double))


def _splats(case: Case) -> Splats:
    geometry = case.scene.geometry
    if not isinstance(geometry, Splats):
        raise ValueError(f"scenes are stressed as splats, got {type(geometry).__name__}")
    return geometry


def _add(splats: Splats, means: Tensor, scales: Tensor, opacity: Tensor, color: Tensor) -> Splats:
    """The splats and M more, unturned, of one colour (M, 3) in [0, 1] each, none of them the person."""
    sh = torch.zeros(len(means), *splats.sh.shape[1:], dtype=torch.float64)
    sh[:, 0] = (color - 0.5) / SH0
    quats = torch.tensor([1.0, 0, 0, 0], dtype=torch.float64).expand(len(means), 4)
    more = Splats(means, scales, quats, opacity, sh, torch.zeros(len(means)))
    return joined(splats, replace(more, **{name: getattr(more, name).to(getattr(splats, name)) for name in PARTS}))


def _with(case: Case, splats: Splats) -> Case:
    return replace(case, scene=replace(case.scene, geometry=splats))


SCENERY = {
    "pruned": Stressor("Gaussians gone", "of the Gaussians", (0.3, 0.5, 0.7, 0.85, 0.95), pruned),
    "floaters": Stressor("Gaussians in the air", "floaters", (20, 50, 100, 200, 400), floaters),
    "occluder": Stressor("a board before the person", "subject heights wide", (0.04, 0.08, 0.12, 0.18, 0.3), occluder),
    "second_person": Stressor("the person's double", "subject heights apart", (2.0, 1.2, 0.8, 0.5, 0.3), second_person),
}
