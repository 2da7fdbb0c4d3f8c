"""Candidates to totals: the weighted sum of Eq. 15, with undefined terms named and priced, never dropped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from .features import Features


@dataclass(frozen=True)
class Objective:
    """The active losses of a run, in the order of the config.

    Args:
        losses: by name; each is the metric too.
    """

    losses: Mapping[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms, in order."""
        return tuple(self.losses)

    @property
    def weights(self) -> Tensor:
        """lambda of Eq. 15, (L,)."""
        return torch.tensor([loss.weight for loss in self.losses.values()], dtype=torch.float64)

    @property
    def penalties(self) -> Tensor:
        """Raw value that stands in for an undefined term, (L,)."""
        return torch.tensor([loss.penalty for loss in self.losses.values()], dtype=torch.float64)

    def terms(self, reference: Features, rendered: Features) -> Tensor:
        """Raw terms, (B, L); NaN where undefined. ``reference`` has 1 or B frames."""
        count = max(len(reference), len(rendered))
        columns = []
        for loss in self.losses.values():
            lacking = any(not (reference.has(n) and rendered.has(n)) for n in loss.requires)
            value = torch.full((count,), float("nan")) if lacking else loss(reference, rendered)
            columns.append(value.double())
        return torch.stack(columns, dim=1)

    def defined(self, reference: Features) -> Tensor:
        """Which terms the reference has, (N, L) bool: a term is defined where the reference scores itself."""
        return torch.isfinite(self.terms(reference, reference))

    def totals(self, terms: Tensor, defined: Tensor) -> Tensor:
        """Weighted totals (B,) of raw terms (B, L), Eq. 15.

        A term the reference lacks costs nothing, whatever is rendered; a term that only the render lacks costs its
        penalty, so that leaving the frame never pays.
        """
        priced = torch.where(torch.isfinite(terms), terms, self.penalties)
        return torch.where(defined, priced * self.weights, torch.zeros_like(priced)).sum(dim=1)
