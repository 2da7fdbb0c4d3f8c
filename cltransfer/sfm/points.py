"""Points of a clip in space, from the tracks of its corners and the cameras of its frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from ..camera import Camera
from ..scenes.person.triangulate import triangulate
from .corners import Corners, Match

AGREES = 2.0 / 640  # reprojection error of a view that agrees [frame widths]
VIEWS = 3  # that must agree: two always do, moving or not
NOISE = 0.5  # least error of a corner [px]
SURE = 0.1  # relative error of a depth at which its confidence is a half


@dataclass(frozen=True)
class Points:
    """Sightings of points that stand still.

    Args:
        frames: which of the cameras sees it, (S,).
        pixels: where, (S, 2) [px].
        depth: along that camera's axis, (S,) > 0, in the unit of the cameras.
        confidence: 2^-(e/0.1)^2 of the relative error e that noise in the pixels gives the depth, (S,) in [0, 1].
        hidden: whether it lies on the subject, (S,) bool.
    """

    frames: Tensor  # (S,)
    pixels: Tensor  # (S, 2) [px]
    depth: Tensor  # (S,)
    confidence: Tensor  # (S,)
    hidden: Tensor  # (S,) bool


def find_points(camera: Camera, corners: list[Corners], matches: list[Match]) -> Points:
    """Points of all tracks that at least three views agree on; the subject's too, as far as it stood still.

    Args:
        camera: N cameras.
        corners: of the N frames.
        matches: between them, on the subject and off it.
    """
    tolerance = AGREES * camera.size[0]
    pixels = torch.full((len(corners), 2), torch.nan, dtype=torch.float64)
    parts: list[tuple[Tensor, Tensor, Tensor, Tensor, Tensor]] = []
    for frames, index in tracks(corners, matches):  # a track at a time, 1 ms each: every one has its own views
        rows = torch.from_numpy(frames)
        place = pixels.clone()
        place[rows] = torch.from_numpy(np.stack([corners[f].pixels[i] for f, i in zip(frames, index)]))
        found = triangulate(camera[rows], place[rows], torch.ones(len(rows), dtype=torch.bool), tolerance)
        agreed = rows[found.agreed]
        if len(agreed) < VIEWS:
            continue
        error = float(found.error[found.agreed].square().mean().sqrt())
        trust = _confidence(camera[agreed], found.point, error)
        hidden = torch.tensor([bool(corners[f].hidden[i]) for f, i in zip(frames, index)])[found.agreed]
        depth = camera[agreed].to_camera(found.point[None])[:, 0, 2]
        parts.append((agreed, place[agreed], depth, torch.full_like(depth, trust), hidden))
    if not parts:
        empty = torch.zeros(0)
        return Points(empty.long(), torch.zeros(0, 2), empty, empty, empty.bool())
    return Points(*(torch.cat(column) for column in zip(*parts)))


def _confidence(camera: Camera, point: Tensor, error: float) -> float:
    """Confidence in the depth of ``point`` (3,) seen by V cameras with ``error`` [px] on average."""
    rays = torch.nn.functional.normalize(point - camera.center, dim=1)
    angle = torch.acos((rays @ rays.T).clamp(-1, 1)).max()
    relative = max(error, NOISE) / float(camera.focal.mean() * angle.clamp_min(1e-9))
    return float(0.5 ** ((relative / SURE) ** 2))


def tracks(corners: list[Corners], matches: list[Match]) -> list[tuple[NDArray, NDArray]]:
    """Corners that are linked from frame to frame, as frames (V,) increasing and corner indices (V,).

    A track that meets one frame twice has a wrong link somewhere and is dropped.
    """
    first = np.cumsum([0, *(len(c.pixels) for c in corners)])
    links = [first[list(m.frames)] + m.index for m in matches]
    ends = np.concatenate(links) if links else np.zeros((0, 2), int)
    graph = coo_matrix((np.ones(len(ends)), ends.T), (first[-1], first[-1]))
    _, label = connected_components(graph, directed=False)
    order = np.argsort(label, kind="stable")
    frame = np.searchsorted(first, order, side="right") - 1
    groups = np.split(np.arange(len(order)), np.flatnonzero(np.diff(label[order])) + 1)
    chosen = [g for g in groups if len(g) >= VIEWS and len(np.unique(frame[g])) == len(g)]
    return [(frame[g], order[g] - first[frame[g]]) for g in chosen]
