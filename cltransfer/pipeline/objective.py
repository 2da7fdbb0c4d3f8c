"""Candidates to totals: the weighted sum of Eq. 15, with undefined terms named and priced, never dropped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from ..errors import ModelError
from ..features import Features
from .answers import LOOKS, answer, check_sum, residuals_of, values


@dataclass(frozen=True)
class Across:
    """Views as the losses see them, and beyond their jumps.

    Args:
        residuals: weighted, (B, R).
        beyond: the same beyond a jump, (B, R); as ``residuals`` where none is known of.
        far: how far it is from there, (B, R), 0 or less where it is there or none is known of; in the loss's own unit.
    """

    residuals: Tensor  # (B, R)
    beyond: Tensor  # (B, R)
    far: Tensor  # (B, R)

    @property
    def beside(self) -> Tensor:
        """All three beside one another, (B, 3 R)."""
        return torch.cat([self.residuals, self.beyond, self.far], dim=1)

    @classmethod
    def apart(cls, beside: Tensor) -> Across:
        """What lies ``beside`` one another, (B, 3 R), taken apart."""
        return cls(*beside.chunk(3, dim=1))


@dataclass(frozen=True)
class Objective:
    """The active losses of a run, in the order of the config.

    Args:
        losses: by name; each is the metric too.
        moving: features that compare a frame with the one before; a loss that requires one has no first frame.
        silent: losses that the reference has on no frame; lacking residuals, they do not forbid refinement.
    """

    losses: Mapping[str, Any]
    moving: frozenset[str] = frozenset({"flow"})
    silent: frozenset[str] = frozenset()
    _looks: Counter[str] = field(default_factory=Counter, init=False, repr=False, compare=False)  # by loss

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
        """Raw terms, (B, L); NaN where undefined. ``reference`` has 1 or B frames.

        Raises:
            ModelError: a loss fails, or gives anything but B values of 0 or more.
        """
        count = max(len(reference), len(rendered))
        columns = []
        for name, loss in self.losses.items():
            if any(not (reference.has(n) and rendered.has(n)) for n in loss.requires):
                columns.append(torch.full((count,), torch.nan, dtype=torch.float64))
            else:
                columns.append(values(loss, (reference, rendered), count, f"loss {name!r}"))
        return torch.stack(columns, dim=1)

    def defined(self, reference: Features) -> Tensor:
        """Which terms the reference has, (N, L) bool: a term is defined where the reference scores itself."""
        return torch.isfinite(self.terms(reference, reference))

    def totals(self, terms: Tensor, defined: Tensor) -> Tensor:
        """Weighted totals (B,) of raw terms (B, L), Eq. 15: the sum of :meth:`weighted`."""
        return self.weighted(terms, defined).sum(dim=1)

    def weighted(self, terms: Tensor, defined: Tensor) -> Tensor:
        """Weighted terms (B, L) of raw terms (B, L).

        A term the reference lacks costs nothing, whatever is rendered; a term that only the render lacks costs its
        penalty, so that leaving the frame does not pay.
        """
        priced = self.priced(terms, defined)
        return torch.where(defined, priced * self.weights, torch.zeros_like(priced))

    def priced(self, terms: Tensor, defined: Tensor) -> Tensor:
        """Raw terms (B, L) with the penalty where only the render lacks one; NaN where the reference does."""
        return torch.where(torch.isfinite(terms), terms, self.penalties).masked_fill(~defined, torch.nan)

    @property
    def groups(self) -> Tensor | None:
        """Group of each residual, (R,); None where a loss has no residuals."""
        if self.without_residuals:
            return None
        groups: list[int] = []
        for own in self._groups.values():
            first = max(groups, default=-1) + 1
            groups += [first + group for group in own]
        return torch.tensor(groups)

    @property
    def without_residuals(self) -> list[str]:
        """Losses that no slope is known of, though the reference may have them."""
        return [n for n, loss in self.losses.items() if not hasattr(loss, "residuals") and not self._idle(n)]

    def _idle(self, name: str) -> bool:
        """Whether a loss costs nothing whatever is rendered, so that nobody asks for its slope."""
        return name in self.silent or self.losses[name].weight == 0

    @property
    def _groups(self) -> dict[str, tuple[int, ...]]:
        """Groups of each loss's residuals; of an idle one that has none a single residual, which is 0."""
        lacking = {name: (0,) if self._idle(name) else () for name in self.losses}
        return {name: tuple(getattr(loss, "groups", lacking[name])) for name, loss in self.losses.items()}

    def rows(self, defined: Tensor) -> Tensor:
        """Residuals of the ``defined`` terms (L,) that weigh something, (R,) bool; of losses that have some."""
        sizes = torch.tensor([len(own) for own in self._groups.values()])
        return (defined & self.weighs).repeat_interleave(sizes)

    @property
    def paired(self) -> Tensor:
        """Residuals that compare a frame with the one before, (R,) bool; of losses that have some."""
        marks: list[bool] = []
        for own, loss in zip(self._groups.values(), self.losses.values()):
            marks += [self.moves(loss)] * len(own)
        return torch.tensor(marks)

    def moves(self, loss: Any) -> bool:
        """Whether a loss compares a frame with the one before."""
        return not self.moving.isdisjoint(loss.requires)

    @property
    def of_motion(self) -> Tensor:
        """Terms (L,) bool that compare a frame with the one before."""
        return torch.tensor([self.moves(loss) for loss in self.losses.values()])

    def placed(self, reference: Features) -> Tensor:
        """Frames (N,) bool of which some term tells where to stand: one that needs no motion, and weighs something."""
        return (self.defined(reference) & ~self.of_motion & self.weighs).any(1)

    @property
    def weighs(self) -> Tensor:
        """Terms (L,) bool that count: one of weight 0 is measured alone."""
        return self.weights > 0

    def residuals(self, reference: Features, rendered: Features, defined: Tensor) -> Tensor:
        """Weighted residuals (B, R) of B candidates for one reference frame; their group norms add up to the total.

        Args:
            reference: one frame.
            rendered: B candidates.
            defined: which terms the reference has, (L,) bool; the others leave zeros.

        Raises:
            ModelError: a loss fails, gives anything but (B, R) residuals, or at first some that are not of its value.
        """
        parts, groups = [], self._groups
        for (name, loss), there in zip(self.losses.items(), defined.tolist()):
            if not there or not hasattr(loss, "residuals"):  # without any it is idle
                parts.append(torch.zeros(len(rendered), len(groups[name]), dtype=torch.float64))
                continue
            if any(not rendered.has(name) for name in loss.requires):
                part = torch.full((len(rendered), len(loss.groups)), torch.nan, dtype=torch.float64)
            else:
                part = residuals_of(loss, name, (reference, rendered), len(rendered))
                self._check_sum(name, (reference, rendered), part)
            lost = ~torch.isfinite(part).all(1)
            part = part.masked_fill(lost[:, None], 0.0)
            part[lost, 0] = loss.penalty
            parts.append(loss.weight * part)
        return torch.cat(parts, dim=1)

    def _check_sum(self, name: str, sides: tuple[Features, Features], part: Tensor) -> None:
        """Hold the residuals (B, R) of a loss against its value: of the first views that tell, which takes one call."""
        loss = self.losses[name]
        if loss.weight > 0 and self._looks[name] < LOOKS:
            norms = group_norms(part, torch.tensor(loss.groups)).sum(1)
            told = check_sum(loss, name, values(loss, sides, len(part), f"loss {name!r}"), norms)
            self._looks[name] += LOOKS if told else 1

    def check_residuals(self, reference: Features, defined: Tensor) -> None:
        """Refuse a loss whose residuals are NaN where its value is known: a search would not see it, nor say so.

        Args:
            reference: N frames, each held against itself.
            defined: :meth:`defined` of it, (N, L).

        Raises:
            ModelError: they are, or the loss fails.
        """
        for (name, loss), there in zip(self.losses.items(), defined.T):
            if not (hasattr(loss, "residuals") and loss.weight > 0 and bool(there.any())):
                continue
            i, who = int(there.nonzero()[0, 0]), f"residuals of loss {name!r}"
            part = residuals_of(loss, name, (reference[i], reference[i]), 1)
            if not bool(part.isfinite().all()):
                expected = f"expected numbers where its value is one, got {part[0].tolist()} of frame {i}"
                raise ModelError("", who, expected, "a term is NaN in both or in neither")

    def across(self, reference: Features, rendered: Features, defined: Tensor) -> Across:
        """:meth:`residuals`, and what they would be beyond jumps that a loss tells of by its ``beyond``.

        Raises:
            ModelError: a loss fails, or gives anything else than it should.
        """
        residuals = self.residuals(reference, rendered, defined)
        beyond, far, first = residuals.clone(), torch.zeros_like(residuals), 0
        for (name, own), there in zip(self._groups.items(), defined.tolist()):
            loss, columns = self.losses[name], slice(first, first + len(own))
            first += len(own)
            if there and hasattr(loss, "beyond") and all(rendered.has(n) for n in loss.requires):
                shape = (len(rendered), len(own), 2)
                told = answer(loss.beyond, (reference, rendered), shape, f"beyond of loss {name!r}")
                known = told.isfinite().all(-1)
                beyond[:, columns] = torch.where(known, loss.weight * told[..., 0], beyond[:, columns])
                far[:, columns] = torch.where(known, told[..., 1], 0.0)
        return Across(residuals, beyond, far)

    def lost_residuals(self, defined: Tensor) -> Tensor:
        """Weighted residuals (R,) of a view that shows nothing: the penalty of each of the ``defined`` terms (L,)."""
        parts = []
        for own, loss, there in zip(self._groups.values(), self.losses.values(), defined.tolist()):
            part = torch.zeros(len(own), dtype=torch.float64)
            part[0] = loss.weight * loss.penalty if there else 0.0
            parts.append(part)
        return torch.cat(parts)


def group_norms(residuals: Tensor, groups: Tensor) -> Tensor:
    """Norm of each group, (B, G), of residuals (B, R)."""
    squares = torch.zeros(len(residuals), int(groups.max()) + 1, dtype=residuals.dtype)
    return squares.index_add(1, groups, residuals**2).sqrt()
