"""Seven parameters about the subject: where the camera stands, where the subject appears, how large it is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix
from torch import Tensor

from ..camera import Camera, intrinsics, w2c_of
from ..features import Features
from ..losses.framing import centroid_difference
from ..losses.shot_size import key_joint_extents
from ..placement import frame_joints, visible_joints
from ..registry import SEARCHES
from ..subject import Subject

# azimuth, elevation, roll [rad], log(distance / height), screen x, screen y [frame], log apparent size
SCALE = torch.tensor([1.0, 0.6, 0.6, 0.8, 0.4, 0.4, 0.8], dtype=torch.float64)
AZIMUTH, ELEVATION, ROLL, DISTANCE, SIZE = 0, 1, 2, 3, 6  # columns of x
ANGLES, PLACE = slice(0, 3), slice(4, 6)

TURNING = [AZIMUTH, ROLL]  # which a whole turn leads back to the same camera
BESIDE = 6.0  # frame sizes from the frame's middle to the subject's: an eye fills the frame
# what leads past something in the way: azimuth, elevation [rad], log(distance / height), to either side
ASIDE = ((AZIMUTH, 0.05), (AZIMUTH, 0.15), (ELEVATION, 0.04), (ELEVATION, 0.08), (DISTANCE, 0.064))
# what leads over a step of the losses close by, where a camera stands: each parameter alone, to either side
NEARBY = (
    *((AZIMUTH, 0.02), (ELEVATION, 0.01), (ELEVATION, 0.02), (ROLL, 0.02), (DISTANCE, 0.03)),
    *((4, 0.006), (4, 0.012), (4, 0.025), (5, 0.006), (5, 0.012), (5, 0.025)),
    *((SIZE, 0.01), (SIZE, 0.02), (SIZE, 0.05)),
)
TOGETHER = ((0.01, 0.01, 0.02), (0.015, 0.015, 0.06))  # and place and size at once: screen x and y, log apparent size
AIM_STEPS = 8  # of the fixed point; the error halves at least with each


def _either_way(steps: Sequence[tuple[int, float]]) -> Tensor:
    """Moves (W, 7) of one parameter each, by so much and by as much the other way."""
    axis, by = torch.tensor(steps, dtype=torch.float64).unbind(1)
    moves = torch.eye(7, dtype=torch.float64)[axis.long()] * (by / SCALE[axis.long()])[:, None]
    return torch.cat([moves, -moves])


@SEARCHES.register("subject_orbit")
@dataclass(frozen=True)
class SubjectOrbit:
    """Azimuth, elevation, roll, log distance, screen x and y of the subject's middle, log apparent size.

    Apparent size is focal / distance in subject heights, so that moving in depth at one size (a dolly zoom) is one
    parameter, and size at one perspective (a zoom) another. Azimuth is 0 in front of the body.

    Args:
        nearest, farthest: distance in subject heights.
        widest, longest: focal length in frame heights (0.35 is a vertical field of view of 110 degrees).
        elevation: highest angle above or below the subject [rad]; at pi/2, straight above, the roll is undefined.
    """

    dimensions: ClassVar[int] = 7
    names: ClassVar[tuple[str, ...]] = ("azimuth", "elevation", "roll", "distance", "place", "place", "size")
    needs_subject: ClassVar[bool] = True
    bounding: ClassVar[Mapping[str, tuple[str, str]]] = {
        "elevation": ("elevation", "elevation"),
        "distance": ("nearest", "farthest"),
    }

    nearest: float = 0.3
    farthest: float = 30.0
    widest: float = 0.35
    longest: float = 20.0
    elevation: float = 1.57

    def __post_init__(self) -> None:
        if not 0 < self.nearest < self.farthest:
            raise ValueError(f"expected 0 < nearest < farthest, got {self.nearest} and {self.farthest}")
        if not 0 < self.widest < self.longest:
            raise ValueError(f"expected 0 < widest < longest, got {self.widest} and {self.longest}")
        if not 0 < self.elevation < math.pi / 2:
            raise ValueError(f"expected elevation in (0, pi/2), got {self.elevation}")

    def bounds(self) -> tuple[Tensor, Tensor]:
        """Azimuth and roll are free, they wrap; the subject's middle may stand outside the frame.

        In a close-up of the face it stands below, by almost half of the person's height on screen.
        """
        low = [-math.inf, -self.elevation, -math.inf, math.log(self.nearest), -BESIDE, -BESIDE, math.log(0.02)]
        high = [math.inf, self.elevation, math.inf, math.log(self.farthest), BESIDE, BESIDE, math.log(50.0)]
        return torch.tensor(low, dtype=torch.float64) / SCALE, torch.tensor(high, dtype=torch.float64) / SCALE

    @property
    def lens(self) -> Tensor:
        """Direction (7,) along which the log of the focal length changes: apparent size times distance."""
        direction = torch.zeros(7, dtype=torch.float64)
        direction[[DISTANCE, SIZE]] = SCALE[[DISTANCE, SIZE]]
        return direction

    @property
    def aside(self) -> Tensor:
        """Moves (W, 7) by which the camera goes a little aside, or nearer or farther at the same size."""
        return _either_way(ASIDE)

    @property
    def nearby(self) -> Tensor:
        """Moves (W, 7) to views that hardly differ: what they cost differs where a loss has a step between them."""
        signs = torch.cartesian_prod(*[torch.tensor([-1.0, 1.0], dtype=torch.float64)] * 3)  # (8, 3)
        together = torch.zeros(len(TOGETHER) * len(signs), 7, dtype=torch.float64)
        together[:, 4:] = torch.cat([signs * torch.tensor(by, dtype=torch.float64) for by in TOGETHER]) / SCALE[4:]
        return torch.cat([_either_way(NEARBY), together])

    def cameras(self, x: Tensor, home: Camera, subject: Subject | None) -> Camera:
        """B cameras of x (B, 7) or (B, 6)."""
        subject = _required(subject)
        p = x.double() * SCALE[: x.shape[1]]
        heights = p[:, DISTANCE].clamp(math.log(self.nearest), math.log(self.farthest)).exp()
        if p.shape[1] == self.dimensions:
            focal = (p[:, SIZE].exp() * heights).clamp(self.widest, self.longest)  # :meth:`limited`
        else:
            focal = (home.focal / home.size[1]).expand(len(p))
        outward = _direction(p[:, AZIMUTH], p[:, ELEVATION].clamp(-self.elevation, self.elevation), subject)
        aimed = _aimed(outward, subject.up)
        aspect = home.size[0] / home.size[1]
        x_place, y_place = p[:, PLACE].unbind(1)
        R = _place(x_place, y_place, focal, aspect) @ _roll(p[:, ROLL]) @ aimed
        center = subject.anchor + heights[:, None] * subject.height * outward
        return Camera(w2c_of(R, center), intrinsics(focal * home.size[1], home.size), home.size)

    def limited(self, x: Tensor) -> Tensor:
        """Which of x (B, 7) or (B, 6) ask for a shorter or longer lens than there is, (B,) bool."""
        if x.shape[1] < self.dimensions:
            return torch.zeros(len(x), dtype=torch.bool)
        focal = (x.double() @ self.lens).exp()
        return (focal < self.widest) | (focal > self.longest)

    def aimed(self, x: Tensor, home: Camera, subject: Subject | None, reference: Features) -> Tensor:
        """The x (B, D) moved so that the subject appears where and as large as in ``reference``, B frames or one.

        A fixed point on projected joints, nothing is rendered: screen x and y follow the centroid, and the lens (or,
        where x has none, the distance) follows the size. Fewer than two key joints tell no size, and none no place;
        then all 14 joints do, as far as they are seen. A single joint tells no size; without any x is unchanged.
        """
        subject, x = _required(subject), x.double().clone()
        few, every = subject.key_joints, torch.cat([subject.joints, subject.confidence[:, None]], dim=1)
        keys, all_seen = _seen(reference, few, "key", len(x)), _seen(reference, every, "all", len(x))
        shown = keys[..., 2].sum(1)  # (B,)
        for here, joints, place, sized_by, extent in (
            (shown > 1, few, keys, few, keys),
            (shown == 1, few, keys, every, all_seen),
            (shown == 0, every, all_seen, every, all_seen),
        ):
            if here.any():
                x[here] = self._moved(x[here], home, subject, (joints, place[here]), (sized_by, extent[here]))
        return x

    def _moved(
        self, x: Tensor, home: Camera, subject: Subject, place: tuple[Tensor, Tensor], extent: tuple[Tensor, Tensor]
    ) -> Tensor:
        """The x (B, D) placed and sized by joints (J, 4) of the scene each, as seen in B frames, (B, J, 3)."""
        size, sign = (SIZE, 1.0) if x.shape[1] == self.dimensions else (DISTANCE, -1.0)
        for _ in range(AIM_STEPS):
            cameras = self.cameras(x, home, subject)
            offset = torch.nan_to_num(centroid_difference(place[1], _as_seen(*place, cameras))).clamp(-0.3, 0.3)
            d_ref, d_S = key_joint_extents(extent[1], _as_seen(*extent, cameras))  # NaN where fewer than two are seen
            growth = torch.nan_to_num(torch.log(d_ref / d_S.clamp_min(1e-3))).clamp(-0.7, 0.7)
            x[:, PLACE] -= offset / SCALE[PLACE]
            x[:, size] += sign * growth / SCALE[size]
        return x

    def turned(self, x: Tensor, to: Tensor) -> Tensor:
        """The same cameras as x (B, D), azimuth and roll moved by whole turns next to those of ``to`` (D,)."""
        turn = 2 * math.pi / SCALE[TURNING]
        whole = torch.zeros_like(x)
        whole[:, TURNING] = ((to[TURNING] - x[:, TURNING]) / turn).round() * turn
        return x + whole

    def vector(self, camera: Camera, home: Camera, subject: Subject | None) -> Tensor:
        """x (B, 7), azimuth in (-pi, pi]; exact for cameras that have the subject in front of them.

        One that has it behind is turned to it where it stands, and keeps which way is up in its frame.
        """
        subject = _required(subject)
        offset = camera.center - subject.anchor
        distance = offset.norm(dim=1)
        outward = offset / distance[:, None]
        azimuth = torch.atan2(outward @ subject.left, outward @ subject.facing)
        elevation = torch.asin((outward @ subject.up).clamp(-1, 1))
        heights = distance / subject.height
        focal = camera.focal / camera.size[1]
        seen, depth = (told[:, 0] for told in camera.project(subject.anchor[None]))
        behind = depth <= 0
        screen = seen / torch.tensor(camera.size, dtype=torch.float64) - 0.5
        screen = torch.where(behind[:, None], 0.0, screen)
        aspect = camera.size[0] / camera.size[1]
        place = _place(screen[:, 0], screen[:, 1], focal, aspect)
        turn = place.transpose(1, 2) @ camera.w2c[:, :3, :3] @ _aimed(outward, subject.up).transpose(1, 2)
        roll = torch.atan2(turn[:, 1, 0], turn[:, 0, 0])
        upwards = camera.w2c[:, :3, :3] @ subject.up
        roll = torch.where(behind, torch.atan2(upwards[:, 0], -upwards[:, 1]), roll)
        lens = torch.log(focal / heights)
        return torch.stack([azimuth, elevation, roll, heights.log(), *screen.unbind(1), lens], dim=1) / SCALE


def _seen(reference: Features, joints: Tensor, which: Literal["key", "all"], frames: int) -> Tensor:
    """Joints (frames, J, 3) as x/W, y/H and 1; 0 where a frame does not show, or the scene not know, that joint."""
    shown = frame_joints(reference, which).double().expand(frames, -1, -1)
    return torch.cat([shown[..., :2], (visible_joints(shown) & (joints[:, 3] > 0)).double()[..., None]], dim=-1)


def _as_seen(joints: Tensor, seen: Tensor, cameras: Camera) -> Tensor:
    """The scene's ``joints`` (J, 4) from B cameras, where they are ``seen`` (B, J, 3) in the reference, (B, J, 3)."""
    pixels = cameras.project(joints[:, :3])[0] / torch.tensor(cameras.size, dtype=torch.float64)
    return torch.cat([pixels, seen[..., 2:]], dim=-1)


