"""A second guide: where part of a clip ended right, its distances for all of the clip.

The first guide looks distances up at a few frames, and one of them may lead astray: what hides most of the person
there, or stands right before the lens, hides what would tell. Frames that ended right may know better; whether they do
shows at those that ended wrong, before anything is followed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..along_clip import counted, runs
from ..camera import Camera
from ..search.subject_orbit import DISTANCE, SCALE
from .aiming import aimable, aimed_at, aimed_path
from .closed_form import Guide
from .whole_clip import WholeClip

RIGHT = 0.3  # total that a frame which ended right has at most: every term at three tenths of its tolerance
WRONG = 0.5  # total above which one did not
SHARE = 0.1  # of the frames that have to be right
NEAR = 0.05  # log of the ratio to a distance, at which a frame is tried nearer and farther
APART = math.log(1.35)  # log of the distances' ratio, above which one that is wrong stands elsewhere
GAINS = 0.5  # of the frames that ended wrong, that have to cost less there as they are aimed


@dataclass(frozen=True)
class SecondGuide:
    """Distances of the frames that ended right, for all of the clip.

    Args:
        paths: (3, N, D), between the frames that ended right on the line, a little farther, a little nearer; aimed.
        wrong: frames (N,) bool that ended wrong, and elsewhere.
    """

    paths: Tensor  # (3, N, D)
    wrong: Tensor  # (N,)

    @property
    def x(self) -> Tensor:
        """The path to follow, (N, D)."""
        return self.paths[0]

    def first_views(self, clip: WholeClip) -> Camera:
        """Where a first frame may start, (3).

        What hides the person there may stand between the distance that others tell and its own.
        """
        return clip.cameras(self.paths[:, 0])

    def gains(self, clip: WholeClip, x: Tensor, totals: Tensor) -> bool:
        """Whether frames that ended wrong cost less there as they are aimed; three evaluations of each of them.

        Args:
            clip: what was searched; every loss has residuals.
            x: what was found, (N, D).
            totals: there, (N,).
        """
        best = torch.full_like(totals, torch.inf)
        for first, last in runs(self.wrong):
            for path in self.paths:
                here = clip.totals(clip.part(path, x, first, last))
                best[first:last] = torch.minimum(best[first:last], here)
        return float((best < totals)[self.wrong].double().mean()) >= GAINS


def second_guide(clip: WholeClip, guide: Guide, x: Tensor, totals: Tensor) -> SecondGuide | None:
    """The path ``guide`` at the distances of the frames that ended right.

    None where too few did, where those that did not stand at the same distances, so that it would be no other path, or
    where the search cannot aim.

    Args:
        clip: what was searched.
        guide: of N frames.
        x: what was found, (N, D), D = 7: with a lens that is kept the distance follows the size.
        totals: there, (N,).
    """
    if not aimable(clip) or x.shape[1] < clip.search.dimensions:
        return None
    # of a frame that hides the person little is asked
    right = (totals <= RIGHT) & aimed_at(clip.reference, clip.stage.scene.subject)
    if float(right.double().mean()) < SHARE:
        return None
    at = counted(len(x), clip.at)
    told = torch.from_numpy(np.interp(at.numpy(), at[right].numpy(), x[right, DISTANCE].numpy()))
    elsewhere = (told - x[:, DISTANCE]).abs() * SCALE[DISTANCE] > APART
    wrong = elsewhere & (totals > WRONG)
    if not bool(wrong.any()):
        return None
    paths = guide.x.repeat(3, 1, 1)
    paths[:, :, DISTANCE] = told + torch.tensor([0, NEAR, -NEAR], dtype=told.dtype)[:, None] / SCALE[DISTANCE]
    return SecondGuide(torch.stack([aimed_path(clip, path, guide.pitch) for path in paths]), wrong)
