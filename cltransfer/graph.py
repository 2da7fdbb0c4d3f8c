"""Which extractors the active losses need, in which order; running them; nothing else is computed.

A source has features of its own: a clip has ``image``, a renderer its buffers, the camera and the person. The plan
starts from what the losses require and walks back to the source, so a loss that is switched off takes its networks
and buffers with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import torch
from torch import Tensor

from .errors import UsageError
from .features import Features

Family = Literal["image", "scene"]
CLIP_SOURCE = frozenset({"image"})
CHUNK = 8  # frames of a clip extracted together: 8 frames of 960x540 take 50 MB as float


@dataclass(frozen=True)
class Step:
    """One extractor, and the optional features it must not see because the other side lacks them."""

    name: str
    extractor: Any
    hidden: tuple[str, ...] = ()

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with what this extractor provides."""
        blank: dict[str, Any] = dict.fromkeys(self.hidden)
        got = self.extractor(replace(now, **blank), before)
        missing = [name for name in self.extractor.provides if not got.has(name)]
        if missing:
            raise UsageError("", f"extractor {self.name}", f"promised {missing[0]!r} and did not provide it")
        return replace(got, **{name: getattr(now, name) for name in self.hidden})


@dataclass(frozen=True)
class Plan:
    """What to run for one source.

    Args:
        steps: extractors in order.
        buffers: what the source has to deliver, a subset of what it has.
        wanted: features the losses ask for, and those they use that can be had.
        missing: wanted features that this source cannot give, with the reason.
    """

    steps: tuple[Step, ...]
    buffers: frozenset[str]
    wanted: frozenset[str]
    missing: Mapping[str, str]

    @property
    def passes(self) -> int:
        """Network passes one frame costs."""
        return sum(getattr(step.extractor, "passes", 0) for step in self.steps)

    def load_networks(self) -> None:
        """Load every network now, so that a missing one is told before any frame is read or rendered.

        Raises:
            ModelError: a network is missing or refused.
        """
        for step in self.steps:
            network = getattr(step.extractor, "network", None)
            if network is not None:
                _ = network.session

    @property
    def needs_before(self) -> bool:
        """Whether a step compares with the frame before."""
        return any(_needs_before(step) for step in self.steps)


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
    return Plan(tuple(planner.steps), frozenset(planner.buffers), wanted | welcome, missing)


class _Planner:
    """Walks back from a feature to the source, collecting steps in the order they must run."""

    def __init__(
        self, extractors: Mapping[str, Any], source: frozenset[str], family: Family, shared: frozenset[str] | None
    ) -> None:
        self.extractors, self.source, self.family, self.shared = extractors, source, family, shared
        self.steps: list[Step] = []
        self.buffers: set[str] = set()
        self.done: set[str] = set()

    def reach(self, feature: str, path: tuple[str, ...]) -> str:
        """Empty if ``feature`` can be had (and its steps are planned), else the reason."""
        if feature in self.done:
            return ""
        if feature in self.source:
            self.buffers.add(feature)
            return ""
        if feature in path:
            raise UsageError("", "extractors", f"circle: {' -> '.join((*path, feature))}")
        name = self._provider(feature)
        if name is None:
            return f"no {self.family} extractor provides {feature!r}"
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

    def _provider(self, feature: str) -> str | None:
        order = (("scene", "both"), ("image",)) if self.family == "scene" else (("image", "both"),)
        for families in order:
            found = [n for n, e in self.extractors.items() if feature in e.provides and e.family in families]
            if len(found) > 1:
                raise UsageError("", "extractors", f"{' and '.join(found)} both provide {feature!r}", "set one to null")
            if found:
                return found[0]
        return None


def run(plan: Plan, now: Features, before: Features | None) -> Features:
    """``now`` with every step of ``plan`` done; ``before`` is the frame before, None for a first frame."""
    for step in plan.steps:
        if _needs_before(step) and before is None:
            now = _undefined(now, step)
        else:
            now = step(now, before if _needs_before(step) else None)
    return now


def run_clip(
    plan: Plan,
    load: Callable[[int, int], Features],
    count: int,
    progress: Callable[[int], None] = lambda done: None,
) -> Features:
    """Features of a clip of ``count`` frames, without its pixels.

    ``load(start, stop)`` delivers the source's features of a few frames at a time, so that memory does not grow with
    the clip. The first frame has no flow: NaN.
    """
    parts: list[Features] = []
    last: Features | None = None
    for start in range(0, count, CHUNK):
        now = load(start, min(start + CHUNK, count))
        done = _run_chunk(plan, now, last)
        last = done[len(done) - 1]
        keep = plan.wanted | {"camera", "person"}
        parts.append(_only(done, keep))
        progress(min(start + CHUNK, count))
    return Features.concatenate(parts)


def _run_chunk(plan: Plan, now: Features, last: Features | None) -> Features:
    for step in plan.steps:
        if not _needs_before(step):
            now = step(now, None)
        elif last is not None:
            inputs = Features.concatenate([_only(last, now.names()), now])
            now = step(now, inputs[list(range(len(now)))])
        elif len(now) == 1:
            now = _undefined(now, step)
        else:
            later = step(now[1:], now[:-1])
            for name in step.extractor.provides:
                value = later.require(name)
                first = torch.full_like(value[:1], float("nan"))
                now = _with(now, name, torch.cat([first, value]))
    return now


def _needs_before(step: Step) -> bool:
    return bool(getattr(step.extractor, "needs_before", False))


def _undefined(now: Features, step: Step) -> Features:
    """What a step that compares with the frame before gives a first frame: NaN, of the shape of a flow."""
    for name in step.extractor.provides:
        shape = {"flow": (2, *_map_size(now)), "flow_confidence": _map_size(now)}.get(name, (1,))
        now = _with(now, name, torch.full((len(now), *shape), float("nan")))
    return now


def _map_size(now: Features) -> tuple[int, int]:
    for name in ("depth", "image", "subject"):
        if now.has(name):
            height, width = now.require(name).shape[-2:]
            return height, width
    return now.size[1], now.size[0]


def _with(features: Features, name: str, value: Tensor) -> Features:
    if name in Features.__dataclass_fields__:
        return replace(features, **{name: value})  # type: ignore[arg-type]
    return replace(features, extras={**features.extras, name: value})


def _only(features: Features, names: Iterable[str]) -> Features:
    keep = set(names)
    blank: dict[str, Any] = {n: None for n in features.names() - keep if n not in features.extras}
    return replace(features, **blank, extras={n: v for n, v in features.extras.items() if n in keep})