def _required(subject: Subject | None) -> Subject:
    if subject is None:
        raise ValueError("subject_orbit needs a lifted subject; lift the scene or use paper_box")
    return subject


def _direction(azimuth: Tensor, elevation: Tensor, subject: Subject) -> Tensor:
    """Unit vectors (B, 3) from the subject to the camera."""
    flat = torch.sin(azimuth)[:, None] * subject.left + torch.cos(azimuth)[:, None] * subject.facing
    return torch.cos(elevation)[:, None] * flat + torch.sin(elevation)[:, None] * subject.up


def _aimed(outward: Tensor, up: Tensor) -> Tensor:
    """World-to-camera rotations (B, 3, 3) that look along -outward with ``up`` upwards."""
    forward = -outward
    right = torch.nn.functional.normalize(torch.linalg.cross(forward, up.expand_as(forward)), dim=1)
    return torch.stack([right, torch.linalg.cross(forward, right), forward], dim=1)


def _roll(angle: Tensor) -> Tensor:
    """Rotations (B, 3, 3) about the optical axis; a positive angle leans the subject to the right."""
    axis = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    return axis_angle_to_rotation_matrix(angle[:, None] * axis)


def _place(x: Tensor, y: Tensor, focal: Tensor, aspect: float) -> Tensor:
    """Rotations (B, 3, 3) that bring what was in the middle to (x W, y H) from it."""
    ray = torch.stack([x * aspect / focal, y / focal, torch.ones_like(x)], dim=1)
    ray = ray / ray.norm(dim=1, keepdim=True)
    axis = torch.stack([-ray[:, 1], ray[:, 0], torch.zeros_like(x)], dim=1)  # z cross ray
    sine = axis.norm(dim=1, keepdim=True)
    angle = torch.atan2(sine, ray[:, 2:])
    return axis_angle_to_rotation_matrix(axis / sine.clamp_min(1e-12) * angle)
