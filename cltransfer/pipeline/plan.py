"""Which extractors the active losses need, in which order.

A source has features of its own: a clip has ``image``, a renderer its buffers, the camera and the person. The plan
starts from what the losses require and walks back to the source, so a loss that is switched off takes its networks
and buffers with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Literal

import torch

from ..drawing import MAPS
from ..errors import UsageError, named
from ..features import Features
from ..models.onnx import Network
from ..registry import EXTRACTORS
from .given import checked

Family = Literal["image", "scene"]
CLIP_SOURCE = frozenset({"image"})
OFF_AT_FIRST = {  # what no default reads off a clip, and what would
    "depth": " (extractors.depth_sfm={} does where the camera moves, extractors.depth_onnx by a network: docs/score.md)"
}


@dataclass(frozen=True)
class Step:
    """One extractor, and the optional features it must not see because the other side lacks them."""

    name: str
    extractor: Any
    hidden: tuple[str, ...] = ()

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with what this extractor provides; of the frame ``before`` it sees no more than of ``now``."""
        shown = now.names() - set(self.hidden)
        with self.named, torch.no_grad():
            given = now.only(shown)
            got = self.checked(self.extractor(given, None if before is None else before.only(shown)), given, len(now))
        missing = [name for name in self.extractor.provides if not got.has(name)]
        if missing:
            raise UsageError("", f"extractor {self.name}", f"promised {missing[0]!r} and did not provide it")
        for name in self.hidden:
            got = got.having(name, now.require(name) if now.has(name) else None)
        return got

    def checked(self, got: Any, given: Features, count: int) -> Features:
        """``got``, which the extractor has made of ``count`` frames of which it was ``given`` something, or nothing.

        Raises:
            ModelError: see :func:`~cltransfer.pipeline.given.checked`.
        """
        return checked(got, given, count, self.name, self.extractor.provides)

    @property
    def named(self) -> AbstractContextManager[None]:
        """Runs the extractor's code: whatever it raises is told with its name."""
        return named(f"extractor {self.name}", f"expected {', '.join(self.extractor.provides)}")

    @property
    def uses(self) -> tuple[str, ...]:
        """Features it takes where both sides of a comparison have them."""
        return tuple(getattr(self.extractor, "uses", ()))

    @property
    def needs_before(self) -> bool:
        """Whether it compares with the frame before."""
        return bool(getattr(self.extractor, "needs_before", False))

    @property
    def passes(self) -> int:
        """Network passes one frame costs."""
        return int(getattr(self.extractor, "passes", 0))

    @property
    def whole_clip(self) -> bool:
        """Whether it reads whole clips only."""
        return bool(getattr(self.extractor, "whole_clip", False))


@dataclass(frozen=True)
class Plan:
    """What to run for one source.

    Args:
        steps: extractors in order.
        buffers: what the source has to deliver, a subset of what it has.
        wanted: features the losses ask for, and those that they or a step use and that can be had.
        missing: wanted features that this source cannot give, with the reason.
    """

    steps: tuple[Step, ...]
    buffers: frozenset[str]
    wanted: frozenset[str]
    missing: Mapping[str, str]

    @property
    def passes(self) -> int:
        """Network passes one frame costs."""
        return sum(step.passes for step in self.steps)

    @property
    def notes(self) -> tuple[str, ...]:
        """What extractors say themselves of what they read, as their ``note``."""
        told = ((step.name, getattr(step.extractor, "note", "")) for step in self.steps)
        return tuple(f"{name}: {note}" for name, note in told if note)

    @property
    def detector(self) -> Step | None:
        """The extractor that sees all persons, None where there is none."""
        return next((step for step in self.steps if hasattr(step.extractor, "persons")), None)

    @property
    def doubts_boxes(self) -> bool:
        """Whether all that read the person in a box say of one that nobody is in it: then a box may be a guess."""
        readers = [step.extractor for step in self.person_known.steps if "box" in step.extractor.requires]
        return bool(readers) and all(getattr(reader, "doubts_boxes", False) for reader in readers)

    @property
    def person_known(self) -> Plan:
        """The same where the person's box is given: one that tells more reads that person, a mere detector goes."""
        if self.detector is None:
            return self
        only = set(self.detector.extractor.provides) == {"box"}
        steps = tuple(step for step in self.steps if not (only and step is self.detector))
        return replace(self, steps=steps, wanted=self.wanted | {"box"})

    @property
    def clip_passes(self) -> int:
        """Network passes one frame of a clip costs: all persons are found there, then one is read."""
        finding = 0 if self.detector is None else self.detector.passes
        return finding + self.person_known.passes

    def hiding(self, names: AbstractSet[str]) -> Plan:
        """The same where no step sees any of ``names`` that it can do without."""
        steps = []
        for step in self.steps:
            more = [name for name in step.uses if name in names and name not in step.hidden]
            steps.append(replace(step, hidden=(*step.hidden, *more)))
        return replace(self, steps=tuple(steps))

    def load_networks(self) -> None:
        """Load every network now, so that a missing one is told before any frame is read or rendered.

        Raises:
            ModelError: a network is missing or refused, or a plugin's raises something of its own.
        """
        for step in self.steps:
            with step.named:
                network = getattr(step.extractor, "network", None)
                if isinstance(network, Network):  # anybody else's is loaded by now
                    _ = network.session

    @property
    def reads_whole_clip(self) -> bool:
        """Whether a step reads whole clips only."""
        return any(step.whole_clip for step in self.steps)

    @property
    def passed_on(self) -> frozenset[str]:
        """Everything a step takes."""
        return frozenset(n for step in self.steps for n in (*step.extractor.requires, *step.uses))


