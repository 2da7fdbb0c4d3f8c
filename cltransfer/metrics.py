"""The losses as torchmetrics: summed over batches and processes, in collections and bootstraps.

>>> from cltransfer.testing import sample_features
>>> metrics = camera_language_metrics()
>>> features = sample_features(0, 4)
>>> metrics.update(reference=features, rendered=features)
>>> values = {name: float(value) for name, value in metrics.compute().items()}
>>> values["total"], values["shot_size"], values["shot_size_coverage"]
(0.0, 0.0, 1.0)
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.nn import Module
from torchmetrics import Metric, MetricCollection

from .clips.pairs import other_shape
from .features import Features, check_pair, nobody
from .losses.camera_movement import weight_note
from .pipeline.answers import values
from .pipeline.objective import Objective
from .pipeline.scores import frame_totals
from .registry import LOSSES

PAPER = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")


class FrameMetric(Metric):
    """Mean of one value a frame over the frames that have one, with its coverage.

    Args:
        prefix: of the names of the states: by what is measured, or a collection would take two metrics that are equal
            once for one.
        kwargs: of :class:`torchmetrics.Metric`.
    """

    higher_is_better = False
    full_state_update = False
    is_differentiable = False
    plot_lower_bound = 0.0

    def __init__(self, prefix: str, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._prefix = prefix
        for state in ("total", "defined", "frames"):
            self.add_state(f"{prefix}_{state}", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self._covered = (0, 0)  # when it was computed last

    def update(self, reference: Features | Tensor, rendered: Features | None = None) -> None:
        """Add N frames.

        Args:
            reference: of 1 or N frames; or, without ``rendered``, its values (N,), NaN where undefined:
                a :class:`torchmetrics.wrappers.BootStrapper` draws again from tensors, and cannot from features.
            rendered: of N frames.

        Raises:
            ValueError: a side is a tensor of anything else, there is nothing rendered, or frames do not go together.
        """
        for side in (reference, rendered):
            if isinstance(side, Tensor) and (rendered is not None or side.ndim != 1):
                expected = "expected Features (see clip_features) or one value a frame (N,)"
                raise ValueError(f"{expected}, got a tensor {tuple(side.shape)}")
        values = reference if isinstance(reference, Tensor) else self.values(reference, rendered)
        there = torch.isfinite(values)
        self._add("total", values[there].double().sum())
        self._add("defined", there.sum())
        self._add("frames", torch.tensor(len(values)))

    def values(self, reference: Features, rendered: Features | None) -> Tensor:
        """One value a frame, (N,); NaN where there is none."""
        raise NotImplementedError

    def compute(self) -> Tensor:
        """Mean over the defined frames of all processes, (); NaN where there is none."""
        self._covered = int(self._state("defined")), int(self._state("frames"))  # in here states are of all processes
        return self._state("total") / self._state("defined")

    @property
    def coverage(self) -> tuple[int, int]:
        """How many frames have a value, of how many, in all processes.

        As for :meth:`compute`, which it calls where nothing is computed yet, every process must ask.
        """
        self.compute()
        return self._covered

    def plot(self, val: Any = None, ax: Any = None) -> Any:
        """Figure and axes of what was computed, as of any torchmetric."""
        return self._plot(val, ax)

    def _apply(self, fn: Callable[[Tensor], Tensor], exclude_state: Sequence[str] = ()) -> Module:
        """Sums keep their type, but for ``set_dtype``: with a model in bfloat16 frames would be counted to 256."""
        kept = fn if self._dtype_convert else lambda state: fn(state).to(state.dtype)
        return super()._apply(kept, exclude_state)

    def _state(self, state: str) -> Tensor:
        return getattr(self, f"{self._prefix}_{state}")

    def _add(self, state: str, value: Tensor) -> None:
        setattr(self, f"{self._prefix}_{state}", self._state(state) + value.to(self._state(state)))


class LossMetric(FrameMetric):
    """Mean raw value of a loss over the frames that have one, with its coverage.

    Losing the person in a bad frame makes it smaller: select by :class:`TotalMetric`.

    Args:
        name: of the loss in the registry, ``shot_size`` for one.
        options: of the loss.
        kwargs: of :class:`torchmetrics.Metric`.
    """

    def __init__(self, name: str, options: Mapping[str, Any] | None = None, **kwargs: Any) -> None:
        super().__init__(_prefix(name, options), **kwargs)
        self.name, self.loss = name, LOSSES.build(name, options)

    def values(self, reference: Features, rendered: Features | None) -> Tensor:
        """Raw values of the loss, (N,); all NaN where a side lacks any feature that the loss names in ``requires``.

        Raises:
            ValueError: there is nothing rendered, or the reference has neither 1 nor as many frames.
        """
        return _values(self.loss, *_checked(reference, rendered))


class CoverageMetric(LossMetric):
    """Share of the frames, in [0, 1], that have a value of a loss; arguments as of :class:`LossMetric`."""

    higher_is_better = True
    plot_upper_bound = 1.0

    def compute(self) -> Tensor:
        """Share of the frames of all processes, (); NaN where there is none."""
        super().compute()
        return self._state("defined") / self._state("frames")


class TotalMetric(FrameMetric):
    """Mean total of Eq. 15 as ``evaluate`` prints it: what only the render lacks costs its penalty.

    Args:
        losses: their options by name.
        kwargs: of :class:`torchmetrics.Metric`.
    """

    def __init__(self, losses: Mapping[str, Mapping[str, Any]], **kwargs: Any) -> None:
        super().__init__(_prefix("total", losses), **kwargs)
        self.objective = Objective({name: LOSSES.build(name, options) for name, options in losses.items()})

    def values(self, reference: Features, rendered: Features | None) -> Tensor:
        """Totals (N,) on the CPU; NaN where the reference has none of the terms that weigh anything.

        Raises:
            ValueError: as of :meth:`LossMetric.values`.
        """
        reference, rendered = _checked(reference, rendered)
        for note in (weight_note(self.objective.losses, reference.size[0]), *_pair_notes(reference, rendered)):
            if note:
                warnings.warn(note, stacklevel=2)
        return frame_totals(
            self.objective, self._terms(reference, rendered), self._terms(reference, reference).isfinite()
        )

    def _terms(self, reference: Features, rendered: Features) -> Tensor:
        """Raw terms (N, L); on the CPU, where the objective's weights are, and so are the totals."""
        losses = self.objective.losses.values()
        return torch.stack([_values(loss, reference, rendered).double().cpu() for loss in losses], dim=1)


