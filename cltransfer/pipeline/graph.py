"""Running a plan: on frames that stand alone, or along a clip."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ..errors import ModelError, UsageError
from ..features import Features
from ..progress import Progress, silent
from .given import check_values
from .plan import CLIP_SOURCE, Plan, Step

CHUNK = 8  # frames of a clip extracted together: 8 frames of 960x540 take 50 MB as float
Load = Callable[[int, int], Features]


def check_single(step: Step, hint: str = "") -> None:
    """Refuse an extractor that single renders cannot be read by; ``hint`` tells what to do without it.

    Raises:
        UsageError: it reads whole clips only.
    """
    if step.whole_clip:
        raise UsageError("", f"extractor {step.name}", "reads a whole clip, not single renders", hint)


def run(plan: Plan, now: Features, before: Features | None) -> Features:
    """``now`` with every step of ``plan`` done; ``before`` is the frame before, None for a first frame.

    Raises:
        UsageError: a step reads whole clips only.
    """
    for step in plan.steps:
        check_single(step)
        if step.needs_before and before is None:
            now = _undefined(now, step)
        else:
            now = step(now, before if step.needs_before else None)
    return now


def run_clip(
    plan: Plan,
    load: Load,
    count: int,
    progress: Progress = silent,
    task: str = "reading frames",
) -> Features:
    """Features of a clip of ``count`` frames, without its pixels.

    ``load(start, stop)`` delivers the source's features of a few frames at a time, so that memory does not grow with
    the clip. The first frame has no flow: NaN. What a step that reads the whole clip cannot tell is left out with the
    reason, and so is what needs it.

    ``progress`` is told of ``task`` the frames done and in all, each as often as the clip is gone through, and of each
    step that reads the whole clip when it begins.

    Raises:
        ModelError: what is read has values that the feature cannot have, or a step fails.
    """
    keep = plan.wanted | {"camera", "person"}
    between = keep if not plan.reads_whole_clip else keep | plan.passed_on - CLIP_SOURCE
    found: Features | None = None
    stages, gone = _stages(plan.steps), 0
    total = count * (1 + sum(bool(steps) for steps, _ in stages[1:]))

    def report(done: int) -> None:
        progress(task, gone + done, total)

    for steps, whole in stages:
        if steps or found is None:
            found = _in_chunks(steps, found, load, count, between, report)
            gone += count
        if whole is not None:
            progress(f"reading the clip: {whole.name}", 0, 0)
            found = _read_whole(whole, found, load, count)
            dear = frozenset(whole.extractor.provides)
            keep, between = keep | dear, between | dear
    assert found is not None  # there is at least one stage
    return found.only(keep)


def _stages(steps: Sequence[Step]) -> list[tuple[list[Step], Step | None]]:
    """Steps that look at few frames at a time, each time up to the next that reads the whole clip."""
    stages: list[tuple[list[Step], Step | None]] = []
    waiting: list[Step] = []
    for step in steps:
        if step.whole_clip:
            stages.append((waiting, step))
            waiting = []
        else:
            waiting.append(step)
    return [*stages, (waiting, None)]


def _read_whole(step: Step, found: Features, load: Load, count: int) -> Features:
    lost = _lost(step, found.reasons)
    if lost:
        return replace(found, reasons={**found.reasons, **lost})
    shown = found.only(found.names() - set(step.hidden))
    with step.named, torch.no_grad():
        got = step.checked(step.extractor.read_clip(shown, load), shown, count)
    for name in step.hidden:
        got = got.having(name, found.require(name) if found.has(name) else None)
    for name in step.extractor.provides:
        if not got.has(name) and name not in got.reasons:
            raise UsageError("", f"extractor {step.name}", f"gave neither {name!r} nor a reason")
    check_values(got, step.name, step.extractor.provides)
    return got


def _lost(step: Step, reasons: Mapping[str, str]) -> dict[str, str]:
    """Why ``step`` cannot give what it provides, because of what it requires; empty if it can."""
    lacking = [name for name in step.extractor.requires if name in reasons]
    return dict.fromkeys(step.extractor.provides, reasons[lacking[0]]) if lacking else {}


def _in_chunks(
    steps: Sequence[Step],
    found: Features | None,
    load: Load,
    count: int,
    keep: frozenset[str],
    progress: Callable[[int], None],
) -> Features:
    """Every frame through ``steps``, beside what was ``found`` before; of all that, ``keep``."""
    reasons = dict(found.reasons) if found else {}
    possible = []
    for step in steps:
        lost = _lost(step, reasons)
        reasons.update(lost)
        possible += [] if lost else [step]
    parts: list[Features] = []
    last: Features | None = None
    for start in range(0, count, CHUNK):
        stop = min(start + CHUNK, count)
        now = load(start, stop)
        if found is not None:
            now = joined(now, found[slice(start, stop)])
        done = _run_chunk(possible, now, last)
        last = done[len(done) - 1]
        parts.append(done.only(keep))
        progress(stop)
    return replace(Features.concatenate(parts), reasons=reasons)


def joined(features: Features, more: Features) -> Features:
    """``features`` with what ``more`` has of the same frames."""
    new = {name: more.require(name) for name in more.names() if name not in more.extras}
    return replace(features, **new, extras={**features.extras, **more.extras})


def _run_chunk(steps: Sequence[Step], now: Features, last: Features | None) -> Features:
    for step in steps:
        if not step.needs_before:
            now = step(now, None)
        elif last is not None:
            inputs = Features.concatenate([last.only(now.names()), now])
            now = step(now, inputs[list(range(len(now)))])
        elif len(now) == 1:
            now = _undefined(now, step)
        else:
            later = step(now[1:], now[:-1])
            for name in step.extractor.provides:
                value = later.require(name)
                now = now.having(name, torch.cat([_unknown(value[:1]), value]))
        check_values(now, step.name, step.extractor.provides)
    return now


def _undefined(now: Features, step: Step) -> Features:
    """What a step that compares with the frame before gives a first frame: NaN, of the shape of what it gives."""
    given = step(now[:1], now[:1])
    for name in step.extractor.provides:
        value = _unknown(given.require(name))
        now = now.having(name, value.expand(len(now), *value.shape[1:]).clone())
    return now


def _unknown(value: Tensor) -> Tensor:
    """Rows like those of ``value`` that say nothing: NaN, and of a mask no pixel, as it has no NaN."""
    if value.dtype is torch.bool:
        return torch.zeros_like(value)
    return torch.full_like(value, float("nan"), dtype=value.dtype if value.is_floating_point() else torch.float32)


def persons_in(detector: Step, frames: Features) -> list[np.ndarray]:
    """Boxes (P, 5) of all persons in each of the frames.

    Raises:
        ModelError: a plugin gives something else, or no pixels.
    """
    with detector.named, torch.no_grad():
        found = detector.extractor.persons(frames)
    boxes = list(found) if isinstance(found, list | tuple) else []
    if len(boxes) != len(frames) or not all(isinstance(b, np.ndarray) and b.shape[1:] == (5,) for b in boxes):
        came = f"{len(found)} of them" if isinstance(found, list | tuple) else f"a {type(found).__name__}"
        kinds = ", ".join(sorted({f"{type(b).__name__} {tuple(getattr(b, 'shape', ()))}" for b in boxes}))
        reason = f"expected an array (P, 5) of persons for each of {len(frames)} frames, got {came}"
        raise ModelError("", f"extractor {detector.name}", reason + f": {kinds}" * bool(kinds))
    told = torch.from_numpy(np.concatenate(boxes, dtype=np.float64)) if boxes else torch.empty(0, 5)
    check_values(Features(frames.size, box=told), detector.name, ("box",))
    return boxes
