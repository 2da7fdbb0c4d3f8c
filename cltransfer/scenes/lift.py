"""Lift the person out of a scene: find, look from all sides, triangulate, label. Done once a scene.

Everything is measured on renders by the image extractors; nothing is assumed about how the scene was made, except
which way is up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..errors import InputError
from ..features import Features
from ..skeleton import JOINTS, VISIBLE
from ..subject import Subject
from . import Scene
from .triangulate import Triangulated, triangulate
from .vote import vote_labels

SIZE = (640, 360)  # [px] of the views
FOV = math.radians(40)
AGREE = 0.0125  # reprojection error of a view that agrees, in frame widths
MINIMUM_VIEWS = 3
FILL = 0.62  # of the frame height that the person takes in the views
NEAR_VIEWS, FAR_VIEWS = 0.12, 0.38  # elevations of the ring [rad]

# joints whose distance is a known share of the standing height, longest first
_STATURE = (("head_top", "ankle", 0.955), ("head_top", "knee", 0.72), ("head_top", "hip", 0.47), ("neck", "hip", 0.29))


@dataclass(frozen=True)
class JointReport:
    """How well one joint is known.

    Args:
        views: views in which the pose network saw it.
        agreed: views within the tolerance of the triangulated point.
        error: median reprojection error of the views that agreed, in frame widths; NaN where the joint is unknown.
    """

    views: int
    agreed: int
    error: float


@dataclass(frozen=True)
class Lift:
    """A lifted person.

    Args:
        subject: joints, facing, up, height.
        label: membership of each primitive of the geometry, (N,) in {0, 1}.
        cameras: the views.
        features: what the image extractors saw in them.
        found: views with a person.
        joints: report by joint name.
    """

    subject: Subject
    label: Tensor  # (N,)
    cameras: Camera
    features: Features
    found: int
    joints: dict[str, JointReport]


Look = Callable[[Camera], Features]


def lift(scene: Scene, look: Look, views: int = 16, given: Camera | None = None) -> Lift:
    """Lift the person of ``scene``.

    Args:
        scene: any geometry that has ``means`` to vote on.
        look: renders cameras and reads them: box, keypoints, subject, orientation, depth.
        views: how many to look from.
        given: views to use instead of a ring of our own.

    Raises:
        InputError: no person is found, or too few views agree on any joint.
    """
    if given is None:
        center, height = _find(scene, look)
        given = ring(center, height, scene.up, views)
    seen = look(given)
    found = torch.isfinite(seen.require("box")[:, 0])
    if int(found.sum()) < MINIMUM_VIEWS:
        reason = f"a person in {int(found.sum())} of {len(given)} views"
        raise InputError(scene.name, "lift", reason, "give views that show one: --view FILE")
    points = _joints(given, seen)
    subject = _subject(scene, given, seen, points)
    label = vote_labels(scene.geometry.means.double(), given, seen, subject)
    report = {name: _report(point, given.size[0]) for name, point in zip(JOINTS, points)}
    return Lift(subject, label, given, seen, int(found.sum()), report)


def ring(center: Tensor, height: float, up: Tensor, views: int) -> Camera:
    """Views around ``center`` (3,) in which a person of ``height`` fills a good part of the frame.

    Two elevations by turns: low for faces and feet, higher to see over what stands before the legs.
    """
    distance = height / FILL / (2 * math.tan(FOV / 2))
    azimuth = torch.arange(views, dtype=torch.float64) * (2 * math.pi / views)
    elevation = torch.full((views,), NEAR_VIEWS, dtype=torch.float64)
    elevation[1::2] = FAR_VIEWS
    side, front = _level_axes(up)
    flat = torch.cos(azimuth)[:, None] * front + torch.sin(azimuth)[:, None] * side
    outward = torch.cos(elevation)[:, None] * flat + torch.sin(elevation)[:, None] * up
    return Camera.look_at(center + distance * outward, center[None], up, FOV, SIZE)


def _level_axes(up: Tensor) -> tuple[Tensor, Tensor]:
    helper = torch.eye(3, dtype=torch.float64)[int(up.abs().argmin())]
    side = torch.nn.functional.normalize(torch.linalg.cross(up.double(), helper), dim=0)
    return side, torch.linalg.cross(side, up.double())


def _find(scene: Scene, look: Look) -> tuple[Tensor, float]:
    """Middle and height of the person, from boxes in wide views, then in nearer ones."""
    means = scene.geometry.means.double()
    center = means.median(0).values
    reach = float(torch.quantile((means - center)[:: max(1, len(means) // 10**5)].norm(dim=1), 0.9))
    best: tuple[int, Tensor, float] | None = None
    for share in (0.5, 0.9, 1.6):
        got = _measure(ring(center, share * reach, scene.up, 12), look)
        if got is not None and (best is None or got[0] > best[0]):
            best = got
    if best is None:
        hint = "is another way up? --up X,Y,Z, or give views: --view FILE"
        raise InputError(scene.name, "lift", "no person found in any view", hint)
    for _ in range(2):
        closer = _measure(ring(best[1], best[2], scene.up, 8), look)
        best = closer if closer is not None else best
    return best[1], best[2]


def _measure(cameras: Camera, look: Look) -> tuple[int, Tensor, float] | None:
    """Views that agree on a person, its middle and its height; None where fewer than two do."""
    box = look(cameras).require("box").double()
    seen = torch.isfinite(box[:, 0])
    middle = box[:, :2] + box[:, 2:4] / 2
    point = triangulate(cameras, middle, seen, 0.04 * cameras.size[0])
    if int(point.agreed.sum()) < 2:
        return None
    depth = cameras.project(point.point[None])[1][:, 0]
    height = (box[:, 3] * depth / cameras.focal)[point.agreed].median()
    return int(point.agreed.sum()), point.point, float(height)


def _joints(cameras: Camera, seen: Features) -> list[Triangulated]:
    keypoints = seen.require("keypoints").double()
    points = []
    for j in range(len(JOINTS)):
        sure = keypoints[:, j, 2] > VISIBLE
        point = triangulate(cameras, keypoints[:, j, :2], sure, AGREE * cameras.size[0])
        enough = int(point.agreed.sum()) >= MINIMUM_VIEWS
        points.append(point if enough else Triangulated(point.point * math.nan, point.agreed, point.error))
    return points


def _subject(scene: Scene, cameras: Camera, seen: Features, points: Sequence[Triangulated]) -> Subject:
    joints = torch.stack([p.point for p in points])
    known = torch.isfinite(joints[:, 0])
    if int(known.sum()) < 4:
        reason = f"{int(known.sum())} joints that {MINIMUM_VIEWS} views agree on"
        raise InputError(scene.name, "lift", f"only {reason}", "give views nearer to the person: --view FILE")
    views = [int((~torch.isnan(p.error)).sum()) for p in points]
    agreed = [int(p.agreed.sum()) for p in points]
    confidence = torch.tensor([a / v if v else 0.0 for a, v in zip(agreed, views)], dtype=torch.float64)
    confidence = torch.where(known, confidence, torch.zeros_like(confidence))
    up = scene.up.double()
    facing = _facing(joints, up)
    if facing is None:
        facing = _voted_facing(cameras, seen, joints[known].mean(0), up)
    return Subject(joints, confidence, facing, up, _height(joints, up, scene.name))


def _facing(joints: Tensor, up: Tensor) -> Tensor | None:
    """Where shoulders and hips face, made level; None if neither pair is known."""
    pairs = torch.stack([joints[0] - joints[1], joints[6] - joints[7]])
    pairs = pairs[torch.isfinite(pairs[:, 0])]
    if len(pairs) == 0:
        return None
    left = pairs.sum(0)
    facing = torch.linalg.cross(left, up)
    return facing / facing.norm() if float(facing.norm()) > 1e-6 * float(left.norm()) else None


def _voted_facing(cameras: Camera, seen: Features, middle: Tensor, up: Tensor) -> Tensor:
    """Mean of the facings that the views read by themselves."""
    yaw = seen.require("orientation")[:, 0].double()
    outward = cameras.center - middle
    level = torch.nn.functional.normalize(outward - (outward @ up)[:, None] * up, dim=1)
    turned = torch.cos(yaw)[:, None] * level - torch.sin(yaw)[:, None] * torch.linalg.cross(up.expand_as(level), level)
    return torch.nn.functional.normalize(turned[torch.isfinite(yaw)].mean(0), dim=0)


def _height(joints: Tensor, up: Tensor, name: str) -> float:
    """Standing height from the longest known stretch of the body, by its usual share of the height."""
    at = {n: joints[i] @ up for i, n in enumerate(JOINTS)}
    for part in ("ankle", "knee", "hip"):
        pair = torch.stack([at[f"left_{part}"], at[f"right_{part}"]])
        known = pair[torch.isfinite(pair)]
        at[part] = known.mean() if len(known) else torch.tensor(math.nan, dtype=torch.float64)
    for high, low, share in _STATURE:
        stretch = float(at[high] - at[low])
        if stretch > 0:
            return stretch / share
    raise InputError(name, "lift", "no pair of joints that tells the height", "give more views: --view FILE")


def _report(point: Triangulated, width: int) -> JointReport:
    views = int((~torch.isnan(point.error)).sum())
    agreed = int(point.agreed.sum())
    known = bool(torch.isfinite(point.point[0]))
    return JointReport(views, agreed, float(point.error[point.agreed].median()) / width if known else math.nan)


def summary(found: Lift) -> dict[str, Any]:
    """The report as plain values, for ``subject.json``; null where a joint cannot be seen."""
    errors = [j.error for j in found.joints.values() if not math.isnan(j.error)]
    return {
        "views": len(found.cameras),
        "views_with_person": found.found,
        "joints_known": len(errors),
        "median_error_widths": sorted(errors)[len(errors) // 2] if errors else None,
        "labelled": int(found.label.sum()),
        "joints": {
            name: {"seen": j.views, "agreed": j.agreed, "error_widths": None if math.isnan(j.error) else j.error}
            for name, j in found.joints.items()
        },
    }
