"""Scores: the terms of N frames with their coverage. The losses are the metrics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from ..features import Features
from .objective import Objective


@dataclass(frozen=True, eq=False)
class Term:
    """One loss over N frames.

    Args:
        name: of the loss.
        unit: of its raw value.
        weight: lambda of Eq. 15.
        values: raw, (N,); NaN where undefined.
        reason: why it is undefined, where it is.
        had: whether the reference has it on any frame, so that a total is charged where the render has not.
    """

    name: str
    unit: str
    weight: float
    values: Tensor  # (N,)
    reason: str = ""
    had: bool = False

    @property
    def defined(self) -> int:
        """Frames that have a value."""
        return int(torch.isfinite(self.values).sum())

    @property
    def mean(self) -> float | None:
        """Mean raw value over the frames that have one; None where none has."""
        values = self.values[torch.isfinite(self.values)]
        return float(values.mean()) if len(values) else None

    @property
    def why_not(self) -> str:
        """Why frames have no value; empty where all have one."""
        known = torch.isfinite(self.values)
        if self.reason or bool(known.all()):
            return self.reason
        return "undefined on the first frame" if bool(known[1:].all()) else "undefined on some frames"


@dataclass(frozen=True, eq=False)
class Scores:
    """All terms of one path.

    Args:
        terms: in the order of the config, of N frames each.
        totals: weighted sum of Eq. 15 per frame, (N,), with what the objective charges for undefined terms; NaN where
            the reference has none that weighs anything.
    """

    terms: tuple[Term, ...]
    totals: Tensor  # (N,)

    def __post_init__(self) -> None:
        for term in self.terms:
            if term.values.shape != self.totals.shape:
                raise ValueError(f"{term.name} must be {tuple(self.totals.shape)}, got {tuple(term.values.shape)}")

    @property
    def total(self) -> float:
        """Mean total over the frames that have one; NaN where none has."""
        return float(self.totals.nanmean())

    def term(self, name: str) -> Term | None:
        """The term called ``name``."""
        return next((term for term in self.terms if term.name == name), None)


def score(objective: Objective, reference: Features, rendered: Features, missing: Mapping[str, str]) -> Scores:
    """Score N rendered frames against N reference frames.

    ``missing`` says why the reference lacks a feature, by feature.
    """
    return tabulate(objective, reference, objective.terms(reference, rendered), missing, rendered)


def tabulate(
    objective: Objective,
    reference: Features,
    values: Tensor,
    missing: Mapping[str, str],
    rendered: Features | None = None,
) -> Scores:
    """Scores of raw terms (N, L) that were measured against ``reference``, of ``rendered`` where that is at hand."""
    defined = objective.defined(reference)
    terms = []
    for i, (name, loss) in enumerate(objective.losses.items()):
        had = bool(defined[:, i].any())
        reason = _lacking(loss, reference, missing, "the reference")
        if not reason and not had:
            alone = len(values) == 1 and objective.moves(loss)
            reason = "needs two frames, one is scored" if alone else "undefined on every frame of the reference"
        if not reason and not torch.isfinite(values[:, i]).any():
            reason = "" if rendered is None else _lacking(loss, rendered, {}, "the render")
            reason = reason or "undefined on every frame of the render"
        terms.append(Term(name, loss.unit, loss.weight, values[:, i], reason, had))
    return Scores(tuple(terms), frame_totals(objective, values, defined))


def frame_totals(objective: Objective, values: Tensor, defined: Tensor) -> Tensor:
    """Totals (N,) of raw terms (N, L); NaN where the reference has none that counts.

    ``defined`` says which it has, (N, L) or (1, L) bool. Those count that weigh something; all, where no loss does.
    """
    counts = objective.weighs | ~objective.weighs.any()
    return objective.totals(values, defined).masked_fill(~(defined & counts).any(1), torch.nan)


def _lacking(loss: object, side: Features, missing: Mapping[str, str], whose: str) -> str:
    """Why ``side`` has not all that ``loss`` requires; empty if it has."""
    lacking = [name for name in loss.requires if not side.has(name)]  # type: ignore[attr-defined]
    if not lacking:
        return ""
    told = {**missing, **side.reasons}.get(lacking[0])
    if told is None:
        return f"{whose} has no {lacking[0]!r}"
    return told if lacking[0] in missing else f"{whose} has no {lacking[0]!r}: {told}"
