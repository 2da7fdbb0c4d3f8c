"""Where in a scene people are: boxes in views all around, joined by the rays that meet."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...camera import Camera
from ...errors import InputError, UsageError
from ...near_plane import smaller_near
from ...subject import Subject
from .. import Scene
from .triangulate import triangulate

SIZE = (640, 360)  # [px] of the views
FOV = math.radians(40)
FILL = 0.62  # of the frame height that a person takes in the views
NEAR_VIEWS, FAR_VIEWS = 0.12, 0.38  # elevations of the ring [rad]
SHARES = (0.5, 0.9, 1.6)  # of the scene's reach that the first rings are fitted to
CLOSER = 2  # rounds of views about each person
MEET = 0.04  # frame widths by which boxes of one person may miss their common middle
APART = 0.35  # heights between the middles of two people, at least
BETWEEN = 0.1  # of the scene's reach, about what lies between it and the nearest views around it
STEPS = 9  # points from a body's middle to each of its ends
ROUND = 0.1  # heights that a body reaches beyond its joints
LENS = 0.02  # heights before the camera from which a part of a body is seen
MINIMUM_VIEWS = 2  # that must agree on a person
BY_VIEWS = "cltransfer lift SCENE --view TRAJECTORY.json --out FOLDER, then transfer --subject FOLDER/subject.json"

Boxes = list[np.ndarray]  # of all persons in each of V views, (P, 5) each: x, y, width, height [px], score
See = Callable[[Camera], Boxes]


@dataclass(frozen=True)
class Found:
    """A person, roughly.

    Args:
        middle: of the body, (3,) world.
        height: scene units.
        views: that agree on it.
    """

    middle: Tensor  # (3,)
    height: float
    views: int


def find_people(scene: Scene, see: See) -> list[Found]:
    """Everyone in the scene, who is seen in most views first; people of as many views by height.

    Args:
        scene: any geometry with ``means``.
        see: boxes of all persons in views of the scene.

    Raises:
        InputError: the scene is empty.
    """
    center, reach = _reach(scene)
    rough: list[Found] = []
    for share in SHARES:
        cameras = ring(center, share * reach, scene.up, 12)
        rough += people_of(cameras, see(cameras))
    near = [_closer(scene, person, see) for person in _told_apart(rough)]
    return _told_apart([person for person in near if person is not None])


def _reach(scene: Scene) -> tuple[Tensor, float]:
    """Middle of a scene (3,), and how far from there most of it lies.

    Raises:
        InputError: there is nothing in it, or all of it lies at one point.
    """
    means = scene.geometry.means.double()
    if len(means) == 0:
        raise InputError(
            scene.name, "scene", f"expected something to see, got an empty {type(scene.geometry).__name__}"
        )
    center = means.median(0).values
    reach = float(torch.quantile((means - center)[:: max(1, len(means) // 10**5)].norm(dim=1), 0.9))
    if not reach > 0:
        reason = f"expected something that has an extent, all {type(scene.geometry).__name__} lie at one point"
        raise InputError(scene.name, "scene", reason)
    return center, reach


def chosen(people: list[Found], person: int, scene: Scene, renderer: Any) -> Found:
    """The one called ``person``.

    Raises:
        InputError: there is nobody; the line says so where what ``renderer`` does not draw whole may be why.
        UsageError: there are not so many.
    """
    if not people:
        options = smaller_near(renderer, BETWEEN * _reach(scene)[1])
        cut = f"if people are cut off before the lens, {options}; " if options else ""
        hint = f"if the scene is not upright, give --up X,Y,Z; {cut}or lift it from views of your own: {BY_VIEWS}"
        raise InputError(scene.name, "lift", "no person found in any view", hint)
    if person >= len(people):
        several = f"expected 0 to {len(people) - 1}: {len(people)} are seen"
        known = "only person 0 is seen in this scene" if len(people) == 1 else several
        raise UsageError(scene.name, f"person {person}", known)
    return people[person]


def people_of(cameras: Camera, boxes: Boxes) -> list[Found]:
    """People whose boxes in V views meet: the one that most views agree on is taken out, until fewer than two agree."""
    left = [view.astype(np.float64) for view in boxes]
    people: list[Found] = []
    while True:
        view = torch.tensor([v for v, found in enumerate(left) for _ in found], dtype=torch.long)
        box = torch.from_numpy(np.concatenate([*left, np.zeros((0, 5))]))
        if len(view.unique()) < MINIMUM_VIEWS:
            return people
        among, tolerance = cameras[view.tolist()], MEET * cameras.size[0]
        point = triangulate(among, _middle(box), torch.ones(len(view), dtype=torch.bool), tolerance)
        agreed = _one_a_view(view, point.agreed, point.error)
        point = triangulate(among, _middle(box), agreed, tolerance)
        if int(agreed.sum()) < MINIMUM_VIEWS or not bool(torch.isfinite(point.point).all()):
            return people
        depth = cameras.project(point.point[None])[1][:, 0]
        height = (box[:, 3] * (depth / cameras.focal)[view])[agreed].median()
        people.append(Found(point.point, float(height), int(agreed.sum())))
        left = [found[~gone] for found, gone in zip(left, np.split(agreed.numpy(), np.cumsum([*map(len, left)])[:-1]))]


def side_by_side(boxes: Boxes) -> int:
    """How many of V views show two people: a box whose middle lies in another's may be the head of the same one."""
    count = 0
    for view in boxes:
        low, high = view[:, :2], view[:, :2] + view[:, 2:4]
        middle = ((low + high) / 2)[:, None]
        within = ((low <= middle) & (middle <= high)).all(-1)  # (P, P), of each middle whether each box has it
        count += not (within | within.T).all()
    return count


