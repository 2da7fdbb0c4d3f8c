"""What a report is made from: values, already measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from torch import Tensor

from ..pipeline.scores import Scores
from ..subject import Subject
from ..trajectory import Trajectory

MOST_RUNS = 6  # of frames, told one by one


@dataclass(frozen=True)
class Flag:
    """Something a reader should know about one frame, or about all where ``frame`` is None."""

    frame: int | None
    reason: str


@dataclass(frozen=True, eq=False)
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
        lasts: whether another run tells no more of what was read, as of :attr:`cltransfer.features.Features.lasts`.
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
    lasts: bool = True

    @property
    def render_name(self) -> str:
        """What is held against the reference."""
        return "render" if self.trajectory is None else "transfer"

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know of all frames."""
        return tuple(flag.reason for flag in self.flags if flag.frame is None)

    @property
    def findings(self) -> tuple[str, ...]:
        """Each reason once, after the frames it is told of."""
        frames: dict[str, list[int]] = {}
        for flag in self.flags:
            told = frames.setdefault(flag.reason, [])
            if flag.frame is not None:
                told.append(flag.frame)
        return tuple(f"{_which(told, len(self.times))}{reason}" for reason, told in frames.items())

    @property
    def apart(self) -> float | None:
        """Median time from one frame to the next [s]; None of one frame."""
        return float(self.times.diff().median()) if len(self.times) > 1 else None

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


def _which(frames: list[int], count: int) -> str:
    """Which of ``count`` frames, in words; nothing where none is named.

    >>> _which([0, 1, 2, 5], 24), _which([0, 1], 2), _which([7], 24)
    ('frames 0 to 2, 5: ', 'all 2 frames: ', 'frame 7: ')
    """
    if not frames:
        return ""
    if len(set(frames)) == count > 1:
        return f"all {count} frames: "
    runs: list[list[int]] = []
    for frame in sorted(set(frames)):
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    told = [str(first) if first == last else f"{first} to {last}" for first, last in runs[:MOST_RUNS]]
    more = [] if len(runs) <= MOST_RUNS else [f"... ({len(set(frames))} in all)"]
    return f"frame{'s' if len(set(frames)) > 1 else ''} {', '.join(told + more)}: "
