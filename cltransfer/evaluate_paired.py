"""Methods against the first of them, clip by clip: clips differ far more than methods do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .evaluate_kept import ClipScore
from .paired import Estimate, change, estimate

ALIKE = 0.01  # by which the time may differ that as many frames are spread over: the nearest to even ones are taken


@dataclass(frozen=True)
class Difference:
    """A term of a method less that of the first one.

    Args:
        estimate: over the clips that both have a value of.
        alike: whether no clip has a value of one of the two alone, and they have as many frames of each clip, spread
            over as much time.
    """

    estimate: Estimate
    alike: bool

    @property
    def certain(self) -> bool:
        """Whether the difference is told from chance, and is that of nothing but the methods.

        Who loses the person in a bad frame is better in those that are left, and movement is measured from one frame to
        the next.
        """
        return self.alike and self.estimate.certain


Differences = Mapping[str, Mapping[str, Difference]]


def differences(rows: Sequence[ClipScore]) -> Differences:
    """Of each method but the first, by method and term; nothing where there is one method."""
    terms = list(dict.fromkeys(name for row in rows for name in row.means))
    methods: dict[str, dict[str, ClipScore]] = {}
    for row in rows:
        methods.setdefault(row.method, {})[row.clip] = row
    first, *others = methods
    return {method: {term: _difference(methods[method], methods[first], term) for term in terms} for method in others}


def _difference(found: Mapping[str, ClipScore], held: Mapping[str, ClipScore], term: str) -> Difference:
    here, there = _values(found, term), _values(held, term)
    both = [clip for clip in here if clip in there]
    alike = here.keys() == there.keys() and all(_same_frames(found[clip], held[clip], term) for clip in both)
    return Difference(estimate([change(here[clip], there[clip]) for clip in both]), alike)


def _values(rows: Mapping[str, ClipScore], term: str) -> dict[str, float]:
    means = {clip: row.means.get(term) for clip, row in rows.items()}
    return {clip: mean for clip, mean in means.items() if mean is not None}


def _same_frames(row: ClipScore, other: ClipScore, term: str) -> bool:
    longer = max(row.seconds, other.seconds)
    as_long = abs(row.seconds - other.seconds) <= ALIKE * longer
    return as_long and row.defined.get(term, 0) == other.defined.get(term, 0)
