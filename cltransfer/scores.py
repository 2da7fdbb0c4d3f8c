"""Scores: the terms of N frames with their coverage. The losses are the metrics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from .features import Features
from .objective import Objective


@dataclass(frozen=True)
class Term:
    """One loss over N frames.

    Args:
        name: of the loss.
        unit: of its raw value.
        weight: lambda of Eq. 15.
        values: raw, (N,); NaN where undefined.
        reason: why it is undefined, where it is.
    """

    name: str
    unit: str
    weight: float
    values: Tensor  # (N,)
    reason: str = ""

    @property
    def defined(self) -> int:
        """Frames that have a value."""
        return int(torch.isfinite(self.values).sum())

    @property
    def mean(self) -> float | None:
        """Mean raw value over the frames that have one; None where none has."""
        values = self.values[torch.isfinite(self.values)]
        return float(values.mean()) if len(values) else None


@dataclass(frozen=True)
class Scores:
    """All terms of one path.

    Args:
        terms: in the order of the config, of N frames each.
        totals: weighted sum of Eq. 15 per frame, (N,), with what the objective charges for undefined terms.
    """

    terms: tuple[Term, ...]
    totals: Tensor  # (N,)

    def __post_init__(self) -> None:
        for term in self.terms:
            if term.values.shape != self.totals.shape:
                raise ValueError(f"{term.name} must be {tuple(self.totals.shape)}, got {tuple(term.values.shape)}")

    def term(self, name: str) -> Term | None:
        """The term called ``name``."""
        return next((term for term in self.terms if term.name == name), None)


def score(objective: Objective, reference: Features, rendered: Features, missing: Mapping[str, str]) -> Scores:
    """Score N rendered frames against N reference frames.

    ``missing`` says why the reference lacks a feature, by feature.
    """
    return tabulate(objective, reference, objective.terms(reference, rendered), missing)


def tabulate(objective: Objective, reference: Features, values: Tensor, missing: Mapping[str, str]) -> Scores:
    """Scores of raw terms (N, L) that were measured against ``reference``."""
    defined = objective.defined(reference)
    terms = []
    for i, (name, loss) in enumerate(objective.losses.items()):
        reason = _reason(loss, reference, bool(defined[:, i].any()), missing)
        terms.append(Term(name, loss.unit, loss.weight, values[:, i], reason))
    return Scores(tuple(terms), objective.totals(values, defined))


def _reason(loss: object, reference: Features, defined: bool, missing: Mapping[str, str]) -> str:
    lacking = [name for name in loss.requires if not reference.has(name)]  # type: ignore[attr-defined]
    if lacking:
        told = {**missing, **reference.reasons}
        return told.get(lacking[0], f"the reference has no {lacking[0]!r}")
    return "" if defined else "undefined on every frame of the reference"
