"""What people preferred: shares with exact and with participant intervals, and Bradley-Terry strengths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import expit, softmax
from scipy.stats import binomtest, bootstrap

from .answers import Choice
from .design import QUESTIONS, Study

CONFIDENCE = 0.95
RESAMPLES = 1999
LONGEST_STEP = 2.0  # of a strength's logarithm: farther the parabola says little
FEWEST = 6  # participants of whom resampling says something
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Preference:
    """How often one method was preferred to another.

    Args:
        question, first, second: what was asked about whom.
        wins, count: answers for ``first``, of how many.
        exact: Clopper-Pearson interval of the share; it takes answers for independent. None without an answer.
        by_participant: percentile interval of the share over resampled participants; where all have the same share,
            which resampling takes for certain, Clopper-Pearson with a participant as an answer. None of fewer than
            :data:`FEWEST`.
    """

    question: str
    first: str
    second: str
    wins: int
    count: int
    exact: tuple[float, float] | None
    by_participant: tuple[float, float] | None

    @property
    def share(self) -> float | None:
        """Part of the answers that are for ``first``, None without an answer."""
        return self.wins / self.count if self.count else None


@dataclass(frozen=True)
class Strength:
    """Bradley-Terry strength of a method: its odds against another are the ratio of theirs; all add up to 1.

    Args:
        question, method: what was asked about whom.
        value: None where it is not finite.
        by_participant: percentile interval over resampled participants, None of fewer than :data:`FEWEST`, or where one
            resample has no finite value.
        reason: why there is none.
    """

    question: str
    method: str
    value: float | None
    by_participant: tuple[float, float] | None
    reason: str = ""


def preferences(choices: Sequence[Choice], study: Study) -> list[Preference]:
    """One for each question and pair of methods."""
    found = []
    for question in QUESTIONS:
        for first, second in combinations(study.methods, 2):
            asked = [c for c in choices if c.question == question and {c.winner, c.loser} == {first, second}]
            found.append(_preference(asked, question, first, second))
    return found


def _preference(asked: Sequence[Choice], question: str, first: str, second: str) -> Preference:
    people = sorted({choice.participant for choice in asked})
    counts = np.array([sum(c.participant == who for c in asked) for who in people])
    wins = np.array([sum(c.participant == who and c.winner == first for c in asked) for who in people])
    exact = _exact(int(wins.sum()), len(asked)) if asked else None
    by_participant = _over_people(wins, counts) if len(people) >= FEWEST else None
    return Preference(question, first, second, int(wins.sum()), len(asked), exact, by_participant)


def _exact(wins: int, count: int) -> tuple[float, float]:
    interval = binomtest(wins, count).proportion_ci(CONFIDENCE, method="exact")
    return float(interval.low), float(interval.high)


def _over_people(wins: Array, counts: Array) -> tuple[float, float]:
    """Interval of the share by what each of P people answered, (P,) for the first of so many."""
    if len(set((wins / counts).tolist())) == 1:  # resampling people who all agree tells nothing
        return _of_one_share(float(wins.sum() / counts.sum()), len(wins))
    resampled = bootstrap(
        (wins, counts),
        lambda won, of, axis: won.sum(axis) / of.sum(axis),
        paired=True,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.Generator(np.random.PCG64(0)),
    ).confidence_interval
    return float(resampled.low), float(resampled.high)


def _of_one_share(share: float, people: int) -> tuple[float, float]:
    """Interval where each of ``people`` has the same ``share``: Clopper-Pearson with a participant as an answer.

    A share of a whole number of participants has it exactly; any other the wider of its neighbours' ends.
    """
    whole = round(share * people, 9)
    return _exact(math.floor(whole), people)[0], _exact(math.ceil(whole), people)[1]


def strengths(choices: Sequence[Choice], study: Study) -> list[Strength]:
    """One for each question and method."""
    found = []
    for question in QUESTIONS:
        wins = _wins_by_person([c for c in choices if c.question == question], study.methods)
        values = bradley_terry(wins.sum(0))
        if not np.isfinite(values).all():
            reason = "no finite value: some methods never lost to the others, or were never compared with them"
            found += [Strength(question, method, None, None, reason) for method in study.methods]
            continue
        intervals, reason = _intervals(wins)
        for i, method in enumerate(study.methods):
            interval = intervals[i] if intervals else None
            found.append(Strength(question, method, float(values[i]), interval, reason))
    return found


def bradley_terry(wins: Array, steps: int = 1000) -> Array:
    """Maximum-likelihood strengths (Bradley and Terry, Biometrika 39, 1952), by Newton's steps in their logarithms.

    Args:
        wins: how often each of M methods was preferred to each other one, (M, M), >= 0, zero diagonal.
        steps: at most.

    Returns:
        (M,) that add up to 1; NaN where the maximum is not finite: the methods split into two parts of which one never
        lost to the other; or where it is not found in ``steps``, of which twenty were enough for odds of a million.
    """
    count = len(wins)
    parts, _ = connected_components(wins > 0, directed=True, connection="strong")
    if parts > 1:
        return np.full(count, np.nan)
    games, logs = wins + wins.T, np.zeros(count)
    for _ in range(steps):
        chance = expit(logs[:, None] - logs)  # of one being preferred to the other
        weight = games * chance * chance.T
        curvature = np.diag(weight.sum(1)) - weight + weight.mean()  # all alike is no change: any weight will do there
        step = np.linalg.solve(curvature, wins.sum(1) - (games * chance).sum(1))
        logs = logs + step * min(1.0, LONGEST_STEP / max(np.abs(step).max(), LONGEST_STEP))
        if np.abs(step).max() < 1e-10:
            return softmax(logs)
    return np.full(count, np.nan)


def _wins_by_person(asked: Sequence[Choice], methods: Sequence[str]) -> Array:
    """Wins (P, M, M) of each participant's answers."""
    people = sorted({choice.participant for choice in asked})
    wins = np.zeros((len(people), len(methods), len(methods)))
    for choice in asked:
        wins[people.index(choice.participant), methods.index(choice.winner), methods.index(choice.loser)] += 1
    return wins


def _intervals(wins: Array) -> tuple[list[tuple[float, float]], str]:
    """Percentile interval of each strength over resampled participants, or none and the reason."""
    if len(wins) < FEWEST:
        return [], f"too few participants for an interval: {len(wins)}, expected {FEWEST} or more"
    rng = np.random.Generator(np.random.PCG64(0))
    drawn = [bradley_terry(wins[rng.integers(len(wins), size=len(wins))].sum(0)) for _ in range(RESAMPLES)]
    endless = sum(not np.isfinite(values).all() for values in drawn)
    if endless:
        return [], f"no interval: {endless} of {RESAMPLES} resamples of the participants have no finite value"
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(drawn, [tail, 1 - tail], axis=0)
    return [(float(a), float(b)) for a, b in zip(low, high)], ""
