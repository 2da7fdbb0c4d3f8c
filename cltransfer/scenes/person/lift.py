"""Lift the person out of a scene: find, look from all sides, triangulate, label. Done once a scene.

Everything is measured on renders by the image extractors; nothing is assumed about how the scene was made, except
which way is up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from ...camera import Camera
from ...errors import InputError
from ...features import Features
from ...orientation import unit
from ...skeleton import JOINTS, VISIBLE, standing_height
from ...subject import Subject
from .. import Scene
from .find_people import BY_VIEWS, See, boxes_of, chosen, find_people, people_of, ring, side_by_side, standing
from .triangulate import Triangulated, triangulate
from .vote import seen_in, vote_labels

AGREE = 0.0125  # reprojection error of a view that agrees, in frame widths
MINIMUM_VIEWS = 3
LEAST_ANGLE = math.radians(3)  # between rays, below which their point may lie anywhere along them

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


Look = Callable[[Camera, Tensor | None], Features]


@dataclass(frozen=True)
class LiftOptions:
    """How a person is lifted.

    Args:
        views: how many to look from.
        given: views to use instead of a ring of our own.
        person: which one, 0 for the one that most views see; None is that one, or the main one of each given view where
            hardly any shows two.
    """

    views: int = 16
    given: Camera | None = None
    person: int | None = None


def lift(scene: Scene, renderer: Any, look: Look, see: See, options: LiftOptions) -> Lift:
    """Lift a person of ``scene``.

    Args:
        scene: any geometry that has ``means`` to vote on.
        renderer: what draws the views.
        look: renders cameras and reads them: box, keypoints, subject, orientation, depth; of the persons in the boxes
            (V, 5) if they are given, else of the main ones.
        see: boxes of all persons in views.
        options: how.

    Raises:
        InputError: no person is found, or too few views agree on any joint.
        UsageError: there are fewer persons.
    """
    given, box = options.given, None
    if given is None:
        people = find_people(scene, see)
        who = chosen(people, options.person or 0, scene, renderer)
        given = ring(who.middle, who.height, scene.up, options.views)
        box = boxes_of(who, standing(who, scene.up), given, see(given))
    else:
        boxes = see(given)
        people = people_of(given, boxes)
        several = bool(people) and side_by_side(boxes) >= MINIMUM_VIEWS  # then who is largest may change
        if options.person is not None or several:
            who = chosen(people, options.person or 0, scene, renderer)
            box = boxes_of(who, standing(who, scene.up), given, boxes)
    seen = look(given, box)
    found = seen_in(seen)
    if int(found.sum()) < MINIMUM_VIEWS:
        reason = f"a person in {int(found.sum())} of {len(given)} views"
        raise InputError(scene.name, "lift", reason, f"give views that show one: {BY_VIEWS}")
    points = _joints(given, seen)
    count = max(1, len(people))  # one is lifted, though their boxes may not meet
    subject = replace(_subject(scene, given, seen, points), people=count)
    label = vote_labels(scene.geometry.means.double(), given, seen, subject)
    report = {name: _report(point, given.size[0]) for name, point in zip(JOINTS, points)}
    return Lift(subject, label, given, seen, int(found.sum()), report)


def _joints(cameras: Camera, seen: Features) -> list[Triangulated]:
    keypoints = seen.require("keypoints").double()
    points = []
    for j in range(len(JOINTS)):
        sure = keypoints[:, j, 2] > VISIBLE
        point = triangulate(cameras, keypoints[:, j, :2], sure, AGREE * cameras.size[0])
        enough = int(point.agreed.sum()) >= MINIMUM_VIEWS and _spread(cameras, point) >= LEAST_ANGLE
        points.append(point if enough else Triangulated(point.point * math.nan, point.agreed, point.error))
    return points


def _spread(cameras: Camera, point: Triangulated) -> float:
    """Largest angle [rad] between the rays by which views that agree see a point."""
    rays = unit(point.point - cameras.center[point.agreed])
    return float((rays @ rays.T).clamp(-1, 1).min().acos())


def _subject(scene: Scene, cameras: Camera, seen: Features, points: Sequence[Triangulated]) -> Subject:
    joints = torch.stack([p.point for p in points])
    known = torch.isfinite(joints[:, 0])
    if int(known.sum()) < 4:
        reason = f"{int(known.sum())} joints that {MINIMUM_VIEWS} views agree on"
        hint = f"if the scene is not upright, give --up X,Y,Z; or give views nearer to the person: {BY_VIEWS}"
        raise InputError(scene.name, "lift", f"only {reason}", hint)
    views = [int((~torch.isnan(p.error)).sum()) for p in points]
    agreed = [int(p.agreed.sum()) for p in points]
    confidence = torch.tensor([a / v if v else 0.0 for a, v in zip(agreed, views)], dtype=torch.float64)
    confidence = torch.where(known, confidence, torch.zeros_like(confidence))
    up = scene.up.double()
    facing = _facing(joints, up)
    if facing is None:
        facing = _voted_facing(cameras, seen, joints[known].mean(0), up)
    if not bool(facing.isfinite().all()):
        reason = "nothing tells which way the person faces: no shoulders, no hips, and no view by itself"
        raise InputError(scene.name, "lift", reason, f"give views nearer to the person: {BY_VIEWS}")
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
    """Standing height from the longest known stretch upwards, by its usual share of the height, or from the bones."""
    at = {n: joints[i] @ up for i, n in enumerate(JOINTS)}
    for part in ("ankle", "knee", "hip"):
        pair = torch.stack([at[f"left_{part}"], at[f"right_{part}"]])
        known = pair[torch.isfinite(pair)]
        at[part] = known.mean() if len(known) else torch.tensor(math.nan, dtype=torch.float64)
    reaches = [float(at[high] - at[low]) / share for high, low, share in _STATURE]
    height = standing_height(next((reach for reach in reaches if reach > 0), math.nan), joints)
    if math.isnan(height):
        raise InputError(name, "lift", "no pair of joints that tells the height", "give more views: --view FILE")
    return height


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
        "people": found.subject.people,
        "joints_known": len(errors),
        "median_error_widths": sorted(errors)[len(errors) // 2] if errors else None,
        "labelled": int(found.label.sum()),
        "joints": {
            name: {"seen": j.views, "agreed": j.agreed, "error_widths": None if math.isnan(j.error) else j.error}
            for name, j in found.joints.items()
        },
    }
