"""A camera for every frame, with its time: what a transfer finds and other programs take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from kornia.geometry.conversions import rotation_matrix_to_axis_angle
from torch import Tensor

from .along_clip import check_times
from .camera import Camera, w2c_of
from .errors import InputError
from .storage.files import read_json, write_json

FORMAT = "cltransfer.trajectory"  # what its file calls itself
FRAME_LIMIT = 2000
SIZE_LIMIT = 16384  # [px]
FARTHEST = 1e12  # scene units of a camera from the origin: single precision holds the square
SHORTEST_LENS, LONGEST_LENS = 1e-6, 1e9  # [px] of a focal length; the latter of the middle's place too


@dataclass(frozen=True, eq=False)
class Trajectory:
    """N cameras over time.

    Args:
        camera: N cameras that share one size.
        times: (N,) [s], kept as float64 on the CPU, strictly increasing.

    Raises:
        ValueError: there are not as many times as cameras, or they do not increase.
    """

    camera: Camera
    times: Tensor  # (N,) [s]

    def __post_init__(self) -> None:
        if tuple(self.times.shape) != (len(self.camera),):
            raise ValueError(f"times must be ({len(self.camera)},), got {tuple(self.times.shape)}")
        if not bool((self.times[1:] > self.times[:-1]).all()):
            raise ValueError("times must increase strictly")
        object.__setattr__(self, "times", self.times.to("cpu", torch.float64))

    def __len__(self) -> int:
        return len(self.camera)

    @property
    def fps(self) -> float:
        """Frames per second on average; 24 for a single frame."""
        if len(self) < 2:
            return 24.0
        return float((len(self) - 1) / (self.times[-1] - self.times[0]))

    def at(self, times: Tensor) -> Trajectory:
        """The path at other moments: smoothly through its cameras, by centre, rotation and log focal length.

        By cubic splines whose slopes are limited: a camera that holds still before a move and after it does so between
        its frames too, where a plain spline would wind up and swing past the end.

        Args:
            times: (M,) float64 [s], strictly increasing, within those of the path.

        Raises:
            ValueError: a time is outside the path.

        No gradient goes through it.
        """
        if not self.times[0] <= times.min() <= times.max() <= self.times[-1]:
            span = f"{float(self.times[0]):g} to {float(self.times[-1]):g} s"
            raise ValueError(f"times must be within {span}, got {float(times.min()):g} to {float(times.max()):g}")
        if len(self) == 1:
            return self
        camera = Camera(self.camera.w2c.detach(), self.camera.K.detach(), self.camera.size)
        focal = camera.K[:, [0, 1], [0, 1]].log()
        R = self._turned(camera.w2c[:, :3, :3], times)
        center, focal, middle = (_between(self.times, v, times) for v in (camera.center, focal, camera.K[:, :2, 2]))
        K = camera.K[:1].repeat(len(times), 1, 1)
        K[:, [0, 1], [0, 1]], K[:, :2, 2] = focal.exp(), middle
        return Trajectory(Camera(w2c_of(R, center), K, camera.size), times)

    def _turned(self, R: Tensor, times: Tensor) -> Tensor:
        """Rotations (N, 3, 3) of the frames at other moments, (M, 3, 3): by their quaternions, the short way round."""
        from scipy.spatial.transform import Rotation, Slerp

        known = Rotation.from_matrix(R.numpy())
        if len(R) == 2:
            return torch.from_numpy(Slerp(self.times.numpy(), known)(times.numpy()).as_matrix())
        quaternions = torch.from_numpy(known.as_quat())
        alike = (quaternions[1:] * quaternions[:-1]).sum(1) >= 0  # q and -q are one rotation
        signs = torch.cat([alike.new_ones(1), alike]).double() * 2 - 1
        found = _between(self.times, quaternions * signs.cumprod(0)[:, None], times)
        return torch.from_numpy(Rotation.from_quat(found.numpy()).as_matrix())  # which makes them of length 1

    def to_json(self) -> dict[str, Any]:
        """Plain values, with the convention written beside them."""
        frames = [
            {"time": float(t), "w2c": w.tolist(), "K": k.tolist()}
            for t, w, k in zip(self.times, self.camera.w2c, self.camera.K)
        ]
        return {
            "format": FORMAT,
            "version": 1,
            "convention": "w2c rows first, OpenCV axes (x right, y down, z forward), K in pixels of size, corner at 0",
            "size": list(self.camera.size),
            "frames": frames,
        }

    def save(self, path: str | Path) -> None:
        """Write ``trajectory.json``, whole or not at all."""
        write_json(Path(path), self.to_json())

    @classmethod
    def load(cls, path: str | Path) -> Trajectory:
        """Read ``trajectory.json``.

        Raises:
            InputError: the file or a field is missing, or one is of the wrong shape or range, not rigid, skewed or not
                finite.
        """
        path = Path(path)
        data = read_json(path)
        if not isinstance(data, Mapping) or data.get("format") != FORMAT:
            raise InputError(path, "format", f"expected {FORMAT!r}")
        frames = data.get("frames")
        if not isinstance(frames, list) or not 1 <= len(frames) <= FRAME_LIMIT:
            raise InputError(path, "frames", f"expected a list of 1 to {FRAME_LIMIT} frames")
        size = _size(path, data.get("size"))
        try:
            w2c = torch.tensor([f["w2c"] for f in frames], dtype=torch.float64)
            K = torch.tensor([f["K"] for f in frames], dtype=torch.float64)
            times = torch.tensor([f["time"] for f in frames], dtype=torch.float64)
            trajectory = cls(Camera(w2c, K, size), times)
        except (KeyError, TypeError, ValueError, OverflowError, RuntimeError) as error:
            raise InputError(path, "frames", f"not a trajectory: {error}") from None
        trajectory._check(path)
        return trajectory

    def _check(self, path: Path) -> None:
        R = self.camera.w2c[:, :3, :3]
        rigid = (R @ R.transpose(1, 2) - torch.eye(3, dtype=R.dtype)).abs().amax() < 1e-4
        if not bool(torch.isfinite(self.camera.w2c).all() and torch.isfinite(self.camera.K).all()):
            raise InputError(path, "w2c, K", "expected finite numbers")
        check_times(path, "time", self.times)
        for name, rows, last in (("w2c", self.camera.w2c, (0, 0, 0, 1)), ("K", self.camera.K, (0, 0, 1))):
            if not torch.allclose(rows[:, -1], torch.tensor(last, dtype=rows.dtype), rtol=0, atol=1e-9):
                raise InputError(path, name, f"expected {' '.join(map(str, last))} as the last row")
        if not bool(rigid and (torch.linalg.det(R) > 0).all()):
            raise InputError(path, "w2c", "expected rotations", "a scaled or mirrored pose cannot be rendered")
        if float(self.camera.w2c[:, :3, 3].abs().max()) > FARTHEST:
            raise InputError(path, "w2c", f"expected cameras within {FARTHEST:.0e} scene units of the origin")
        focal, middle = self.camera.K[:, [0, 1], [0, 1]], self.camera.K[:, :2, 2]
        if not SHORTEST_LENS <= float(focal.min()) <= float(focal.max()) <= LONGEST_LENS:
            raise InputError(path, "K", f"expected focal lengths of {SHORTEST_LENS:.0e} to {LONGEST_LENS:.0e} px")
        if float(middle.abs().max()) > LONGEST_LENS:
            raise InputError(path, "K", f"expected a principal point within {LONGEST_LENS:.0e} px of the corner")
        if bool(self.camera.K[:, [0, 1], [1, 0]].any()):
            raise InputError(path, "K", "expected no skew: K[0][1] and K[1][0] are 0")


def _size(path: Path, value: Any) -> tuple[int, int]:
    """Width and height [px] of what a file says."""
    pair = isinstance(value, list) and len(value) == 2
    if not pair or not all(type(v) in (int, float) and 1 <= v <= SIZE_LIMIT and v == int(v) for v in value):
        expected = f"expected a width and a height, whole numbers in [1, {SIZE_LIMIT}]"
        raise InputError(path, "size", f"{expected}, got {value!r}")
    return int(value[0]), int(value[1])


def jerk(camera: Camera, height: float) -> float:
    """Root mean square third difference of N cameras from frame to frame: position, rotation and log focal length.

    One number of [subject heights], [rad] and log per frame cubed; NaN for fewer than four frames.
    """
    if len(camera) < 4:
        return float("nan")
    R = camera.w2c[:, :3, :3]
    turns = rotation_matrix_to_axis_angle(R[1:] @ R[:-1].transpose(1, 2))  # (N - 1, 3) [rad]
    thirds: list[Tensor] = [
        (camera.center / height).diff(dim=0).diff(dim=0).diff(dim=0),
        turns.diff(dim=0).diff(dim=0),
        camera.focal.log()[:, None].diff(dim=0).diff(dim=0).diff(dim=0),
    ]
    return float(torch.cat(thirds, dim=1).pow(2).sum(1).mean().sqrt())


def _between(knots: Tensor, values: Tensor, times: Tensor) -> Tensor:
    """Values (N, D) of N moments at M others, (M, D): a cubic spline that is nowhere much faster than its moments.

    Its speed at each is limited to three times that of the slower of the straight lines on either side, and is none
    where it would go against both, as Hyman (1983) does for one dimension: what holds still goes on to, and what creeps
    after a fast move does not go back.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    slopes = torch.from_numpy(CubicSpline(knots.numpy(), values.numpy(), bc_type="natural")(knots.numpy(), 1))
    lines = values.diff(dim=0) / knots.diff()[:, None]  # (N - 1, D)
    before, after = torch.cat([lines[:1], lines]), torch.cat([lines, lines[-1:]])  # (N, D)
    most, speed = 3 * torch.minimum(before.norm(dim=1), after.norm(dim=1)), slopes.norm(dim=1)
    against = ((slopes * before).sum(1) < 0) & ((slopes * after).sum(1) < 0)
    limited = slopes * torch.where(against, 0.0, torch.where(speed > most, most / speed, 1.0))[:, None]
    return torch.from_numpy(CubicHermiteSpline(knots.numpy(), values.numpy(), limited.numpy())(times.numpy()))
