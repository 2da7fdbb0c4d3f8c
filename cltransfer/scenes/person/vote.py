"""Which primitives belong to the person: every view votes with its mask on what it sees."""

from __future__ import annotations

import torch
from torch import Tensor

from ...camera import Camera
from ...feature_shapes import on_grid
from ...features import Features, nobody
from ...skeleton import BONES, JOINTS
from ...subject import Subject

BEHIND = 0.06  # a primitive counts as seen up to this many subject heights behind the surface seen there
REACH = 0.22  # how far from the bones a primitive of the person may be, in subject heights
MAJORITY = 0.5
INSIDE = 0.8  # share of the masks that must hold a primitive no view sees

_TRUNK = tuple((JOINTS.index("neck"), JOINTS.index(hip)) for hip in ("left_hip", "right_hip"))  # within BONES


def seen_in(seen: Features) -> Tensor:
    """Views (V,) bool that show the person: in a box that is there, as the pose network says too."""
    return torch.isfinite(seen.require("box")[:, 0]) & ~nobody(seen)


def vote_labels(means: Tensor, cameras: Camera, seen: Features, subject: Subject) -> Tensor:
    """Membership (N,) in {0, 1} of primitives with centres ``means`` (N, 3).

    A primitive seen by some view belongs to the person if most of the views that see it have it in the mask. One that
    no view sees (inside the body) belongs to it if nearly all masks hold it. Nothing far from the bones does.
    """
    near = bone_distance(means, subject) < REACH * subject.height
    index = near.nonzero()[:, 0]
    points = means[index]
    inside = torch.zeros(len(index), dtype=torch.float64)
    held = torch.zeros_like(inside)
    visible_in = torch.zeros_like(inside)
    visible = torch.zeros_like(inside)
    masks, surface = (on_grid(seen.require(name), cameras.size[::-1]) for name in ("subject", "depth"))
    for v in seen_in(seen).nonzero()[:, 0].tolist():
        pixels, depths = (of_one[0] for of_one in cameras[v].project(points))  # of all views it would be gigabytes
        on, row, column = _pixel(pixels, depths, cameras.size)
        in_mask = masks[v][row, column] & on
        front = surface[v][row, column].double()
        sees = on & (depths < front + BEHIND * subject.height)
        inside += on
        held += in_mask
        visible += sees
        visible_in += sees & in_mask
    by_sight = visible_in > MAJORITY * visible
    by_hull = held >= INSIDE * inside.clamp_min(1)
    label = torch.zeros(len(means), dtype=torch.float64)
    label[index] = torch.where(visible > 0, by_sight, by_hull & (inside > 0)).double()
    return label


def _pixel(pixels: Tensor, depth: Tensor, size: tuple[int, int]) -> tuple[Tensor, Tensor, Tensor]:
    """Whether points are on the frame, and their row and column (0 where they are not)."""
    column, row = pixels.floor().long().unbind(-1)
    on = (depth > 0) & (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
    return on, row.where(on, torch.zeros_like(row)), column.where(on, torch.zeros_like(column))


def bone_distance(means: Tensor, subject: Subject) -> Tensor:
    """Distance (N,) to the nearest known bone, or to a vertical line where a limb is unknown."""
    nearest = torch.full((len(means),), torch.inf, dtype=torch.float64)
    ends = [(subject.joints[a], subject.joints[b]) for a, b in (*BONES, *_TRUNK)]
    middle = subject.anchor
    ends.append((middle - 0.55 * subject.height * subject.up, middle + 0.55 * subject.height * subject.up))
    for start, end in ends:
        if not bool(torch.isfinite(start + end).all()):
            continue
        bone = end - start
        along = (((means - start) @ bone) / (bone @ bone).clamp_min(1e-12)).clamp(0, 1)
        nearest = torch.minimum(nearest, (means - start - along[:, None] * bone).norm(dim=1))
    return nearest
