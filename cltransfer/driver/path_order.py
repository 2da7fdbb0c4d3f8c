"""The whole clip at once: the path of least order (static, linear, a few knots) that costs no more than its frames.

Frames found one by one jitter as far as their losses let them, and a frame that moves makes the flow of the next one
wrong. A spline through all of them is solved for jointly; the least order within the noise floor is taken, then the
lens is kept still where that costs nothing either.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product

import torch
from torch import Tensor

from ..along_clip import along
from .joint import Effort, Moves, refine_path
from .spline import Fitted, Local, fit
from .whole_clip import WholeClip

STANDS = 1e-5  # by which a path changes at most that is static as it was found, in the units of x: float32 rounds
LEAST_FLOOR = 0.01  # total that nobody sees, a hundredth of a tolerance
SHARE = 0.02  # of the free path's total that its own minima are uncertain by: neighbours end in other ones
TRUSTED = 0.1  # total, of frames that tell where to stand, below which the Jacobians that they ended with describe it
JUMPS = 1.5  # times the total of frames that jump, that a filtered path may cost: no loss sees a jump of one frame
CUT = 0.4  # change of x from one frame to the next that is seen as a cut, where the reference has none
SEVERED = 3.0  # times the total of frames between which there is one, that a filtered path may cost
FILTERS = (2.0, 1.0)  # [frames] standard deviation of the filter where no spline will do
TRIED = 3  # paths evaluated at most, of those that the linear model says are good enough; one a round of refining
PLAIN = 2  # knots of a path that stays what it is, static or linear, when it is refined; any other may bend
CLEARLY = 0.9  # of the total that the last one promised
Ladder = list[tuple[int, Tensor | None]]
HOPE = 1.3  # times the total allowed, from where refining brings a filtered path there
FAR = 3.0  # times the total allowed; above it the linear model does not hold


@dataclass(frozen=True)
class LeastPath:
    """The path taken.

    Args:
        x: (N, D).
        knots: a dimension; None is every frame for itself.
        filtered: standard deviation of the filter along the clip, where there are no knots [frames]; 0 is none.
        lens_kept: whether the focal length stays the same.
        refined: whether it was then moved as a whole; one of 4 knots and more is no spline any more since.
        total: mean over the frames.
        free: the same of the frames as they were found.
        floor: how much more than that it may cost.
        residuals: weighted, (N, R); None where a loss has none, and of frames as they were found.
        about: path (N, D) that moves as the reference does, where what was added to it was filtered.
        aside: whether it goes aside somewhere, past what is before the person or where a loss jumps.
        local: what the losses make of the path as it was found, where that was measured for it; else None.
    """

    x: Tensor  # (N, D)
    knots: int | None
    filtered: float
    lens_kept: bool
    total: float
    free: float
    floor: float
    refined: bool = False
    residuals: Tensor | None = None
    about: Tensor | None = None
    aside: bool = False
    local: Local | None = None

    @property
    def steady(self) -> bool:
        """Whether it is static or linear, and is to stay so."""
        return self.knots is not None and self.knots <= PLAIN

    @property
    def name(self) -> str:
        """In words, for reports."""
        order = {None: "every frame", 1: "static", 2: "linear"}.get(self.knots, f"{self.knots} knots")
        kept = ", focal length kept" if self.lens_kept and self.knots != 1 else ""
        filtered = f", filtered over {self.filtered:g}" if self.filtered else ""
        refined = ", refined as a whole" if self.refined else ""
        aside = f", aside{'' if self.steady else ' for some frames'}" if self.aside else ""
        return order + kept + filtered + refined + aside


def orders(frames: int) -> list[int]:
    """Knots to choose from: one, or at most one for two frames, since more would shake like the frames themselves.

    >>> orders(24)
    [1, 2, 4, 6, 8, 12]
    """
    ladder, step = [1, 2, 4], 6
    while step < frames:
        ladder += [step, step + step // 3]
        step *= 2
    return [knots for knots in ladder if knots <= max(1, frames // 2)]


def least_path(
    clip: WholeClip,
    x: Tensor,
    local: Local | None,
    noise: float,
    effort: Effort,
    guide: Tensor | None = None,
    still: bool = False,
) -> LeastPath:
    """The least order that stays within the noise floor of the path as it was found.

    Args:
        clip: what it is a path for.
        x: the path as it was found, (N, D).
        local: what the losses make of it, as its frames ended; None where they were not refined by residuals.
        noise: how far totals are uncertain, because the reference was read by networks; 0 where it is exact.
        effort: of refining the path as a whole, where the loss is not small already.
        guide: a path (N, D) that moves as the reference does, None where there is none.
        still: whether the lens is kept, whatever that costs.
    """
    free, residuals = (local.total, local.residuals) if local is not None else clip.scored(x)
    path = LeastPath(x, None, 0.0, False, free, free, noise + LEAST_FLOOR + SHARE * free)
    if len(x) == 1:
        return path
    if residuals is None or clip.stage.plan.passes or free <= TRUSTED * clip.placed_share:
        effort = Effort(0, 0)  # differences taken through noisy networks mislead
    if effort.rounds and local is None and residuals is not None:
        local = clip.local(x, residuals)
        path = replace(path, local=local)
    limit = free + path.floor
    if float((x - x[0]).abs().max()) <= STANDS:
        held = replace(path, x=x[:1].expand_as(x).clone(), residuals=residuals)
        return refined(clip, _standing(clip, held, local), effort)
    tries = min(TRIED, effort.rounds or TRIED)
    ladder = _ladder(clip, x, still)
    spline = (
        _by_total(clip, path, limit, ladder) if local is None else _by_model(clip, path, local, limit, tries, ladder)
    )
    if spline is None:
        return _filtered(clip, path, guide, limit, effort, still)
    found = refined(clip, spline, effort)
    return found if found.total <= limit else spline  # refining trades total for steadiness


def _standing(clip: WholeClip, found: LeastPath, local: Local | None) -> LeastPath:
    """A path that stands as it was found: there, or where the model leads all frames together if that costs less."""
    here = replace(found, knots=1, lens_kept=True)
    if local is None:
        return here
    x = _fitted(clip, found.x, local, 1).x
    total, residuals = clip.scored(x)
    return replace(here, x=x, total=total, residuals=residuals) if total < here.total else here


def _filtered(
    clip: WholeClip, free: LeastPath, guide: Tensor | None, limit: float, effort: Effort, still: bool = False
) -> LeastPath:
    """Where no spline is near enough: the losses jump, and so would the camera.

    What the reference does in a few frames looks like a jump to a filter; the guide does it too, so what the path adds
    to the guide is filtered as well. The first that costs little is taken, or else the one that costs least, dearer
    ones where the frames as they were found are seen as a cut; where the lens is to keep ``still`` some such path is
    taken in any case, since they zoom.
    """
    lens = clip.lens(free.x.shape[1]) if still else None
    dearest = (SEVERED if cuts(free.x, guide) else JUMPS) * free.free
    accepted = max(limit, dearest) if lens is None else math.inf
    enough, best, tried = HOPE * limit if effort.rounds else accepted, None, False
    for frames, about in product(FILTERS, (None,) if guide is None else (None, guide)):
        added = free.x if about is None else free.x - about
        steady = along(added, frames, clip.at)
        moving = steady if about is None else about + steady
        x = clip.inside(moving if lens is None else _held(moving, lens), lens)
        total, residuals = clip.scored(x)
        path = replace(free, x=x, filtered=frames, about=about, total=total, residuals=residuals)
        path = path if lens is None else replace(path, lens_kept=True)
        best = path if best is None or path.total < best.total else best
        if path.total <= enough:
            found = _accepted(refined(clip, path, effort), path, accepted)
            if found is not None:
                return found
            enough, tried = accepted, True  # refining does not bring it there, so the next has to be near enough itself
    assert best is not None
    return (None if tried else _accepted(refined(clip, best, effort), best, accepted)) or free


def cuts(x: Tensor, guide: Tensor | None) -> list[int]:
    """Frames of the path x (N, D) before which the camera jumps and the ``guide`` (N, D), the reference, does not.

    Empty without a guide, since the reference may jump as well.
    """
    if guide is None:
        return []
    jumps = torch.minimum(x.diff(dim=0).abs(), (x - guide).diff(dim=0).abs()).amax(1) > CUT
    return (jumps.nonzero()[:, 0] + 1).tolist()


def _held(x: Tensor, way: Tensor) -> Tensor:
    """The path x (N, D) nearest to it along which ``way`` (D,) keeps its mean."""
    along_way = x @ way
    return x - (along_way - along_way.mean())[:, None] * way / (way @ way)


def _accepted(after: LeastPath, before: LeastPath, limit: float) -> LeastPath | None:
    """The first of the two that costs no more than ``limit``."""
    return next((found for found in (after, before) if found.total <= limit), None)


def refined(clip: WholeClip, path: LeastPath, effort: Effort) -> LeastPath:
    """The path moved as a whole to where it costs less; one that is static or linear stays so."""
    if not effort.rounds or path.residuals is None:
        return path
    way = clip.lens(path.x.shape[1]) if path.lens_kept else None
    knots = path.knots if path.steady and path.knots is not None else len(path.x)
    moves = Moves(knots, way, fade=not path.steady, about=path.about, enough=path.free)
    x, residuals = refine_path(clip, path.x, path.residuals, moves, effort)
    if x is path.x:
        return path
    return replace(path, x=x, residuals=residuals, total=clip.mean_total(residuals), refined=True)


def _by_total(clip: WholeClip, free: LeastPath, limit: float, ladder: Ladder) -> LeastPath | None:
    """The least order that is good enough, each tried in turn."""
    for knots, way in ladder:
        x = _fitted(clip, free.x, None, knots, way).x
        total = clip.total(x)
        if total <= limit:
            return replace(free, x=x, knots=knots, lens_kept=way is not None or knots == 1, total=total)
    return None


def _by_model(
    clip: WholeClip, free: LeastPath, local: Local, limit: float, left: int, ladder: Ladder
) -> LeastPath | None:
    """The least order that is good enough, of those of which the linear model says so; ``left`` paths are evaluated.

    One that turns out not to be is tried again from where it led, as long as the model there says so; the next one has
    to promise clearly more.
    """
    promised = math.inf
    for knots, way in ladder:
        if not left:
            break
        spline = _fitted(clip, free.x, local, knots, way)
        first = spline.predicted
        if first is None or first > min(limit, CLEARLY * promised):
            continue
        while left and spline.predicted is not None and spline.predicted <= limit:
            left -= 1
            residuals = clip.residuals(spline.x)
            total = clip.mean_total(residuals)
            if total <= limit:
                kept = way is not None or knots == 1
                return replace(free, x=spline.x, knots=knots, lens_kept=kept, total=total, residuals=residuals)
            if total > FAR * limit:  # the model does not hold there
                break
            spline = _fitted(clip, spline.x, replace(local, residuals=residuals), knots, way)
        promised = first
    return None


def _fitted(clip: WholeClip, x: Tensor, local: Local | None, knots: int, fixed: Tensor | None = None) -> Fitted:
    found = fit(x, local, knots, fixed, clip.at)
    return replace(found, x=clip.inside(found.x, fixed))


def _ladder(clip: WholeClip, x: Tensor, still: bool) -> Ladder:
    """Knots, and the direction of x that is kept still if any, as always where ``still``; the least first."""
    lens = clip.lens(x.shape[1])
    ways = [None] if lens is None else [lens] if still else [lens, None]
    return [(knots, way) for knots in orders(len(x)) for way in ways]
