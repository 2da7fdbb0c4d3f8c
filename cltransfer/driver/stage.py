"""A stage: the scene, seen by the extractors that the objective needs. It counts what it spends."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..drawing import drawn_by
from ..features import Features
from ..pipeline.graph import persons_in, run
from ..pipeline.objective import Across, Objective
from ..pipeline.plan import Plan
from ..scenes import Scene
from ..scenes.person.find_people import boxes_of_subject
from .guard import SCENE_DEPTH, Guard
from .journal import Journal, small_print
from .recent import Context, Recent, moving, standing
from .view import View
from .working_set import WorkingSet

AHEAD = 8  # frames of a path rendered together: threads draw a view each, which is quicker than sharing one


@dataclass
class Spent:
    """What a search and reading its result back have cost so far; the reference and the lift are read beside it."""

    evaluations: int = 0
    renders: int = 0
    network_passes: int = 0
    generations: int = 0


@dataclass(frozen=True)
class Stage:
    """Cameras to features to terms, for candidates of one frame or for a whole path.

    Args:
        scene: what is rendered.
        renderer: by what.
        plan: extractors that read the renders.
        objective: the active losses.
        size: (W, H) of the renders [px]; cameras of any size are rendered at this one.
        spent: the counter.
        working: what ``scene`` is merged from, where it is merged.
        guard: views that the search may not take, None where it may take all.
        journal: what the objective makes of what is seen, kept on disk and taken from there; None where a run is not to
            be gone on with.
        recent: views that were seen last, and are not rendered again.
    """

    scene: Scene
    renderer: Any
    plan: Plan
    objective: Objective
    size: tuple[int, int]
    spent: Spent = field(default_factory=Spent)
    working: WorkingSet | None = None
    guard: Guard | None = None
    journal: Journal | None = None
    recent: Recent = field(default_factory=Recent)

    def reduced(self, camera: Camera, k: float) -> Stage:
        """The stage for a search about ``camera`` (1), merged to voxels of ``k`` pixels at first; whole where k is 0.

        Raises:
            UsageError: k is not 0 and the scene is not made of splats.
        """
        if k == 0:
            return self
        working = WorkingSet(self.scene, camera.at_size(self.size), k)
        return replace(self, scene=working.scene, working=working)

    def about(self, camera: Camera) -> Stage:
        """The stage for the next frame, about ``camera`` (1): merged anew where it is to be finer, or has moved far."""
        if self.working is None:
            return self
        working = self.working.about(camera.at_size(self.size))
        return replace(self, scene=working.scene, working=working)

    def features(self, cameras: Camera, before: View | None) -> Features:
        """Features of B cameras, looked at now; see :meth:`view`."""
        return self.view(cameras, before).features

    def view(self, cameras: Camera, before: View | None) -> View:
        """The view of B cameras, counted; ``before`` is the frame before, shared by all, or None for a first frame.

        A single one that was seen lately with the same frame before it is not rendered again. One that shows what the
        frame before does is that frame, the same object, so that a camera that stands is rendered but three times.
        """
        known = self._known(cameras, before) if len(cameras) == 1 else None
        return self._new(cameras, before, lambda: self._rendered(cameras)) if known is None else known

    def path(self, cameras: Camera) -> Iterator[View]:
        """Views of a path of N cameras, frame by frame, each with the one before it."""
        before, ahead = None, deque[Callable[[], Features]]()
        for i in range(len(cameras)):
            now = self._known(cameras[i], before)
            if now is None:
                if not ahead:
                    ahead += self._ahead(cameras[i : i + moving(cameras[i : i + AHEAD])])
                now = self._new(cameras[i], before, ahead.popleft())
            elif ahead:  # it was to be rendered with those before it, and is known by now
                ahead.popleft()
            yield now
            before = now

    def _ahead(self, cameras: Camera) -> list[Callable[[], Features]]:
        """Renders of each of B cameras, drawn together when the first is wanted."""
        drawn = cache(lambda: self._rendered(cameras))
        return [partial(lambda j: drawn()[j], j) for j in range(len(cameras))]

    def _known(self, camera: Camera, before: View | None) -> View | None:
        return self.recent.find(self._context(before), camera)

    def _stands(self, cameras: Camera, before: View | None) -> bool:
        """Whether it is one camera that is known to show what the frame before does."""
        return len(cameras) == 1 and before is not None and self._known(cameras, before) is before

    def _context(self, before: View | None) -> Context:
        return Context(self.scene, self.renderer, self.plan, self.guard is not None, self.size, before)

    def _rendered(self, cameras: Camera) -> Features:
        buffers = self.plan.buffers - {"camera", "person"} | ({"depth"} if self.guard else set())
        return drawn_by(self.renderer, self.scene, cameras.at_size(self.size), buffers)

    def _seen(self, rendered: Features, before: Features | None) -> Features:
        seen = self._read(rendered, before)
        if self.guard is None or seen.depth is rendered.depth:
            return seen
        return replace(seen, extras={**seen.extras, SCENE_DEPTH: rendered.require("depth")})

    def _read(self, rendered: Features, before: Features | None) -> Features:
        """What the extractors read: of several people who is filmed, where networks read, and not the largest."""
        detector, person = self.plan.detector, self.scene.subject
        if detector is None or person is None or (person.people or 1) < 2 or rendered.camera is None:
            return run(self.plan, rendered, before)
        box = boxes_of_subject(person, rendered.camera, persons_in(detector, rendered))
        return run(self.plan.person_known, replace(rendered, box=box), before)

    def _new(self, cameras: Camera, before: View | None, rendered: Callable[[], Features]) -> View:
        def look() -> Features:
            return self._seen(rendered(), None if before is None else before.features)

        self._count(len(cameras))
        view = standing(View(cameras, look, before), before)
        self.recent.add(self._context(before), view)
        return view

    def _count(self, renders: int) -> None:
        self.spent.renders += renders
        self.spent.network_passes += renders * self.plan.passes

    def terms(self, reference: Features, cameras: Camera, before: View | None) -> Tensor:
        """Raw terms (B, L) of B candidates for one reference frame; a view that is blocked has none."""
        view = self._candidates(cameras, before)
        return self._told("terms", reference, cameras, lambda: self._allowed(reference, view.features))

    def residuals(self, reference: Features, cameras: Camera, before: View | None, defined: Tensor) -> Tensor:
        """Weighted residuals (B, R) of B candidates for one reference frame; a blocked view pays every penalty."""
        view = self._candidates(cameras, before)
        return self._told("residuals", reference, cameras, lambda: self.priced(reference, view.features, defined))

    def _candidates(self, cameras: Camera, before: View | None) -> View:
        self.spent.evaluations += 0 if self._stands(cameras, before) else len(cameras)
        return self.view(cameras, before)

    def told(self, reference: Features, view: View, defined: Tensor) -> Tensor:
        """:meth:`residuals` (B, R) of a view that is there; no evaluation."""
        return self._told("told", reference, view.cameras, lambda: self.priced(reference, view.features, defined))

    def told_across(self, reference: Features, view: View, defined: Tensor) -> Across:
        """:meth:`across` of a view that is there; no evaluation."""

        def across() -> Tensor:
            return self.across(reference, view.features, defined).beside

        return Across.apart(self._told("across", reference, view.cameras, across))

    def priced(self, reference: Features, seen: Features, defined: Tensor) -> Tensor:
        """Weighted residuals (B, R) of what was seen from B cameras; a blocked view pays every penalty."""
        residuals = self.objective.residuals(reference, seen, defined)
        if self.guard is None:
            return residuals
        blocked = self.guard.blocked(seen, reference)[:, None]
        return torch.where(blocked, self.objective.lost_residuals(defined), residuals)

    def across(self, reference: Features, seen: Features, defined: Tensor) -> Across:
        """:meth:`priced`, (B, R), and the same beyond jumps of the losses; there is nothing beyond a blocked view."""
        told = self.objective.across(reference, seen, defined)
        if self.guard is None:
            return told
        blocked = self.guard.blocked(seen, reference)[:, None]
        lost = self.objective.lost_residuals(defined)
        return Across(
            torch.where(blocked, lost, told.residuals),
            torch.where(blocked, lost, told.beyond),
            torch.where(blocked, 0.0, told.far),
        )

    def _allowed(self, reference: Features, seen: Features) -> Tensor:
        """Raw terms (B, L) of what was seen from B cameras; a view that is blocked has none."""
        terms = self.objective.terms(reference, seen)
        return (
            terms if self.guard is None else terms.masked_fill(self.guard.blocked(seen, reference)[:, None], torch.nan)
        )

    def path_terms(self, reference: Features, cameras: Camera, guarded: bool = False) -> Tensor:
        """Raw terms (N, L) of a path, frame by frame; where ``guarded``, a view that is blocked has none."""
        score = self._allowed if guarded else self.objective.terms
        return self._path_told("path terms", reference, cameras, lambda i, seen: score(reference[i], seen))

    def path_residuals(self, reference: Features, cameras: Camera, defined: Tensor) -> Tensor:
        """Weighted residuals (N, R) of a path, frame by frame against N reference frames; blocked views pay too.

        ``defined``, (N, L) bool, says which terms the reference has.

        Raises:
            ValueError: a loss has no residuals.
        """
        if self.objective.groups is None:
            raise ValueError("a path is refined by the residuals of every loss")

        def priced(i: int, seen: Features) -> Tensor:
            return self.priced(reference[i], seen, defined[i])

        return self._path_told("path residuals", reference, cameras, priced)

    def path_across(self, reference: Features, cameras: Camera, defined: Tensor) -> Across:
        """:meth:`across` of a path, frame by frame against N reference frames, (N, R)."""

        def across(i: int, seen: Features) -> Tensor:
            return self.across(reference[i], seen, defined[i]).beside

        return Across.apart(self._path_told("path across", reference, cameras, across))

    def _path_told(
        self, kind: str, reference: Features, cameras: Camera, tell: Callable[[int, Features], Tensor]
    ) -> Tensor:
        """What is told of each frame of a path, (N, C), whose views are looked at one by one."""
        views = self.path(cameras)

        def compute() -> Tensor:
            return torch.cat([tell(i, view.features) for i, view in enumerate(views)])

        told = self._told(kind, reference, cameras, compute)
        deque(views, maxlen=0)  # where the journal has answered they are counted, and not looked at
        return told

    def _told(self, kind: str, reference: Features, cameras: Camera, compute: Callable[[], Tensor]) -> Tensor:
        """What is told of ``cameras``; where the journal answers nothing is looked at."""
        if self.journal is None:
            return compute()
        return self.journal.answer(cameras, compute, small_print(reference, kind), self._columns(kind))

    def _columns(self, kind: str) -> int:
        """How many numbers a camera gets of what is told."""
        groups = self.objective.groups
        if groups is None or kind.endswith("terms"):
            return len(self.objective.losses)
        return 3 * len(groups) if kind.endswith("across") else len(groups)


def read_path(stage: Stage, cameras: Camera) -> Features:
    """Features of a path by the stage's extractors, each frame with the one before it; its pixels only for a loss."""
    kept = "image" in stage.plan.wanted
    path = (view.features for view in stage.path(cameras))
    return Features.concatenate([seen if kept else replace(seen, image=None) for seen in path])
