"""A whole path in closed form: stands as read, aimed at the reference's joints, at the distances that suit the clip.

Where a camera stands around the person is read off the reference, and where and how large the person appears follows
by projection alone. What is left is the distance at one size. That is looked up for a few frames along the clip and
chosen for all of them together, by dynamic programming, coarsely and then finely: a depth that suits the first frame
best may suit the rest badly, and a search that follows the clip frame by frame cannot come back from there. Where no
distance suits, what stands before and behind the person there does not: the whole path is tried from aside too. Where
what suits costs much, part of the clip or all of it may stand a tolerance higher or lower.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..along_clip import along, counted
from ..search.subject_orbit import ANGLES, AZIMUTH, DISTANCE, ELEVATION, SCALE
from .aiming import aimable, aimed, aimed_at, aimed_path, stands
from .lookups import POOR, STEP, cheapest_along
from .lookups_aside import cheapest_aside
from .whole_clip import WholeClip

DISTANCES = 0.5 * 1.12 ** (torch.arange(70, dtype=torch.float64) / STEP)  # subject heights, 0.5 to 6.8
BETWEEN, LONGEST = 0.61, 2.0  # that distances are smoothed over: of the frames between two lookups, at most [frames]
SIDES = ((0.25, 0.0), (-0.25, 0.0), (0.0, 0.25), (0.0, -0.25))  # azimuth and elevation [rad]: five tolerances
LITTLE = np.array([(0.0, 0.04), (0.0, -0.04), (0.0, 0.08), (0.0, -0.08)])  # the same, about one
WORTH = 0.9  # total of the frames that are looked up, in the mean, above which a little aside is looked too
GAINS = 0.5  # total of a frame that another side has to gain
BEND = 5.0  # total that the background's flow costs where the log of the distance changes by 1 a frame, suddenly


@dataclass(frozen=True)
class Guide:
    """A path that frames may start from: in closed form, or what an earlier round has found.

    Args:
        x: of N cameras, (N, D).
        pitch: that they are to have as angles are read, (N,) [rad].
    """

    x: Tensor  # (N, D)
    pitch: Tensor  # (N,)


def closed_form(clip: WholeClip, free_lens: bool, samples: int) -> Guide | None:
    """A path in closed form; None where the search, or what was read of the reference, does not allow one.

    Evaluates about half of ``samples`` times the steps of :data:`DISTANCES`, for a clip of any length; all of them for
    a frame that none of that half suits, or far less than the others, and for a single sample; where none suits, those
    between two steps too. Where the frames that are looked up cost more than :data:`WORTH` in the mean, two of them or
    all from :data:`LITTLE` aside too, and where more than :data:`.lookups.POOR` as often again from each of
    :data:`SIDES` before.

    Args:
        clip: N frames; its home may be any view of the right size, which lends its lens where that is kept, and
            nothing else.
        free_lens: whether x holds the lens; if not, the distance follows the size and nothing is looked up.
        samples: frames for which distances are looked up, at least 1, evenly over those that show joints.
    """
    reference = clip.reference
    if not aimable(clip) or (read := stands(clip)) is None:
        return None
    dimensions = clip.search.dimensions - (not free_lens)
    x = torch.zeros(len(reference), dimensions, dtype=torch.float64)  # in the middle, as high as the frame
    x[:, ANGLES] = read / SCALE[ANGLES]
    if free_lens:
        found = _best(clip, x, samples, read[:, 1])
        return None if found is None else Guide(aimed_path(clip, found.x, found.pitch), found.pitch)
    return Guide(aimed_path(clip, x, read[:, 1]), read[:, 1])


@dataclass(frozen=True)
class _Sampled:
    """A clip of which a few frames are looked up at distances, from where its cameras stand.

    Args:
        clip: N frames.
        x: where the cameras stand, (N, 7).
        pitch: of them as the reference was read, (N,) [rad].
        frames: that are looked up, (S,).
    """

    clip: WholeClip
    x: Tensor  # (N, 7)
    pitch: Tensor  # (N,)
    frames: NDArray  # (S,)

    @property
    def rate(self) -> float:
        """What a bend between these frames costs."""
        return BEND * len(self.frames) / (int(self.frames[-1] - self.frames[0]) + 1)

    def turned(self, by: Tensor) -> _Sampled:
        """The same from aside, turned about the person by azimuth and elevation ``by``, (2,) or (N, 2) [rad]."""
        if not bool(by.any()):
            return self
        x = self.x.clone()
        x[:, [AZIMUTH, ELEVATION]] += by / SCALE[[AZIMUTH, ELEVATION]]
        return replace(self, x=self.clip.inside(x), pitch=self.pitch + by[..., 1])

    def costs(self, k: int, tried: NDArray) -> tuple[NDArray, bool]:
        """What sample ``k`` costs at those of :data:`DISTANCES`, and whether any shows something."""
        frame = int(self.frames[k])
        return _costs(self.clip, frame, self.x[frame], DISTANCES[tried].log(), self.pitch[frame])

    def path(self, logs: NDArray, turns: NDArray) -> _Sampled:
        """The path between samples at ``logs`` (S,) of the distance, each from aside by ``turns`` (S, 2) [rad]."""
        at = counted(len(self.x), self.clip.at)
        there = at.numpy()[self.frames]
        columns = [np.interp(at.numpy(), there, column) for column in (logs, *turns.T)]
        found = torch.from_numpy(np.stack(columns, axis=1))
        if len(self.frames) > 1:
            apart = float(self.frames[-1] - self.frames[0]) / (len(self.frames) - 1)
            found = along(found, min(BETWEEN * apart, LONGEST), at)
        path = self.turned(found[:, 1:])
        x = path.x.clone()
        x[:, DISTANCE] = found[:, 0] / SCALE[DISTANCE]
        return replace(path, x=x)


@dataclass(frozen=True)
class _Straight:
    """Distances that were looked up from where cameras stand.

    Args:
        sampled: the frames that were.
        costs: of them at the distances, (S, K), infinite where it was not looked.
        chosen: the distance of each, (S,).
    """

    sampled: _Sampled
    costs: NDArray  # (S, K)
    chosen: NDArray  # (S,)

    @property
    def cost(self) -> float:
        """Of what is chosen, in the mean."""
        return float(self.costs[np.arange(len(self.costs)), self.chosen].mean())

    def from_aside(self) -> _Sampled:
        """The path between them, from a little aside where that costs less."""
        turns, chosen = np.zeros((len(self.chosen), 2)), self.chosen
        if self.cost > WORTH:
            ways = [self.sampled.turned(torch.from_numpy(by)) for by in LITTLE]
            way, chosen = cheapest_aside(
                lambda k, w, tried: ways[w - 1].costs(k, tried)[0],
                (self.costs, chosen),
                DISTANCES.log().numpy(),
                LITTLE,
                self.sampled.rate,
            )
            turns = np.concatenate([np.zeros((1, 2)), LITTLE])[way]
        return self.sampled.path(DISTANCES.log().numpy()[chosen], turns)


def _best(clip: WholeClip, x: Tensor, samples: int, pitch: Tensor) -> _Sampled | None:
    """The path x (N, 7) at distances that suit it, from aside where those suit better.

    None where no frame is seen from any distance.
    """
    reference = clip.reference
    told = np.flatnonzero(aimed_at(reference, clip.stage.scene.subject).numpy())  # others cost nothing from anywhere
    frames = told[_spread(len(told), samples)]
    here = _Sampled(clip, x, pitch, frames)
    best = _straight(here)
    if best is None:
        return None
    if best.cost > POOR:
        sides = [_straight(here.turned(torch.tensor(by, dtype=x.dtype))) for by in SIDES]
        side = min((side for side in sides if side is not None), key=lambda side: side.cost, default=best)
        best = side if side.cost < best.cost - GAINS else best
    return best.from_aside()


def _straight(sampled: _Sampled) -> _Straight | None:
    """The distances that cost least along the clip from where it stands; None where no frame is seen from any."""
    seen = False

    def look_up(k: int, tried: NDArray) -> NDArray:
        nonlocal seen
        costs, found = sampled.costs(k, tried)
        seen |= found
        return costs

    costs, chosen = cheapest_along(look_up, len(sampled.frames), DISTANCES.log().numpy(), sampled.rate)
    return _Straight(sampled, costs, chosen) if seen else None


def _spread(frames: int, samples: int) -> NDArray:
    """The first of N frames and the last, and others evenly between, as many as there are ``samples``."""
    return np.unique(np.linspace(0, frames - 1, samples).round().astype(int))


def _costs(clip: WholeClip, frame: int, x: Tensor, logs: Tensor, pitch: Tensor) -> tuple[NDArray, bool]:
    """What the losses that need no flow give for one frame, from x (D,) at distances ``logs`` (K,), and if any does.

    Each is aimed, and as high as ``pitch`` () [rad] is read from there.
    """
    wanted, objective = clip.reference[frame], clip.stage.objective
    still = ~objective.of_motion
    tried = x.repeat(len(logs), 1)
    tried[:, DISTANCE] = logs / SCALE[DISTANCE]
    tried = aimed(clip, tried, wanted, pitch.expand(len(logs)))
    terms = clip.stage.terms(wanted, clip.cameras(tried), None)
    defined = clip.defined[frame] & still
    weighted = objective.weighted(terms, defined)[:, still].sum(1).numpy()
    return weighted, bool(torch.isfinite(terms[:, defined]).any())
