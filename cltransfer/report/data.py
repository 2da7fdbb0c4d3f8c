"""What a report is made from: values, already measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from torch import Tensor

from ..scores import Scores
from ..subject import Subject
from ..trajectory import Trajectory


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
        reference_frames: (N, 3, H, W) uint8, None where only its features were kept.
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
    reference_frames: Tensor | None  # (N, 3, H, W)
    render_frames: Tensor  # (N, 3, H2, W2)
    flags: tuple[Flag, ...] = ()
    spent: Mapping[str, int | float | str] = field(default_factory=dict)
    command: str = ""

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know of all frames."""
        return tuple(flag.reason for flag in self.flags if flag.frame is None)

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
