"""A furnished room of any number of Gaussians, statistically like a trained scene, to measure renderers with."""

from __future__ import annotations

import numpy as np
import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion

from ..camera import Camera
from ..computer.array_type import Array
from ..scenes.columns import SH0
from ..scenes.splats import Splats

ROOM = np.array([8.0, 6.0, 3.0])  # [m], z up
PERSON = np.array([4.0, 3.0, 0.0])  # feet
FURNITURE = 11
FLOATERS = 0.06  # share of faint Gaussians in free air, as training leaves them


def synthetic_room(count: int, seed: int = 0, degree: int = 3) -> Splats:
    """A room of ``count`` Gaussians with a labelled figure of four balls, 1.7 m tall, in its middle.

    Args:
        count: how many, >= 100.
        seed: of everything random in it.
        degree: of the spherical harmonics, 0..3.
    """
    rng = np.random.Generator(np.random.PCG64(seed))
    floaters = int(count * FLOATERS)
    points, normals, part, spacing = _surfaces(count - floaters, rng)
    air = rng.uniform(0.02, 0.98, (floaters, 3)) * ROOM
    spread = (
        spacing
        * np.exp(rng.normal(0, 0.55, (count, 3)))
        * np.repeat([[0.75, 0.75, 0.12], [1.5, 1.5, 1.5]], [count - floaters, floaters], axis=0)
    )
    opacity = np.concatenate([rng.beta(0.7, 0.5, count - floaters), rng.beta(0.8, 12, floaters)])
    color = np.concatenate([_paint(points, part, rng), rng.uniform(0, 1, (floaters, 3))])
    sh = rng.normal(0, 0.04, (count, (degree + 1) ** 2, 3))
    sh[:, 0] = (color - 0.5) / SH0
    axes = _frames(np.concatenate([normals, rng.normal(size=(floaters, 3))]))
    order = rng.permutation(count)
    arrays = (np.concatenate([points, air]), spread, opacity.clip(0.006, 0.995), sh)
    means, scales, opacity_, sh_ = (torch.from_numpy(a[order].astype(np.float32)) for a in arrays)
    quats = rotation_matrix_to_quaternion(torch.from_numpy(axes[order].astype(np.float32)))
    label = np.concatenate([part == 0, np.zeros(floaters, bool)])[order]
    return Splats(means, scales, quats, opacity_, sh_, torch.from_numpy(label.astype(np.float32)))


def room_cameras(count: int, size: tuple[int, int], seed: int = 0) -> Camera:
    """Cameras that look at the figure from around one corner, as the candidates of a search do, (count,)."""
    rng = np.random.Generator(np.random.PCG64(seed))
    eyes = (np.array([1.6, 1.3, 1.5]) + rng.normal(0, 0.25, (count, 3))).clip(0.3, ROOM - 0.3)
    targets = PERSON + np.array([0, 0, 1.1]) + rng.normal(0, 0.3, (count, 3))
    up = torch.tensor([0.0, 0.0, 1.0])
    return Camera.look_at(torch.from_numpy(eyes), torch.from_numpy(targets), up, np.radians(39.4), size)


def _surfaces(count: int, rng: np.random.Generator) -> tuple[Array, Array, Array, float]:
    """Points and normals (N, 3), the part each lies on (0 the figure, -1 walls), and their spacing [m]."""
    figure = [
        (PERSON + np.array([0, 0, height]), radius)
        for height, radius in ((0.35, 0.18), (0.75, 0.2), (1.15, 0.24), (1.55, 0.14))
    ]
    sizes = rng.uniform(0.2, 0.5, FURNITURE)
    around = rng.uniform(0, 2 * np.pi, FURNITURE)
    places = PERSON[:2] + rng.uniform(1.2, 2.4, (FURNITURE, 1)) * np.stack([np.cos(around), np.sin(around)], 1)
    balls = figure + [(np.append(place, size), size) for place, size in zip(places, sizes)]
    # balls are what cameras look at: three times as dense as walls
    area = np.array([ROOM.prod() / ROOM[face // 2] for face in range(6)] + [3 * 4 * np.pi * r**2 for _, r in balls])
    counts = rng.multinomial(count, area / area.sum())
    points, normals, part = [], [], []
    for face in range(6):
        normal = np.eye(3)[face // 2] * (1 - 2 * (face % 2))
        at = rng.uniform(0, 1, (counts[face], 3)) * ROOM
        at[:, face // 2] = ROOM[face // 2] * (face % 2)
        points.append(at)
        normals.append(np.broadcast_to(normal, at.shape))
        part.append(np.full(len(at), -1))
    for index, (center, radius) in enumerate(balls):
        normal = rng.normal(size=(counts[6 + index], 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        points.append(center + radius * normal)
        normals.append(normal)
        part.append(np.full(len(normal), max(0, index - len(figure) + 1)))
    spacing = float(np.sqrt(area.sum() / count))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(part), spacing


def _paint(points: Array, part: Array, rng: np.random.Generator) -> Array:
    """RGB (N, 3) in [0, 1]: a tone for each part under waves of many lengths."""
    tones = rng.uniform(0.2, 0.8, (part.max() + 2, 3))
    waves = rng.normal(size=(10, 3)) * np.exp(rng.uniform(0.5, 3.2, (10, 1)))  # [rad / m]
    texture = np.sin(points @ waves.T) @ rng.normal(size=(10, 3))
    return (tones[part + 1] + 0.06 * texture).clip(0.02, 0.98)


def _frames(normals: Array) -> Array:
    """Rotations (N, 3, 3) whose third column is along ``normals``."""
    third = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    helper = np.where(np.abs(third[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, third)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(third, first), third], axis=2)
