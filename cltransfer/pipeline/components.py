"""What a config builds, and which extractors its losses need for a clip or for renders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..config.options import RunConfig
from ..errors import ModelError
from ..features import NAMES
from ..registry import EXTRACTORS
from ..registry.declared import names_of
from ..registry.typed import nearest
from .graph import check_single
from .objective import Objective
from .plan import CLIP_SOURCE, Family, Plan, Step, make_plan

SCENE_SOURCE = frozenset({"camera", "person"})


@dataclass(frozen=True)
class Components:
    """What a config builds.

    Args:
        renderer: the one renderer.
        extractors: by name.
        losses: by name, in the config's order.
    """

    renderer: Any
    extractors: Mapping[str, Any]
    losses: Mapping[str, Any]

    @classmethod
    def build(cls, config: RunConfig) -> Components:
        """Components of ``config``.

        Raises:
            UsageError: an option has the wrong type or range.
            ModelError: a loss or an extractor asks for what is no feature.
        """
        parts = cls(config.build_one("renderer"), config.build("extractors"), config.build("losses"))
        parts._check_features()
        return parts

    def _check_features(self) -> None:
        """Refuse a name that nothing can ever provide: it would only be told as missing when all is done."""
        given = {*NAMES, *self.renderer.provides, *(n for e in self.extractors.values() for n in e.provides)}
        for who, how, name in _asked("loss", self.losses):
            if name in SCENE_SOURCE:  # no reference has them: a clip shows none, and a scene's are its secret
                raise ModelError("", who, f"{how} {name!r}, which no reference has", "read it in a scene extractor")
        for who, how, name in (*_asked("extractor", self.extractors), *_asked("loss", self.losses)):
            if name not in given and name not in (known := given | _provided_by_any()):
                reason = f"{how} {name!r}, expected a feature or what an extractor provides"
                raise ModelError("", who, reason, nearest(name, known))

    @property
    def objective(self) -> Objective:
        """The losses, and which features compare a frame with the one before.

        Those of an extractor that needs the frame before, and what follows from them.
        """
        moving, before = {"flow"}, set[str]()
        while moving != before:
            before = set(moving)
            for one in self.extractors.values():
                follows = not moving.isdisjoint(one.requires) and not getattr(one, "whole_clip", False)
                if follows or getattr(one, "needs_before", False):
                    moving.update(one.provides)
        return Objective(self.losses, frozenset(moving))

    def plan(self, family: Family, shared: frozenset[str] | None = None, also: frozenset[str] = frozenset()) -> Plan:
        """Plan for a clip, or renders as pixels (image), or for renders with all a renderer knows (scene).

        ``shared`` names what the other side has: a loss that the other side cannot feed asks for nothing. ``also``
        names what is wanted beside what the losses ask for, where no network has to read it.
        """
        source = CLIP_SOURCE if family == "image" else frozenset(self.renderer.provides) | SCENE_SOURCE
        wanted: set[str] = set()
        drawn = {name for e in self.extractors.values() if e.family in ("scene", "both") for name in e.provides}
        uses = {name for name in also if name in drawn}
        for loss in self.losses.values():
            if shared is None or shared >= set(loss.requires):
                wanted.update(loss.requires)
                uses.update(getattr(loss, "uses", ()))
        return make_plan(frozenset(wanted), self.extractors, source, family, shared, frozenset(uses))

    def check_single(self, family: Family, shared: frozenset[str]) -> None:
        """Refuse an extractor of whole clips that a search would read renders by; ``shared`` as in :meth:`plan`.

        Raises:
            UsageError: there is one; what to do without it is told.
        """
        for step in self.plan(family, shared).steps:
            check_single(step, self._without(step, family, shared) if step.whole_clip else "")

    def _without(self, step: Step, family: Family, shared: frozenset[str]) -> str:
        """How a search does without an extractor of whole clips: by the scene itself, or without what needs it."""
        if family == "image" and not self.plan("scene", shared).reads_whole_clip:
            return "use extract.inner=geometric"
        alone = {name: replace(self, losses={name: loss}).plan(family, shared) for name, loss in self.losses.items()}
        asking = [f"losses.{n}" for n, plan in alone.items() if any(one.name == step.name for one in plan.steps)]
        given = " and ".join(map(repr, step.extractor.provides))
        without = " and ".join(asking) or f"extractors.{step.name}"
        return f"leave out {without}, which `evaluate` takes, or provide {given} by a scene extractor"


def _asked(kind: str, parts: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Who asks for a feature, how, and for which."""
    for name, part in parts.items():
        for how in ("requires", "uses"):
            for feature in getattr(part, how, ()):
                yield f"{kind} {name!r}", how, feature


def _provided_by_any() -> set[str]:
    """What the extractors provide that there are, in a config or not."""
    return {name for known in EXTRACTORS.names() for name in names_of(EXTRACTORS.get(known), "provides")}
