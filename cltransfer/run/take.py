"""One search: a clip followed leanly or thoroughly, and the path through what was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from torch import Tensor

from ..camera import Camera, concatenate
from ..driver.closed_form import Guide
from ..driver.follow import Path, follow
from ..driver.frame import Solved
from ..driver.joint import Effort
from ..driver.path_order import LeastPath, cuts, least_path, refined
from ..driver.schedule import Schedule
from ..driver.second_guide import second_guide
from ..driver.stage import Stage
from ..driver.starts import Starts
from ..driver.whole_clip import WholeClip
from ..features import Features
from .left_out import LeftOut
from .preparation import Job

FrameDone = Callable[[int, Solved], None]  # index, what was found


@dataclass(frozen=True)
class Take:
    """What one search found.

    Args:
        clip: what was searched.
        found: each frame's minimum.
        path: its order; None where every frame was left as it was found.
        guide: that it started from, None where there was none.
        left_out: what the search did not see, None where it saw everything.
    """

    clip: WholeClip
    found: Path
    path: LeastPath | None
    guide: Guide | None
    left_out: LeftOut | None = None

    @property
    def x(self) -> Tensor:
        """The path taken, (N, D)."""
        return self.found.x if self.path is None else self.path.x

    @property
    def cameras(self) -> Camera:
        """N cameras of the path taken, at the output size."""
        return self.found.camera if self.path is None else self.clip.cameras(self.path.x)

    @property
    def cuts(self) -> list[int]:
        """Frames of the path taken that are seen as cuts, see :func:`.path_order.cuts`."""
        return cuts(self.x, None if self.guide is None else self.guide.x)

    @property
    def total(self) -> float:
        """Mean total in the scene that was searched, of all weights; a view that is blocked pays every penalty."""
        return self.total_in(self.clip.stage) if self.path is None else self.path.total

    def total_in(self, stage: Stage) -> float:
        """Mean total of what was found, in the scene of ``stage``; a view that is blocked there pays every penalty.

        Not counted as evaluations: of what is kept it is its score, as it is rendered for every result.
        """
        terms = stage.path_terms(self.clip.reference, self.cameras, guarded=True)
        return float(stage.objective.totals(terms, self.clip.defined).mean())

    @property
    def leaps(self) -> bool:
        """Whether a frame of the path taken costs far more than the others."""
        told = None if self.path is None else self.path.residuals
        return self.found.leaps(self.found.totals if told is None else self.clip.totals(told))


def searched(job: Job, stage: Stage, target: Features, starts: Starts, report: FrameDone) -> Take:
    """The frames of one round, and the path through them where one is asked for.

    The clip is followed leanly where that is good enough, else thoroughly too. Frames lost on the way tell nothing as
    long as the path passes them by; where it does not, there is a path through either, and the better one is taken.
    """
    clip = WholeClip(stage, job.search, target, starts.homes[0], job.starting.at)
    among, schedule = replace(clip, stage=stage.reduced(clip.home, job.config.lod)), job.schedule
    guide = None if starts.guide is None else starts.guide.x

    def taken(found: Path) -> Take:
        found = _followed_again(among, job.schedule, starts, report, found)
        path = None if job.config.path == "exact" else _least(job, clip, found, guide)
        return Take(clip, found, path, starts.guide)

    if not schedule.lean_limit or schedule.engine != "refine" or not schedule.warm:
        return taken(follow(among, starts.homes, schedule, report, guide))
    first = follow(among, starts.homes, schedule.lean, report, guide)
    if first.local is None:
        return taken(first)
    poor = first.local.total > schedule.lean_limit * clip.placed_share or first.drifts
    if not poor:
        lean = taken(first)
        if not lean.leaps:
            return lean
    second = follow(among, starts.homes, schedule, report, guide)
    return taken(_better(first, second)) if poor else min(lean, taken(second), key=lambda take: take.total)


def led_on(job: Job, stage: Stage, target: Features, starts: Starts, before: Take) -> Take | None:
    """The path that was taken ``before``, moved as a whole to where ``target`` has it now; None where it asks for more.

    Networks are biased steadily along a clip, so that aiming off asks for a smooth move, which no frame has to be
    searched for. What costs clearly more than before is searched anew, and so are frames as they were found, which
    shake, and a path that is static or linear, which may be so only because the networks' noise hides that it bends.
    """
    path, effort = before.path, Effort(job.config.joint, job.config.joint_steps)
    if path is None or path.residuals is None or starts.guide is None or not (effort.rounds and job.config.warm_start):
        return None
    if path.steady or (path.knots is None and not path.filtered):
        return None
    clip = WholeClip(stage, job.search, target, starts.homes[0], job.starting.at)
    x, about = starts.guide.x, None if path.about is None else before.clip.about(clip.home, path.about)
    total, residuals = clip.scored(x)
    moved = refined(clip, replace(path, x=x, about=about, total=total, free=total, residuals=residuals), effort)
    if moved.total > path.total + path.floor:
        return None
    return Take(clip, before.found, moved, starts.guide)


def _least(job: Job, clip: WholeClip, found: Path, guide: Tensor | None) -> LeastPath:
    local = found.local
    if local is not None and job.config.lod > 0:  # merged, the scene has other residuals
        local = replace(local, residuals=clip.residuals(found.x))
    effort = Effort(job.config.joint, job.config.joint_steps)
    return least_path(clip, found.x, local, job.noise, effort, guide, job.config.zoom == "still")


def _followed_again(clip: WholeClip, schedule: Schedule, starts: Starts, report: FrameDone, found: Path) -> Path:
    """Once more at other distances, where part of ``found`` ended right and the rest would cost less at its own."""
    if found.local is None or starts.guide is None or clip.stage.scene.subject is None:
        return found
    again = second_guide(clip, starts.guide, found.x, found.totals)
    if again is None or not again.gains(clip, found.x, clip.totals(found.local.residuals)):
        return found
    homes = concatenate([starts.homes, again.first_views(clip)])
    return _better(found, follow(clip, homes, schedule.lean, report, again.x))


def _better(first: Path, second: Path) -> Path:
    assert first.local is not None
    return second if second.local is not None and second.local.total < first.local.total else first