def _checked(reference: Features, rendered: Features | None) -> tuple[Features, Features]:
    if rendered is None:
        raise ValueError("expected features of both sides, or a tensor of values")
    check_pair(reference, rendered)
    return reference, rendered


def _pair_notes(reference: Features, rendered: Features) -> list[str]:
    """What `evaluate` refuses or notes of two clips; only told here, since frames may be a part of a clip."""
    notes = [f"render: {note}" for note in other_shape(reference.size, rendered.size)]
    if len(reference) and bool(nobody(reference).all()):
        told = f"reference: no person in any of {len(reference)} frames, so the total is of what is left and is small"
        notes.append(f"{told}: leave such a clip out, as `evaluate` refuses it")
    return notes


def _values(loss: Any, reference: Features, rendered: Features) -> Tensor:
    count = len(rendered)
    if not all(side.has(name) for side in (reference, rendered) for name in loss.requires):
        return torch.full((count,), float("nan"), dtype=torch.float64)
    return values(loss, (reference, rendered), count, f"loss {type(loss).__name__}")


def _prefix(name: str, options: Mapping[str, Any] | None) -> str:
    return "_".join([name, *([_digest(options)] if options else [])])


def _digest(options: Mapping[str, Any]) -> str:
    """The same for the same options in every process."""
    return hashlib.sha256(json.dumps(options, sort_keys=True, default=str).encode()).hexdigest()[:12]


def camera_language_metrics(losses: Mapping[str, Mapping[str, Any]] | Iterable[str] | None = None) -> MetricCollection:
    """A collection by name: the mean and the ``_coverage`` of each loss, and the ``total``.

    Args:
        losses: their options by name, or names alone; None is the paper's five.

    Raises:
        ValueError: there is none.
    """
    named = PAPER if losses is None else [losses] if isinstance(losses, str) else losses
    chosen = named if isinstance(named, Mapping) else {name: {} for name in named}
    if not chosen:
        raise ValueError("expected one loss or more, got none; leave them out for the paper's five")
    metrics: dict[str, Metric | MetricCollection] = {"total": TotalMetric(chosen)}
    metrics |= {name: LossMetric(name, options) for name, options in chosen.items()}
    metrics |= {f"{name}_coverage": CoverageMetric(name, options) for name, options in chosen.items()}
    return MetricCollection(metrics, compute_groups=[["total"], *([name, f"{name}_coverage"] for name in chosen)])
