"""Where a search starts: the view that was given, a path in closed form, the best of an orbit around the subject."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torch import Tensor

from ..camera import Camera, concatenate
from ..errors import InputError
from ..features import Features
from ..near_plane import smaller_near
from .closed_form import Guide, closed_form
from .initial_view import any_view, best_of_orbit, first_seen
from .schedule import Schedule
from .stage import Stage
from .whole_clip import WholeClip


class NoViewError(InputError):
    """No view of a scene shows its subject as the reference does in any way."""


@dataclass(frozen=True)
class Starts:
    """Where a search starts.

    Args:
        homes: initial views, the best first.
        guide: a path that frames may start from, None where there is none.
    """

    homes: Camera
    guide: Guide | None


@dataclass(frozen=True)
class Starting:
    """How a start is found, in whichever scene.

    Args:
        search: vectors to cameras.
        schedule: how frames are searched.
        samples: frames along the clip for which distances are looked up, 0 for no path in closed form.
        view: that was given, at ``size``; None where none was.
        size: (W, H) of the result [px].
        by_networks: whether the reference was read by networks, which err about where a person looks.
        at: places of the reference's frames along the clip, (N,); None are evenly spaced.
    """

    search: Any
    schedule: Schedule
    samples: int
    view: Camera | None
    size: tuple[int, int]
    by_networks: bool
    at: Tensor | None = None  # (N,)

    def starts(self, stage: Stage, target: Features) -> Starts:
        """Where to start in the scene of ``stage``, for N frames of ``target``.

        Raises:
            UsageError: no view was given, and the scene has no subject or no term of the target tells where to stand.
            NoViewError: none was given, there is no path in closed form, and no view of the orbit scores on any term.
        """
        subject, free, view = stage.scene.subject, self.schedule.free_lens, self.view
        homes, guide = [] if view is None else [view], None
        refined = self.schedule.engine == "refine"
        if refined and self.schedule.warm and subject is not None and self.samples:
            lens = any_view(subject, self.size) if view is None else view
            samples = 1 if self.schedule.still else self.samples
            guide = closed_form(WholeClip(stage, self.search, target, lens, self.at), free, samples)
            if guide is not None:
                homes.append(self.search.cameras(guide.x[:1], lens, subject))
        placed = stage.objective.placed(target)
        unsure = (guide is None or self.by_networks) and bool(placed.any())
        if not homes or (refined and unsure and subject is not None):
            orbit = best_of_orbit(stage, first_seen(target, placed), self.size, free, view)
            if orbit is not None:
                homes.append(orbit)
        if not homes:
            options = "" if subject is None else smaller_near(stage.renderer, subject.height / 2)
            cut = f"if it is cut off before the lens, {options}; else " if options else ""
            reason, hint = "no view around the subject shows it", f"{cut}give one: --init FILE"
            raise NoViewError(stage.scene.name, "--init", reason, hint)
        return Starts(concatenate(homes), guide)
