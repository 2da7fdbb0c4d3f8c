"""Surfaces of procedural scenes: described once, then cut into small flat cells at any spacing.

A cell becomes one Gaussian, one quad of a mesh or the mark of one voxel; so every representation of a scene
shows the same geometry. Metres, z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
WIDE = np.array([0.0, 1.0, 0.0])  # in which a turned body has its full radius, as far as that is across its axis


@dataclass(frozen=True)
class Cells:
    """N flat parallelograms that cover a surface.

    Args:
        center: (N, 3) [m].
        half_u: from the centre to the middle of one edge, (N, 3) [m].
        half_v: the same for the next edge, (N, 3) [m]; ``half_u x half_v`` points outwards.
        uv: where the cell lies on its surface, (N, 2) [m], for paints.
    """

    center: Array  # (N, 3) [m]
    half_u: Array  # (N, 3) [m]
    half_v: Array  # (N, 3) [m]
    uv: Array  # (N, 2) [m]

    def __len__(self) -> int:
        return len(self.center)

    @property
    def normal(self) -> Array:
        """Unit vectors outwards, (N, 3)."""
        return _unit(np.cross(self.half_u, self.half_v))

    @staticmethod
    def concatenate(parts: Sequence[Cells]) -> Cells:
        """All cells of several surfaces."""
        return Cells(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Cells)))


class Surface(Protocol):
    """What a set is built from."""

    def cells(self, spacing: float) -> Cells:
        """Cells about ``spacing`` [m] wide that leave no hole."""
        ...


@dataclass(frozen=True)
class Panel:
    """A rectangle from ``corner`` along ``edge_u`` and ``edge_v`` [m]; it faces along their cross product."""

    corner: ArrayLike
    edge_u: ArrayLike
    edge_v: ArrayLike

    def cells(self, spacing: float) -> Cells:
        """A regular grid, so that tiles of a whole number of spacings keep straight edges."""
        corner, u, v = (np.asarray(e, float) for e in (self.corner, self.edge_u, self.edge_v))
        lengths = np.linalg.norm([u, v], axis=1)
        n_u, n_v = (max(1, round(length / spacing)) for length in lengths)
        grid = np.stack(np.meshgrid(np.arange(n_u) + 0.5, np.arange(n_v) + 0.5), -1).reshape(-1, 2) / (
            n_u,
            n_v,
        )
        ones = np.ones((len(grid), 1))
        return Cells(corner + grid @ np.stack([u, v]), ones * u / (2 * n_u), ones * v / (2 * n_v), grid * lengths)


@dataclass(frozen=True)
class Lathe:
    """A turned body: a profile swept round an axis, with an elliptic section.

    Args:
        start: one end of the axis, (3,) [m].
        end: the other end, (3,) [m].
        profile: (along, radius) points: along the axis in [0, 1], radius [m].
        flat: radius in the third direction as a share of the full one, which is that along :data:`WIDE`, > 0.
    """

    start: ArrayLike
    end: ArrayLike
    profile: Sequence[tuple[float, float]]
    flat: float = 1.0

    def cells(self, spacing: float) -> Cells:
        """Rings of cells at equal steps of the profile's arc length."""
        start, axis = np.asarray(self.start, float), np.subtract(self.end, self.start)
        length = float(np.linalg.norm(axis))
        profile = np.asarray(self.profile, float) * (length, 1.0)  # (height, radius) [m]
        arc = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))]
        edges = np.linspace(0.0, arc[-1], max(2, round(arc[-1] / spacing)) + 1)
        heights, radii = (np.interp(edges, arc, column) for column in profile.T)
        frame = _frame(axis / length)
        rings = [_ring(h, r, self.flat, spacing) for h, r in zip(pairwise(heights), pairwise(radii))]
        flat = Cells.concatenate(rings)
        return Cells(start + flat.center @ frame, flat.half_u @ frame, flat.half_v @ frame, flat.uv)

    def scaled(self, factor: float) -> Lathe:
        """The same body ``factor`` times as large, grown from the origin."""
        profile = [(along, radius * factor) for along, radius in self.profile]
        start, end = np.multiply(self.start, factor), np.multiply(self.end, factor)
        return replace(self, start=start, end=end, profile=profile)


def _frame(axis: Array) -> Array:
    """Rows, (3, 3): the wide direction, the third one, and the unit ``axis`` (3,)."""
    wide = WIDE - axis * np.dot(axis, WIDE)
    if np.linalg.norm(wide) < 1e-6:  # the axis runs along the hint: any direction across it will do
        wide = np.cross(axis, np.roll(axis, 1))
    wide = _unit(wide)
    return np.stack([wide, np.cross(axis, wide), axis])


def _ring(heights: tuple[float, float], radii: tuple[float, float], flat: float, spacing: float) -> Cells:
    """Cells between two circles round the z axis, ``flat`` along y."""
    radius, rise = np.mean(radii), np.diff(heights)[0]
    count = max(3, int(np.ceil(2 * np.pi * radius / spacing)))
    angle = (np.arange(count) + 0.5) * 2 * np.pi / count
    out = np.stack([np.cos(angle), np.sin(angle) * flat, 0 * angle], 1)
    around = np.stack([-np.sin(angle), np.cos(angle) * flat, 0 * angle], 1)
    along = out * np.diff(radii)[0] + np.array([0, 0, rise])
    center = out * radius + np.array([0, 0, np.mean(heights)])
    uv = np.stack([angle * max(radii), np.full(count, np.mean(heights))], 1)
    return Cells(center, around * radius * np.pi / count, along / 2, uv)


def ball(center: ArrayLike, radius: float, tall: float = 1.0, flat: float = 1.0) -> Lathe:
    """An ellipsoid [m]: ``radius`` along y, ``radius * flat`` along x, ``radius * tall`` along z."""
    angle = np.linspace(0, np.pi, 17)
    profile = [((1 - np.cos(a)) / 2, radius * np.sin(a)) for a in angle]
    rise = np.array([0, 0, radius * tall])
    return Lathe(np.asarray(center, float) - rise, np.asarray(center, float) + rise, profile, flat=flat)


def capsule(start: ArrayLike, end: ArrayLike, radius: float, end_radius: float, flat: float = 1.0) -> Lathe:
    """A limb with rounded ends between two joints; ``radius`` at the start, ``end_radius`` at the end [m]."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = _unit(end - start)
    bottom, top = start - axis * radius, end + axis * end_radius
    length = np.linalg.norm(top - bottom)
    angle = np.linspace(0, np.pi / 2, 7)
    below = [(radius * (1 - np.cos(a)), radius * np.sin(a)) for a in angle]
    above = [(length - end_radius * (1 - np.cos(a)), end_radius * np.sin(a)) for a in angle[::-1]]
    return Lathe(bottom, top, [(float(h / length), float(r)) for h, r in below + above], flat=flat)


def box(low: ArrayLike, high: ArrayLike) -> list[Panel]:
    """The four sides and the top of a block that stands on something; corners in [m]."""
    x0, y0, z0 = np.asarray(low, float)
    dx, dy, dz = np.subtract(high, low)
    rise = (0.0, 0.0, dz)
    return [
        Panel((x0, y0, z0), (dx, 0, 0), rise),
        Panel((x0 + dx, y0, z0), (0, dy, 0), rise),
        Panel((x0 + dx, y0 + dy, z0), (-dx, 0, 0), rise),
        Panel((x0, y0 + dy, z0), (0, -dy, 0), rise),
        Panel((x0, y0, z0 + dz), (dx, 0, 0), (0, dy, 0)),
    ]


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
