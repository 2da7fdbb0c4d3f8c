"""The losses as torchmetrics: summed over batches and processes, in collections and bootstraps.

>>> from cltransfer.testing import sample_features
>>> metrics = camera_language_metrics()
>>> features = sample_features(0, 4)
>>> metrics.update(features, features)
>>> {name: float(value) for name, value in metrics.compute().items()}["shot_size"]
0.0
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from torchmetrics import Metric, MetricCollection

from .features import Features
from .registry import LOSSES

PAPER = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")


class LossMetric(Metric):
    """Mean raw value of a loss over the frames that have one, with its coverage.

    Args:
        name: of the loss in the registry, ``shot_size`` for one.
        options: of the loss.
        kwargs: of :class:`torchmetrics.Metric`.
    """

    higher_is_better = False
    full_state_update = False
    is_differentiable = False

    def __init__(self, name: str, options: Mapping[str, Any] | None = None, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.name, self.loss = name, LOSSES.build(name, options)
        # by name and options, or a collection would take two losses with equal values for one
        self._prefix = "_".join([name, *([_digest(options)] if options else [])])
        for state in ("total", "defined", "frames"):
            self.add_state(f"{self._prefix}_{state}", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self._covered = (0, 0)  # when it was computed last

    def update(self, reference: Features | Tensor, rendered: Features | None = None) -> None:
        """Add N frames.

        Args:
            reference: of 1 or N frames; or, without ``rendered``, raw values (N,) of the loss, NaN where undefined:
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
        """Raw values of the loss, (N,); NaN where a side lacks what the loss needs.

        Raises:
            ValueError: there is nothing rendered, or the reference has neither 1 nor as many frames.
        """
        if rendered is None:
            raise ValueError("expected features of both sides, or a tensor of values")
        if len(reference) not in (1, len(rendered)):
            counts = f"the reference has {len(reference)} and the render {len(rendered)}"
            raise ValueError(f"expected as many frames of both, or 1 of the reference: {counts}")
        if not all(side.has(name) for side in (reference, rendered) for name in self.loss.requires):
            return torch.full((max(len(reference), len(rendered)),), float("nan"), dtype=torch.float64)
        return self.loss(reference, rendered)

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

    def _state(self, state: str) -> Tensor:
        return getattr(self, f"{self._prefix}_{state}")

    def _add(self, state: str, value: Tensor) -> None:
        setattr(self, f"{self._prefix}_{state}", self._state(state) + value.to(self._state(state)))


def _digest(options: Mapping[str, Any]) -> str:
    """The same for the same options in every process."""
    return hashlib.sha256(json.dumps(options, sort_keys=True, default=str).encode()).hexdigest()[:12]


def camera_language_metrics(losses: Mapping[str, Mapping[str, Any]] | None = None) -> MetricCollection:
    """A collection of loss metrics by name; ``losses`` are their options by name, None is the paper's five."""
    chosen: Mapping[str, Mapping[str, Any]] = {name: {} for name in PAPER} if losses is None else losses
    return MetricCollection({name: LossMetric(name, options) for name, options in chosen.items()})
