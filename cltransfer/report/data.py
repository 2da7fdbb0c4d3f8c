"""What a report is made from: values, already measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch
from torch import Tensor

from ..subject import Subject
from ..trajectory import Trajectory


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
                raise ValueError(
                    f"{term.name} must be {tuple(self.totals.shape)}, got {tuple(term.values.shape)}"
                )

    def term(self, name: str) -> Term | None:
        """The term called ``name``."""
        return next((term for term in self.terms if term.name == name), None)


@dataclass(frozen=True)
class Flag:
    """Something a reader should know about one frame, or about all where ``frame`` is None."""

    frame: int | None
    reason: str


@dataclass(frozen=True)
class ReportData:
    """One run, ready to be shown.

    Args:
        title: what was transferred.
        times: of N frames, (N,) [s].
        scores: of the result.
        baseline: of the first view held still, where measured.
        trajectory: the cameras found, None where clips were only scored.
        subject: the person in the scene, where known.
        reference_frames: (N, 3, H, W) uint8.
        render_frames: (N, 3, H2, W2) uint8.
        flags: what a reader should know.
        spent: what the run cost, by name (evaluations, renders, network passes, seconds, stop reasons).
        command: a shell line that makes the run again.
    """

    title: str
    times: Tensor  # (N,) [s]
    scores: Scores
    baseline: Scores | None
    trajectory: Trajectory | None
    subject: Subject | None
    reference_frames: Tensor  # (N, 3, H, W)
    render_frames: Tensor  # (N, 3, H2, W2)
    flags: tuple[Flag, ...] = ()
    spent: Mapping[str, int | float | str] = field(default_factory=dict)
    command: str = ""

    def __post_init__(self) -> None:
        count = len(self.times)
        parts = {
            "scores": self.scores.totals,
            "baseline": None if self.baseline is None else self.baseline.totals,
            "trajectory": None if self.trajectory is None else self.trajectory.times,
            "reference_frames": self.reference_frames,
            "render_frames": self.render_frames,
        }
        for name, part in parts.items():
            if part is not None and len(part) != count:
                raise ValueError(f"{name} must have {count} frames like times, got {len(part)}")