def make_plan(
    wanted: frozenset[str],
    extractors: Mapping[str, Any],
    source: frozenset[str],
    family: Family,
    shared: frozenset[str] | None = None,
    uses: frozenset[str] = frozenset(),
) -> Plan:
    """Plan for the ``wanted`` features from ``source``.

    Args:
        wanted: what the losses require.
        extractors: configured extractors by name.
        source: features the source has.
        family: image reads with image extractors only; scene prefers scene extractors.
        shared: features the other side of the comparison has, None if this side is read first. An extractor's
            optional inputs are used only when both sides have them, so that both are read by one rule.
        uses: what the losses take where it can be had; nothing is missing without it.

    Raises:
        UsageError: two extractors of one family provide the same feature, or extractors need one another in a circle.
    """
    planner = _Planner(extractors, source, family, shared)
    missing = {}
    for name in sorted(wanted):
        reason = planner.reach(name, ())
        if reason:
            missing[name] = reason
    welcome = {name for name in sorted(uses) if planner.welcomes(name)}
    kept = wanted | welcome | planner.optional - CLIP_SOURCE
    return Plan(tuple(planner.steps), frozenset(planner.buffers), kept, missing)


class _Planner:
    """Walks back from a feature to the source, collecting steps in the order they must run."""

    def __init__(
        self, extractors: Mapping[str, Any], source: frozenset[str], family: Family, shared: frozenset[str] | None
    ) -> None:
        self.extractors, self.source, self.family, self.shared = extractors, source, family, shared
        self.steps: list[Step] = []
        self.buffers: set[str] = set()
        self.done: set[str] = set()

    @property
    def optional(self) -> frozenset[str]:
        """What steps take though they could do without: the other side has to be read by the same rule."""
        return frozenset(n for step in self.steps for n in step.uses if n not in step.hidden)

    def reach(self, feature: str, path: tuple[str, ...]) -> str:
        """Empty if ``feature`` can be had (and its steps are planned), else the reason."""
        if feature in self.done:
            self._provider(feature)  # two are a mistake even where one of them runs for another feature
            return ""
        if feature in self.source:
            self.buffers.add(feature)
            return ""
        if feature in path:
            raise UsageError("", "extractors", f"circle: {' -> '.join((*path, feature))}")
        name = self._provider(feature)
        if name is None and self.family == "scene" and feature in MAPS:
            return f"the renderer draws no {feature!r} (it is to be named in its provides)"
        if name is None:
            return f"no {self.family} extractor provides {feature!r}{self._hint(feature)}"
        before = (len(self.steps), set(self.buffers), set(self.done))
        for needed in self.extractors[name].requires:
            reason = self.reach(needed, (*path, feature))
            if reason:
                del self.steps[before[0] :]
                self.buffers, self.done = before[1], before[2]
                return f"{name} needs {needed!r}: {reason}"
        self.steps.append(Step(name, self.extractors[name], self._hidden(name, (*path, feature))))
        self.done.update(self.extractors[name].provides)
        return ""

    def welcomes(self, feature: str) -> bool:
        """Plan a feature that nobody requires, unless its provider would replace what another was planned for."""
        name = None if feature in self.done | self.source else self._provider(feature)
        if name is not None and self.done & set(self.extractors[name].provides):
            return False
        return not self.reach(feature, ())

    def _hidden(self, name: str, path: tuple[str, ...]) -> tuple[str, ...]:
        hidden = []
        for optional in getattr(self.extractors[name], "uses", ()):
            allowed = self.shared is None or optional in self.shared
            if not allowed or self.reach(optional, path):
                hidden.append(optional)
        return tuple(hidden)

    def _hint(self, feature: str) -> str:
        """What would give ``feature`` if it were in use, an allowed plugin first; empty where nothing is known to."""
        for name, cls in EXTRACTORS.registered().items():
            if cls.__module__.startswith("cltransfer.") or name in self.extractors:
                continue
            gives = getattr(cls, "provides", ())  # a property where its options tell, as the family may be
            reads = self.family == "scene" or getattr(cls, "family", "") != "scene"
            if reads and isinstance(gives, tuple | list | set | frozenset) and feature in gives:
                return f" (extractors.{name}={{}} does)"
        return OFF_AT_FIRST.get(feature, "") if self.family == "image" else ""

    def _provider(self, feature: str) -> str | None:
        order = (("scene", "both"), ("image",)) if self.family == "scene" else (("image", "both"),)
        for families in order:
            found = [n for n, e in self.extractors.items() if feature in e.provides and e.family in families]
            if len(found) > 1:
                raise UsageError("", "extractors", f"{' and '.join(found)} both provide {feature!r}", "set one to null")
            if found:
                return found[0]
        return None
