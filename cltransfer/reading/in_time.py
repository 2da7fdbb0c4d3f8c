"""Movement of a render in the steps of its reference, where the two have other steps in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from ..features import Features
from ..pipeline.plan import Plan, Step

ROUNDED = 0.0011  # [s]: some videos keep milliseconds, and a step has two of them
WHOLE = 1e-5  # [s] from a whole millisecond
SHARE = 0.03  # of a step, by which others may differ: 29.97 frames a second are 30, and 24 are not 25


@dataclass(frozen=True, eq=False)
class InTime:
    """Flow of the steps of a render as it were in those of its reference: a step of every plan, of no registry.

    Args:
        share: that a step of the render is to be of, (N,), 1 for the first frame.
    """

    share: Tensor  # (N,)

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("flow",)
    provides: ClassVar[tuple[str, ...]] = ("flow",)
    whole_clip: ClassVar[bool] = True

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        """Every frame's flow by its share."""
        flow = found.require("flow")
        return replace(found, flow=flow * self.share.to(flow)[:, None, None, None])


def in_time(plan: Plan, original: Tensor, shown: Tensor) -> Plan:
    """``plan`` for frames whose steps take ``shown`` [s], with the flow of steps of ``original`` [s], (N - 1,) each.

    What is read from flow is read from that, but for what reads whole clips, which may be geometry. Steps that differ
    by no more than their times are rounded are the same.
    """
    if not in_other_steps(original, shown) or not any("flow" in step.extractor.provides for step in plan.steps):
        return plan
    other = _other(original, shown)
    share = torch.cat([torch.ones(1, dtype=original.dtype), torch.where(other, original / shown, 1.0)])
    after = _in_time(plan)
    before = [step for step in plan.steps if step not in after]
    return replace(plan, steps=(*before, Step("in_time", InTime(share)), *after))


def in_other_steps(original: Tensor, shown: Tensor) -> bool:
    """Whether any of the steps [s], (N - 1,) each, takes another time than its counterpart."""
    return bool(_other(original, shown).any())


def _other(original: Tensor, shown: Tensor) -> Tensor:
    """Which of the steps [s], (N - 1,) each, take another time than their counterpart, (N - 1,) bool."""
    rounded = _rounded(original) or _rounded(shown)
    return (original - shown).abs() > (ROUNDED if rounded else (SHARE * original).clamp(max=ROUNDED))


def _rounded(steps: Tensor) -> bool:
    """Whether ``steps`` (N - 1,) [s] are of a clip that keeps milliseconds and plays at a rate that needs more.

    >>> _rounded(torch.tensor([0.004, 0.004, 0.005])), _rounded(torch.tensor([0.005, 0.005, 0.010]))
    (True, False)
    """
    if not len(steps):
        return False
    counted = steps / steps.min()
    kept = (steps - steps.round(decimals=3)).abs() < WHOLE
    return bool(kept.all() and ((counted - counted.round()).abs() * steps.min() > WHOLE).any())


def own_steps(plan: Plan, losses: Mapping[str, Any]) -> list[str]:
    """Losses that compare what is read from two frames of each side and is no flow, which nobody can put in time.

    So is what a reader of whole clips makes of a flow that stays as it is.
    """
    between = [step for step in plan.steps if step.needs_before]
    between += [step for step in plan.steps if "flow" in _takes(step) and step not in _in_time(plan)]
    names = {name for step in between if "flow" not in step.extractor.provides for name in step.extractor.provides}
    names |= {name for step in _after(plan, names) for name in step.extractor.provides}
    return [name for name, loss in losses.items() if not names.isdisjoint(loss.requires)]


def _in_time(plan: Plan) -> list[Step]:
    """Steps that are to have the flow of other steps in time, or follow from some that have, in order."""
    return _after(plan, {"flow"}, {"flow"})


def _after(plan: Plan, names: set[str], whole: AbstractSet[str] = frozenset()) -> list[Step]:
    """Steps that follow from any of ``names``, in order; those that read whole clips from others than ``whole``."""
    known, found = set(names), []
    for step in plan.steps:
        if not known.isdisjoint(_takes(step) - whole if step.whole_clip else _takes(step)):
            known.update(step.extractor.provides)
            found.append(step)
    return found


def _takes(step: Step) -> set[str]:
    return {*step.extractor.requires, *step.uses} - set(step.hidden)
