"""A second guide: where part of a clip ended right, its distances for all of the clip.

The first guide looks distances up at a few frames, and one of them may lead astray: what hides most of the person
there, or stands right before the lens, hides what would tell. Frames that ended right know better.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..features import Features
from ..search.subject_orbit import SCALE, SubjectOrbit
from ..subject import Subject
from .closed_form import aimable, aimed_at, aimed_path

RIGHT = 0.2  # total that a frame which ended right has at most: every term at a fifth of its tolerance
WRONG = 0.5  # total above which one did not
SHARE = 0.25  # of the frames that have to be right
NEAR = 0.05  # log of the ratio to a distance, at which a first frame is tried nearer and farther
APART = math.log(1.35)  # log of the distances' ratio, above which one that is wrong stands elsewhere


def second_guide(
    search: Any, reference: Features, home: Camera, subject: Subject, guide: Tensor, x: Tensor, totals: Tensor
) -> Tensor | None:
    """The path (N, D) of ``guide`` at the distances of the frames that ended right; between them on the line.

    None where too few did, where those that did not stand at the same distances, so that it would be no other path, or
    where the search cannot aim.

    Args:
        search: vectors to cameras.
        reference: N frames.
        home: the view that vectors are meant from.
        subject: the person.
        guide: (N, D) in closed form.
        x: what was found, (N, D), D = 7: with a lens that is kept the distance follows the size.
        totals: there, (N,).
    """
    if not aimable(search, reference) or x.shape[1] < len(SCALE):
        return None
    right = (totals <= RIGHT) & aimed_at(reference)  # of a frame that hides the person little is asked
    if float(right.double().mean()) < SHARE:
        return None
    at = right.nonzero()[:, 0].numpy()
    told = torch.from_numpy(np.interp(np.arange(len(x)), at, x[right, 3].numpy()))
    elsewhere = (told - x[:, 3]).abs() * SCALE[3] > APART
    if not bool((elsewhere & (totals > WRONG)).any()):
        return None
    moved = guide.clone()
    moved[:, 3] = told
    return aimed_path(search, reference, home, subject, moved)


def first_views(search: SubjectOrbit, reference: Features, home: Camera, subject: Subject, guide: Tensor) -> Camera:
    """Where a first frame may start: as ``guide`` (N, D) has it, a little farther, a little nearer, (3).

    What hides the person there may stand between the distance that others tell and its own.
    """
    x = guide[:1].repeat(3, 1)
    x[:, 3] += torch.tensor([0, NEAR, -NEAR]) / SCALE[3]
    return search.cameras(search.aimed(x, home, subject, reference[0]), home, subject)
