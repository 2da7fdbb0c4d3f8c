"""Initial views: the best of an orbit around the subject."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..camera import Camera, concatenate
from ..errors import UsageError
from ..features import Features
from ..placement import frame_joints, shows_person, visible_joints
from ..search.subject_orbit import SCALE, SubjectOrbit
from ..subject import Subject
from .problem import distinct
from .stage import Stage

VERTICAL_FOV = math.radians(40)  # a normal lens: 28 mm on a gate 36 mm wide, of a frame of 16:9
AZIMUTHS = 16  # of a full orbit, where the reference does not say where the person faces
ELEVATIONS = (0.0, 0.3)  # [rad]; below the subject lies the ground
COARSE = 0.5 * 1.4 ** torch.arange(9, dtype=torch.float64)  # subject heights, 0.5 to 7.4
FINE = 0.5 * 1.07 ** torch.arange(41, dtype=torch.float64)  # the same range again, from the best stand
ALIKE = 1e-3  # by which two vectors differ at most that are one view
BATCH = 16  # views rendered together
KEPT = 4  # views that the first frame may start from
APART = 0.35  # of the distance to the subject, between two of them


@dataclass(frozen=True)
class Aim:
    """What the views of an orbit have in common.

    Args:
        subject: to orbit.
        size: (W, H) of the views [px].
        first: the reference frame that the subject should appear as in.
        free_lens: whether the focal length follows the size; if not, the distance does.
        fov: vertical field of view [rad]; where the lens is free, of the first guess.
    """

    subject: Subject
    size: tuple[int, int]
    first: Features
    free_lens: bool
    fov: float = VERTICAL_FOV

    def views(self, stands: Tensor, distances: Tensor) -> Camera:
        """Views from ``stands`` (M, 3) as azimuth, elevation, roll [rad] at ``distances`` (K,) [heights], M * K.

        Fewer with a lens that is kept: where the reference tells a size all distances of a stand become that one.
        """
        focal = 1 / (2 * math.tan(self.fov / 2))
        rows = torch.arange(len(stands)).repeat_interleave(len(distances))
        distance = distances.log().repeat(len(stands))
        middle = torch.zeros(len(rows), 2, dtype=torch.float64)
        lens = math.log(focal) - distance
        x = torch.cat([stands[rows], distance[:, None], middle, lens[:, None]], dim=1) / SCALE
        normal = any_view(self.subject, self.size, self.fov)
        search = SubjectOrbit()
        x = x if self.free_lens else x[:, :-1]
        if self.first.has("keypoints"):
            x = search.aimed(x, normal, self.subject, self.first)
        return search.cameras(x if self.free_lens else distinct(x, ALIKE), normal, self.subject)


def any_view(subject: Subject, size: tuple[int, int], fov: float = VERTICAL_FOV) -> Camera:
    """A view (1) of the subject's front."""
    anchor = subject.anchor[None]
    return Camera.look_at(anchor + subject.facing, anchor, subject.up, fov, size)


def _read_stand(first: Features) -> Tensor | None:
    """Azimuth, elevation, roll (3,) [rad] that the reference was read to stand at, None where it was not."""
    if not first.has("orientation"):
        return None
    read = first.require("orientation").double()[0]
    return read if bool(torch.isfinite(read).all()) else None


def _stands(read: Tensor | None) -> Tensor:
    """Azimuth, elevation, roll (M, 3) [rad] to stand at; as read first, all around where nothing was read."""
    if read is None:
        azimuths = torch.arange(AZIMUTHS, dtype=torch.float64) * (2 * math.pi / AZIMUTHS)
        grid = torch.cartesian_prod(azimuths, torch.tensor(ELEVATIONS, dtype=torch.float64))
        return torch.cat([grid, torch.zeros(len(grid), 1, dtype=torch.float64)], dim=1)
    yaw, pitch, roll = read.tolist()
    front = [[yaw, elevation, roll] for elevation in (pitch, *ELEVATIONS)]
    back = [[yaw + math.pi, elevation, roll] for elevation in (pitch, 0.0)]  # the lean is that of the image
    return torch.tensor(front + back, dtype=torch.float64)


def first_seen(features: Features, placed: Tensor) -> Features:
    """The first of N frames that tells where to stand, (N,) bool, by a person's visible joints if any does.

    Else by joints that are somewhere, outside the frame, else the first.
    """
    if features.has("keypoints"):
        joints = frame_joints(features, "all")
        for seen in (placed & visible_joints(joints).any(1), placed & shows_person(joints)):
            if bool(seen.any()):
                return features[int(seen.int().argmax())]
    return features[int(placed.int().argmax())]


def best_of_orbit(
    stage: Stage, first: Features, size: tuple[int, int], free_lens: bool, given: Camera | None = None
) -> Camera | None:
    """Views of the orbit, the nearest to the first reference frame by the losses that need no motion first.

    None where no view scores on any term. A lens that is kept is that of the view that was ``given``, if one was.

    Raises:
        UsageError: the scene has no subject to orbit, or no loss has a value on a first frame.
    """
    subject = stage.scene.subject
    if subject is None:
        raise UsageError("", "--init", "auto needs a lifted subject", "give a view: --init view.json")
    fov = VERTICAL_FOV if given is None or free_lens else float(given.vertical_fov[0])
    aim, defined = Aim(subject, size, first, free_lens, fov), stage.objective.defined(first)[0]
    if not bool(defined.any()):
        losses = ", ".join(stage.objective.names)
        raise UsageError("losses", losses, "none tells where to stand in a first frame", _what_would(stage, first))
    read = _read_stand(first)
    stands = _stands(read)
    views = aim.views(stands, COARSE)
    terms = _scored(stage, first, views)
    if not bool(torch.isfinite(terms[:, defined]).any()):
        return None
    totals = stage.objective.totals(terms, defined)
    if free_lens:  # depth is what the reference tells least directly, and its basin is the narrowest
        best = 0 if read is not None else int(totals.argmin()) // len(COARSE)
        fine = aim.views(stands[best][None], FINE)
        views = concatenate([views, fine])
        totals = torch.cat([totals, stage.objective.totals(_scored(stage, first, fine), defined)])
    return views[_apart(views.center, totals.argsort(stable=True).tolist(), subject.anchor)]


def _what_would(stage: Stage, first: Features) -> str:
    """What makes some loss tell where to stand: what the reference lacks of it, the one that lacks least."""
    still = {name: loss for name, loss in stage.objective.losses.items() if not stage.objective.moves(loss)}
    lacks = {name: [one for one in loss.requires if not first.has(one)] for name, loss in still.items()}
    name = min((name for name in lacks if lacks[name]), key=lambda name: len(lacks[name]), default=None)
    if name is None:
        return "add shot_size or framing"
    return f"add {', '.join(lacks[name])} to the reference, which {name} needs"


def _scored(stage: Stage, first: Features, views: Camera) -> Tensor:
    return torch.cat([stage.terms(first, views[i : i + BATCH], None) for i in range(0, len(views), BATCH)])


def _apart(centers: Tensor, order: list[int], anchor: Tensor) -> list[int]:
    """The first of ``order`` whose centres (V, 3) are well apart: starts that are alike end alike."""
    kept: list[int] = []
    for i in order:
        near = [(centers[i] - centers[k]).norm() < APART * (centers[k] - anchor).norm() for k in kept]
        if not any(near) and len(kept) < KEPT:
            kept.append(i)
    return kept
