"""The initial view: given by the user, or the best of an orbit around the subject."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from ..camera import Camera, resized
from ..errors import InputError, UsageError
from ..features import Features
from ..search.subject_orbit import SCALE, SubjectOrbit
from ..subject import Subject
from ..trajectory import Trajectory
from .stage import Stage

VERTICAL_FOV = math.radians(40)  # a normal lens: 33 mm on a 24 mm high gate
AZIMUTHS = 16
ELEVATIONS = (0.0, 0.3)  # [rad]; below the subject lies the ground
DISTANCES = (0.6, 1.2, 2.4, 4.8)  # subject heights


def view_from_file(path: Path, size: tuple[int, int]) -> Camera:
    """The first camera of a trajectory file, at ``size``; its vertical field of view is kept.

    Raises:
        InputError: the file is no trajectory.
    """
    return resized(Trajectory.load(path).camera[0], size)


def orbit(subject: Subject, size: tuple[int, int]) -> Camera:
    """Views around the subject, all at a normal lens with the subject in the middle of the frame."""
    focal = 1 / (2 * math.tan(VERTICAL_FOV / 2))
    azimuths = torch.arange(AZIMUTHS, dtype=torch.float64) * (2 * math.pi / AZIMUTHS)
    grid = torch.cartesian_prod(
        azimuths,
        torch.tensor(ELEVATIONS, dtype=torch.float64),
        torch.tensor(DISTANCES, dtype=torch.float64).log(),
    )
    zero = torch.zeros(len(grid), dtype=torch.float64)
    lens = math.log(focal) - grid[:, 2]
    x = torch.stack([grid[:, 0], grid[:, 1], zero, grid[:, 2], zero, zero, lens], dim=1) / SCALE
    upright = Camera.look_at(subject.anchor[None] + subject.facing, subject.anchor[None], subject.up, 1.0, size)
    return SubjectOrbit().cameras(x, upright, subject)


def best_of_orbit(stage: Stage, first: Features, size: tuple[int, int]) -> Camera:
    """The view of the orbit that comes nearest to the first reference frame by the losses that need no motion.

    Raises:
        UsageError: the scene has no subject to orbit.
        InputError: no view scores on any term.
    """
    subject = stage.scene.subject
    if subject is None:
        raise UsageError("", "--init", "auto needs a lifted subject", "give a view: --init view.json")
    views = orbit(subject, size)
    defined = stage.objective.defined(first)[0]
    terms = stage.terms(first, views, None)
    if not bool(torch.isfinite(terms[:, defined]).any()):
        raise InputError(stage.scene.name, "--init", "no view around the subject shows it", "give one: --init view.json")
    return views[int(stage.objective.totals(terms, defined).argmin())]
