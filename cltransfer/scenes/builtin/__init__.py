"""Scenes that come with the program: Gaussians from code, with a person whose joints are known."""

from __future__ import annotations

import hashlib

import numpy as np
import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion
from torch import Tensor

from ...errors import UsageError
from ...subject import Subject
from .. import Scene
from ..splats import Splats
from .paint import Part, shade
from .sets import SETS
from .surfaces import Array, Cells

VERSION = 2  # part of the digest: raise it when the same name and seed give other Gaussians

_SUN = np.array([0.56, 0.42, 0.714]) / np.linalg.norm([0.56, 0.42, 0.714])
_COVER = 1.32  # standard deviation of a Gaussian in half cells: neighbours overlap into a closed surface
_THICK = 0.004  # [m]
_SH0 = 0.28209479177387814  # the constant spherical harmonic

# scene axes as rows: what the set's x, y, z become; splats in the wild often have -y up
_AXES = {"courtyard": np.eye(3), "plaza": np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])}


def builtin_scene(name: str, seed: int = 0) -> Scene:
    """Scene ``name``, "courtyard" (z up) or "plaza" (-y up), in metres; ``seed`` varies its textures.

    Raises:
        UsageError: there is no such scene.
    """
    if name not in SETS:
        raise UsageError("", f"scene {name!r}", "no such built-in scene", f"known: {', '.join(sorted(SETS))}")
    rng = np.random.Generator(np.random.PCG64(seed))
    body, parts = SETS[name]()
    world = _AXES[name]
    splats = _splats([*parts, *body.parts()], world, rng)
    up, facing = (torch.from_numpy(world[axis].copy()) for axis in (2, 0))
    joints = torch.from_numpy(body.joints() @ world)
    subject = Subject(joints, torch.ones(14, dtype=torch.float64), facing, up, body.height, metres_per_unit=1.0)
    digest = hashlib.sha256(f"builtin:{name}:{seed}:{VERSION}".encode()).hexdigest()
    return Scene(splats, subject, up, name, digest)


def _splats(parts: list[Part], world: Array, rng: np.random.Generator) -> Splats:
    """One flat Gaussian for each cell of ``parts``, painted and lit."""
    cut = [part.surface.cells(part.spacing) for part in parts]
    color = np.concatenate([part.paint(cells.uv, rng) for part, cells in zip(parts, cut)])
    lit = np.concatenate([np.full(len(cells), part.lit) for part, cells in zip(parts, cut)])
    label = np.concatenate([np.full(len(cells), part.subject) for part, cells in zip(parts, cut)])
    rough = np.concatenate([np.full(len(cells), part.rough) for part, cells in zip(parts, cut)])
    cells = Cells.concatenate(cut)
    color[lit] *= shade(cells, cells.center[lit], _SUN)[lit]
    center = cells.center + rough[:, None] * rng.standard_normal((len(cells), 3))
    scales, quats = _ellipsoids(cells, world)
    return Splats(
        means=torch.from_numpy(center @ world).float(),
        scales=scales.float(),
        quats=quats.float(),
        opacity=torch.full((len(cells),), 0.99),
        sh=torch.from_numpy((np.clip(color, 0, 1) - 0.5) / _SH0).float()[:, None],
        label=torch.from_numpy(label).float(),
    )


def _ellipsoids(cells: Cells, world: Array) -> tuple[Tensor, Tensor]:
    """Standard deviations (N, 3) [m] and rotations (N, 4) as w, x, y, z of Gaussians that fill cells."""
    wide, tall = (np.linalg.norm(half, axis=1) for half in (cells.half_u, cells.half_v))
    u, normal = cells.half_u / wide[:, None], cells.normal
    frame = np.stack([u, np.cross(normal, u), normal], 2)  # columns: the cell's axes
    scales = np.stack([wide * _COVER, tall * _COVER, np.full(len(cells), _THICK)], 1)
    return torch.from_numpy(scales), rotation_matrix_to_quaternion(torch.from_numpy(world.T @ frame))