def boxes_of(person: Found, body: Tensor, cameras: Camera, boxes: Boxes) -> Tensor:
    """In each of V views the box nearest to where the person must be, (V, 5) [px]; NaN where there is none.

    A box ends where the frame does, so its middle is compared with that of the part of the body in the frame.

    Args:
        person: whose boxes.
        body: its ends, (P, 3) world: joints, or :func:`standing`.
        cameras: of the views, V.
        boxes: of all persons in each view.
    """
    middle, inside = _in_frame(person, body, cameras)
    depth = cameras.project(person.middle[None])[1][:, 0]
    tall = torch.where(depth > 0, person.height * cameras.focal / depth, torch.inf)
    near = APART * tall.clamp_max(cameras.size[1])  # [px]
    found = torch.full((len(cameras), 5), torch.nan)
    for v, view in enumerate(boxes):
        if len(view) == 0 or not inside[v]:
            continue
        box = torch.from_numpy(view)
        off = (_middle(box.double()) - middle[v]).norm(dim=1)
        nearest = int(off.argmin())
        if off[nearest] < near[v]:
            found[v] = box[nearest].float()
    return found


def boxes_of_subject(subject: Subject, cameras: Camera, boxes: Boxes) -> Tensor:
    """In each of V views the box (V, 5) [px] nearest to where a lifted person must be; see :func:`boxes_of`."""
    body = subject.joints[torch.isfinite(subject.joints).all(1)]
    return boxes_of(Found(subject.anchor, subject.height, len(cameras)), body, cameras, boxes)


def standing(person: Found, up: Tensor) -> Tensor:
    """Head and feet of one who stands, (2, 3) world."""
    half = 0.5 * person.height * up.to(person.middle)
    return torch.stack([person.middle + half, person.middle - half])


def _in_frame(person: Found, body: Tensor, cameras: Camera) -> tuple[Tensor, Tensor]:
    """Middle of what V views show of a body with ends (P, 3), (V, 2) [px], and whether they show any, (V,)."""
    share = torch.linspace(0, 1, STEPS, dtype=torch.float64)[:, None, None]
    points = (person.middle + share * (body - person.middle)).flatten(0, 1)  # a part may be behind the camera
    pixels, depth = cameras.project(points)
    shown = (depth > LENS * person.height)[..., None]
    around = ROUND * person.height * (cameras.focal[:, None] / depth)[..., None]  # [px]
    frame = pixels.new_tensor(cameras.size)
    low = torch.where(shown, pixels - around, torch.inf).amin(1).clamp_min(0)
    high = torch.where(shown, pixels + around, -torch.inf).amax(1).minimum(frame)
    return (low + high) / 2, (low < high).all(1)


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


def _closer(scene: Scene, person: Found, see: See) -> Found | None:
    """The same person from views about it; None where it was nobody."""
    for _ in range(CLOSER):
        cameras = ring(person.middle, person.height, scene.up, 8)
        near = [p for p in people_of(cameras, see(cameras)) if _same(p, person)]
        if not near:
            return None
        person = max(near, key=lambda p: p.views)
    return person


def _told_apart(people: list[Found]) -> list[Found]:
    """Each person once, as most views have it; sorted by that, then by height."""
    kept: list[Found] = []
    for person in sorted(people, key=lambda p: (-p.views, -p.height)):
        if not any(_same(person, other) for other in kept):
            kept.append(person)
    return kept


def _same(one: Found, other: Found) -> bool:
    return float((one.middle - other.middle).norm()) < APART * max(one.height, other.height)


def _middle(box: Tensor) -> Tensor:
    """Centres (P, 2) of boxes (P, 4 or more)."""
    return box[:, :2] + box[:, 2:4] / 2


def _one_a_view(view: Tensor, agreed: Tensor, error: Tensor) -> Tensor:
    """Of the boxes (P,) that agree the nearest one of each view, (P,) bool."""
    best = torch.full((int(view.max()) + 1,), torch.inf, dtype=error.dtype)
    off = torch.where(agreed, error, torch.inf)
    best = best.scatter_reduce(0, view, off, "amin")
    return agreed & (off == best[view])
