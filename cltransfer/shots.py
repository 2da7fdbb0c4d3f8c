"""Canonical camera moves about a subject, in units of the subject's height, with known labels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix
from torch import Tensor

from .camera import Camera, intrinsics
from .errors import UsageError
from .scenes import Scene
from .subject import Subject
from .trajectory import Trajectory


@dataclass(frozen=True)
class Setup:
    """Where a shot starts. What is None is the shot's own choice.

    Args:
        azimuth: 0 in front of the subject, growing to the subject's left [rad].
        elevation: above the subject's middle, in (-pi/2, pi/2) [rad].
        distance: from the point that is aimed at [subject heights], > 0.
        coverage: the subject's height on screen [frame heights], > 0.
        offset: where the point that is aimed at stands, right and down of the frame's middle [frame sizes].
        seed: for moves that are random (handheld).
        aim: the point that is aimed at, above the subject's middle [subject heights]: 0.4 is the face.
        reach: share of the shot's pan, tilt and truck that is made, > 0: in a close-up the whole would lose the face.
    """

    azimuth: float = math.radians(30)
    elevation: float = math.radians(6)
    distance: float | None = None
    coverage: float | None = None
    offset: tuple[float, float] = (0.0, 0.0)
    seed: int = 0
    aim: float = 0.0
    reach: float = 1.0

    def __post_init__(self) -> None:
        if not abs(self.elevation) < math.pi / 2:
            raise ValueError(f"elevation must lie in (-pi/2, pi/2), got {self.elevation}")
        for name in ("distance", "coverage", "reach"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"{name} must be positive, got {value}")

    @classmethod
    def drawn(cls, rng: np.random.Generator, seed: int) -> Setup:
        """Within 50 degrees of the face, up to 12 above; off the middle by up to 0.12 in width, 0.05 in height."""
        azimuth, elevation = math.radians(rng.uniform(-50, 50)), math.radians(rng.uniform(0, 12))
        offset = (float(rng.uniform(-0.12, 0.12)), float(rng.uniform(-0.05, 0.05)))
        return cls(azimuth, elevation, offset=offset, seed=seed)


@dataclass(frozen=True)
class Moves:
    """What a shot does over N frames, each a (N,) float64 change against its start.

    Args:
        dolly: distance against the start, factor; the subject keeps its place in the frame.
        follow: focal length that goes with the distance, factor.
        zoom: focal length alone, factor; the camera stands still.
        azimuth, elevation: round the subject [rad].
        truck, boom: to the right and upwards [subject heights]; ``boom`` keeps aiming, ``truck`` does not.
        pan, tilt, roll: of the camera itself: to the right, upwards, and the body leaning right [rad].
    """

    dolly: Tensor
    follow: Tensor
    zoom: Tensor
    azimuth: Tensor
    elevation: Tensor
    truck: Tensor
    boom: Tensor
    pan: Tensor
    tilt: Tensor
    roll: Tensor


Program = Callable[[Tensor, int], dict[str, Tensor]]  # progress (N,) in [0, 1], seed -> changes


def ease(progress: Tensor) -> Tensor:
    """Smooth start and stop of a move: 0 at 0, 1 at 1, no speed at either end.

    >>> ease(torch.tensor([0.0, 0.25, 0.5, 1.0]))
    tensor([0.0000, 0.1562, 0.5000, 1.0000])
    """
    return progress**2 * (3 - 2 * progress)


def _crash_zoom(progress: Tensor, seed: int) -> dict[str, Tensor]:
    """x1 to x3 within a quarter of the clip (6 of 24 frames), in its middle."""
    return {"zoom": 3 ** ease(((progress - 0.375) * 4).clamp(0, 1))}


def _dolly_zoom(progress: Tensor, seed: int) -> dict[str, Tensor]:
    """2.2 to 5 heights away while the focal length grows as much: f = f0 D / D0."""
    away = 1 + (5 / 2.2 - 1) * ease(progress)
    return {"dolly": away, "follow": away}


def _handheld(progress: Tensor, seed: int) -> dict[str, Tensor]:
    """A person holding the camera: a few slow sines per axis, with phases from ``seed``."""
    generator = torch.Generator().manual_seed(seed)
    cycles = torch.tensor([0.7, 1.6, 2.9], dtype=torch.float64)
    strength = torch.tensor([1.0, 0.5, 0.25], dtype=torch.float64)

    def sway(size: float) -> Tensor:
        phase = 2 * math.pi * torch.rand(3, generator=generator, dtype=torch.float64)
        return size * (strength * torch.sin(2 * math.pi * cycles * progress[:, None] + phase)).sum(1)

    sizes = {"pan": 0.014, "tilt": 0.010, "roll": 0.008, "truck": 0.02, "boom": 0.015}
    return {**{name: sway(size) for name, size in sizes.items()}, "dolly": 1 + sway(0.006)}


def _sweep(start: float, end: float) -> Callable[[Tensor], Tensor]:
    return lambda progress: start + (end - start) * ease(progress)


def _moving(**changes: tuple[float, float]) -> Program:
    """A program whose changes are eased from one value to another."""
    sweeps = {name: _sweep(*span) for name, span in changes.items()}
    return lambda progress, seed: {name: sweep(progress) for name, sweep in sweeps.items()}


_DEG = math.pi / 180

# name: distance [subject heights], coverage [frame heights], program
_SHOTS: dict[str, tuple[float, float, Program]] = {
    "push_in": (4.0, 0.45, _moving(dolly=(1.0, 0.5))),
    "pull_out": (2.0, 0.90, _moving(dolly=(1.0, 2.0))),
    "pan": (2.8, 0.50, _moving(pan=(-20 * _DEG, 20 * _DEG))),
    "tilt": (2.8, 0.42, _moving(tilt=(-12 * _DEG, 12 * _DEG))),
    "orbit": (2.8, 0.65, _moving(azimuth=(0.0, 60 * _DEG))),
    "zoom": (3.5, 0.45, _moving(zoom=(1.0, 2.0))),
    "crash_zoom": (3.5, 0.36, _crash_zoom),
    "dolly_zoom": (2.2, 0.72, _dolly_zoom),
    "dutch": (2.8, 0.60, _moving(roll=(0.0, 20 * _DEG), dolly=(1.0, 0.9))),
    "boom": (2.8, 0.62, _moving(boom=(-0.25, 0.75))),
    "truck": (2.8, 0.60, _moving(truck=(-0.4, 0.4))),
    "static": (2.8, 0.60, _moving()),
    "handheld": (2.8, 0.62, _handheld),
}
SHOTS = tuple(_SHOTS)
_NEUTRAL = {"dolly": 1.0, "follow": 1.0, "zoom": 1.0}


def shot(
    name: str,
    subject: Subject,
    size: tuple[int, int],
    frames: int = 24,
    fps: float = 12.0,
    setup: Setup | None = None,
) -> Trajectory:
    """Canonical shot ``name`` about ``subject``.

    Args:
        name: one of :data:`SHOTS`.
        subject: who is filmed; its middle is aimed at, its height is the unit of length.
        size: (W, H) [px].
        frames: N, > 0.
        fps: frames per second, > 0.
        setup: where the shot starts; None is the shot's own start.

    Raises:
        UsageError: there is no such shot.
        ValueError: ``frames`` or ``fps`` is not positive.
    """
    own = own_setup(name)
    if frames < 1 or not fps > 0:
        raise ValueError(f"frames and fps must be positive, got {frames}, {fps}")
    setup = setup or own
    setup = replace(setup, distance=setup.distance or own.distance, coverage=setup.coverage or own.coverage)
    progress = torch.linspace(0, 1, frames, dtype=torch.float64)
    still = {n: torch.full((frames,), _NEUTRAL.get(n, 0.0), dtype=torch.float64) for n in Moves.__annotations__}
    moves = Moves(**{**still, **_SHOTS[name][2](progress, setup.seed)})
    moves = replace(moves, **{n: setup.reach * getattr(moves, n) for n in ("pan", "tilt", "truck")})
    return Trajectory(cameras(subject, size, setup, moves), torch.arange(frames, dtype=torch.float64) / fps)


def own_setup(name: str) -> Setup:
    """Where shot ``name`` starts by itself, with its distance and coverage.

    Raises:
        UsageError: there is no such shot.
    """
    if name not in _SHOTS:
        raise UsageError("", f"shot {name!r}", "no such shot", f"known: {', '.join(SHOTS)}")
    distance, coverage, _ = _SHOTS[name]
    return Setup(distance=distance, coverage=coverage)


def cameras(subject: Subject, size: tuple[int, int], setup: Setup, moves: Moves) -> Camera:
    """N cameras that do ``moves`` from ``setup``, whose distance and coverage are given.

    Raises:
        ValueError: ``setup`` has no distance or no coverage.
    """
    if setup.distance is None or setup.coverage is None:
        raise ValueError("setup needs a distance and a coverage; shot() fills in its own")
    h = subject.height
    anchor = subject.anchor + setup.aim * h * subject.up
    distance = setup.distance * h * moves.dolly
    focal = setup.coverage * size[1] * setup.distance * moves.follow  # [px]: f = coverage H D / h
    eye = anchor + distance[:, None] * _direction(
        subject, setup.azimuth + moves.azimuth, setup.elevation + moves.elevation
    )
    lifted = eye + moves.boom[:, None] * h * subject.up
    aimed = Camera.look_at(lifted, anchor, subject.up, 1.0, size)
    # moved sideways, not turned, to put the subject off centre: then no distance changes its size or place
    aside = torch.stack([
        moves.truck * h - setup.offset[0] * size[0] * distance / focal,
        -setup.offset[1] * size[1] * distance / focal,
        torch.zeros_like(distance),
    ], 1)  # fmt: skip
    w2c = aimed.w2c.clone()
    w2c[:, :3, 3] -= aside
    turn = torch.eye(4, dtype=torch.float64).repeat(len(w2c), 1, 1)
    turn[:, :3, :3] = _turn(moves)
    return Camera(turn @ w2c, intrinsics(focal * moves.zoom, size), size)


def _direction(subject: Subject, azimuth: Tensor, elevation: Tensor) -> Tensor:
    """Unit vectors (N, 3) from the subject towards cameras."""
    level = azimuth.cos()[:, None] * subject.facing + azimuth.sin()[:, None] * subject.left
    return elevation.cos()[:, None] * level + elevation.sin()[:, None] * subject.up


def _turn(moves: Moves) -> Tensor:
    """Rotations (N, 3, 3) of camera coordinates by pan, then tilt, then roll."""
    axes = torch.eye(3, dtype=torch.float64)
    pan, tilt, roll = (
        axis_angle_to_rotation_matrix(angle[:, None] * axis)
        for angle, axis in ((-moves.pan, axes[1]), (-moves.tilt, axes[0]), (moves.roll, axes[2]))
    )
    return roll @ tilt @ pan


def builtin_reference(name: str, size: tuple[int, int], frames: int = 24) -> tuple[Scene, Trajectory]:
    """Shot ``name`` filmed in the built-in plaza: three-quarter front view, slightly from above.

    Raises:
        UsageError: there is no such shot.
    """
    from .scenes.builtin import builtin_scene

    scene = builtin_scene("plaza")
    start = Setup(azimuth=-20 * _DEG if name == "orbit" else 30 * _DEG)
    return scene, shot(name, scene.person, size, frames, setup=start)
