"""The initial view: given by the user, or the best of an orbit around the subject."""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor

from ..camera import Camera
from ..errors import InputError, UsageError
from ..features import Features
from ..scenes.posed import named_camera
from ..search.subject_orbit import SCALE, SubjectOrbit
from ..subject import Subject
from ..trajectory import Trajectory
from .stage import Stage

VERTICAL_FOV = math.radians(40)  # a normal lens: 33 mm on a 24 mm high gate
AZIMUTHS = 16  # of a full orbit, where the reference does not say where the person faces
ELEVATIONS = (0.0, 0.3)  # [rad]; below the subject lies the ground
DISTANCES = tuple(0.5 * 1.4**k for k in range(9))  # subject heights, 0.5 to 7.4
BATCH = 16  # views rendered together
KEPT = 4  # views that the first frame may start from
APART = 0.35  # of the distance to the subject, between two of them


def given_view(source: str) -> Camera:
    """The view a person names, at its own size.

    Args:
        source: a trajectory file (its first camera), or ``SET:INDEX``, a camera of a posed image set, counted from 0
            in the set's own order (COLMAP: of names).

    Raises:
        InputError: the file is no trajectory, or the set cannot be read.
        UsageError: the set has no such camera.
    """
    camera = named_camera(source, "--init")
    return Trajectory.load(Path(source)).camera[0] if camera is None else camera


def orbit(subject: Subject, size: tuple[int, int], first: Features, free_lens: bool) -> Camera:
    """Views around the subject, each aimed so that the subject appears as in the first reference frame.

    Where the reference says how the body is seen, the views stand there, and behind it in case front and back were
    confused; else all around. A free lens follows the size at several distances, a fixed one sets the distance.

    Args:
        subject: to orbit.
        size: (W, H) of the views [px].
        first: one reference frame.
        free_lens: whether the focal length may change.
    """
    focal = 1 / (2 * math.tan(VERTICAL_FOV / 2))
    stands = _stands(first)  # (M, 3) azimuth, elevation, roll
    distances = torch.tensor(DISTANCES, dtype=torch.float64).log()
    rows = torch.arange(len(stands)).repeat_interleave(len(distances))
    distance = distances.repeat(len(stands))
    middle = torch.zeros(len(rows), 2, dtype=torch.float64)
    lens = math.log(focal) - distance
    x = torch.cat([stands[rows], distance[:, None], middle, lens[:, None]], dim=1) / SCALE
    normal = Camera.look_at(subject.anchor[None] + subject.facing, subject.anchor[None], subject.up, VERTICAL_FOV, size)
    search = SubjectOrbit()
    x = x if free_lens else x[:, :-1]
    if first.has("keypoints"):
        x = search.aimed(x, normal, subject, first)
    return search.cameras(x, normal, subject)


def _stands(first: Features) -> Tensor:
    """Azimuth, elevation, roll (M, 3) [rad] to stand at."""
    if first.has("orientation"):
        read = first.require("orientation").double()[0]
        if bool(torch.isfinite(read).all()):
            yaw, pitch, roll = read.tolist()
            flat = [[yaw, e, roll] for e in {pitch, *ELEVATIONS}] + [[yaw + math.pi, e, -roll] for e in {pitch, 0.0}]
            return torch.tensor(sorted(flat), dtype=torch.float64)
    azimuths = torch.arange(AZIMUTHS, dtype=torch.float64) * (2 * math.pi / AZIMUTHS)
    grid = torch.cartesian_prod(azimuths, torch.tensor(ELEVATIONS, dtype=torch.float64))
    return torch.cat([grid, torch.zeros(len(grid), 1, dtype=torch.float64)], dim=1)


def first_seen(features: Features) -> Features:
    """The first frame that shows a person; the first of all where joints were not read."""
    if not features.has("keypoints"):
        return features[0]
    seen = torch.isfinite(features.require("keypoints")[..., 0]).any(1)  # (N,)
    return features[int(seen.int().argmax())]


def best_of_orbit(stage: Stage, first: Features, size: tuple[int, int], free_lens: bool) -> Camera:
    """Views of the orbit, the nearest to the first reference frame by the losses that need no motion first.

    Raises:
        UsageError: the scene has no subject to orbit.
        InputError: no view scores on any term.
    """
    subject = stage.scene.subject
    if subject is None:
        raise UsageError("", "--init", "auto needs a lifted subject", "give a view: --init view.json")
    views = orbit(subject, size, first, free_lens)
    defined = stage.objective.defined(first)[0]
    terms = torch.cat([stage.terms(first, views[i : i + BATCH], None) for i in range(0, len(views), BATCH)])
    if not bool(torch.isfinite(terms[:, defined]).any()):
        raise InputError(stage.scene.name, "--init", "no view around the subject shows it", "give one: --init FILE")
    order = stage.objective.totals(terms, defined).argsort(stable=True).tolist()
    return views[_apart(views.center, order, subject.anchor)]


def _apart(centers: Tensor, order: list[int], anchor: Tensor) -> list[int]:
    """The first of ``order`` whose centres (V, 3) are well apart: starts that are alike end alike."""
    kept: list[int] = []
    for i in order:
        near = [(centers[i] - centers[k]).norm() < APART * (centers[k] - anchor).norm() for k in kept]
        if not any(near) and len(kept) < KEPT:
            kept.append(i)
    return kept
