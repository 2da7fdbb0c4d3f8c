"""What came of a trial: its numbers or why there are none, and whether those that were kept on disk are sound."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

MOST = 1e15  # that a count on disk may be


@dataclass(frozen=True)
class Case:
    """What a row is run on: names as in the file. Rows are compared on the cases they share."""

    scene: str
    reference: str
    seed: int


@dataclass(frozen=True)
class Metric:
    """One number of one result: mean raw value over the frames in which the reference has one, None where it has none.

    A render that lacks the term there pays its penalty.
    """

    mean: float | None
    unit: str
    defined: int
    reason: str


@dataclass(frozen=True)
class Outcome:
    """What came of a trial.

    Args:
        key, row, case: of the trial.
        failed: why there is no result, empty where there is one.
        metrics: by name, the weighted total last.
        directions: which way the result errs, see :func:`cltransfer.ablate.measure.measured`.
        note: what a reader must know of the search, empty where nothing.
        lasts: whether another run tells no more; see :class:`~cltransfer.features.OfThisRun`.
        commit: that it was measured at.
        frames: of the result.
        evaluations, network_passes: what the search cost.
        seconds: on the clock of the worker.
    """

    key: str
    row: str
    case: Case
    failed: str = ""
    metrics: dict[str, Metric] | None = None
    frames: int = 0
    evaluations: int = 0
    network_passes: int = 0
    seconds: float = 0.0
    directions: dict[str, Metric] | None = None
    note: str = ""
    lasts: bool = True
    commit: str = ""

    @classmethod
    def from_json(cls, raw: dict[str, Any]) -> Outcome:
        """An outcome of its JSON values.

        Raises:
            TypeError: it is of another make.
        """
        for key in ("metrics", "directions"):
            if raw.get(key) is not None:
                raw[key] = {name: Metric(**values) for name, values in raw[key].items()}
        outcome = cls(**{**raw, "case": Case(**raw["case"])})
        if not outcome._is_sound():
            raise ValueError
        return outcome

    def _is_sound(self) -> bool:
        """Whether counts are counts, numbers finite and texts texts, and there is a result or a reason why not."""
        told = [*(self.metrics or {}).values(), *(self.directions or {}).values()]
        counts = [self.frames, self.evaluations, self.network_passes, *(metric.defined for metric in told)]
        numbers = [self.seconds, *(metric.mean for metric in told if metric.mean is not None)]
        texts = [self.key, self.row, self.case.scene, self.case.reference, self.failed, self.note, self.commit]
        texts += [text for metric in told for text in (metric.unit, metric.reason)]
        return (
            all(type(count) is int and 0 <= count <= MOST for count in counts)
            and all(type(number) in (int, float) and abs(number) <= sys.float_info.max for number in numbers)
            and all(isinstance(text, str) for text in texts)
            and type(self.case.seed) is int
            and type(self.lasts) is bool
            and (self.metrics is None) == bool(self.failed)
            and (bool(self.failed) or self.frames > 0)
        )
