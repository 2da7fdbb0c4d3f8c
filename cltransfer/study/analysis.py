"""What people preferred: shares with exact and with participant intervals, and Bradley-Terry strengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import expit, softmax

from .answers import Choice
from .design import QUESTIONS, Study
from .intervals import FEWEST, exact_interval, share_interval, strength_intervals

STEPS = 1000  # of Newton, at most
LONGEST_STEP = 2.0  # of a strength's logarithm: farther the parabola says little
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Preference:
    """How often one method was preferred to another.

    Args:
        question, first, second: what was asked about whom.
        wins, count: answers for ``first``, of how many.
        exact: Clopper-Pearson interval of the share; it takes answers for independent. None without an answer.
        by_participant: interval of the share over people (:func:`.intervals.share_interval`), None of fewer than
            :data:`~.intervals.FEWEST`.
        reason: why something of this is not known.
    """

    question: str
    first: str
    second: str
    wins: int
    count: int
    exact: tuple[float, float] | None
    by_participant: tuple[float, float] | None
    reason: str = ""

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
        by_participant: interval over people (:func:`.intervals.strength_intervals`), None of fewer than
            :data:`~.intervals.FEWEST`.
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
    for question, wins in _wins(choices, study.methods).items():
        for i, j in combinations(range(len(study.methods)), 2):
            found.append(_preference(wins[:, i, j], wins[:, j, i], question, study.methods[i], study.methods[j]))
    return found


def _preference(won: Array, lost: Array, question: str, first: str, second: str) -> Preference:
    """By how many answers each of P people, (P,), gave for the first and for the second."""
    asked = won + lost > 0
    counts, wins, count = (won + lost)[asked], int(won.sum()), int((won + lost).sum())
    exact = exact_interval(wins, count) if count else None
    by_participant = share_interval(won[asked], counts) if len(counts) >= FEWEST else None
    reason = _too_few(len(counts)) if count else "no answers"
    return Preference(question, first, second, wins, count, exact, by_participant, reason)


def strengths(choices: Sequence[Choice], study: Study) -> list[Strength]:
    """One for each question and method."""
    found = []
    for question, wins in _wins(choices, study.methods).items():
        values = bradley_terry(wins.sum(0))
        if not np.isfinite(values).all():
            reason = "no finite value: some methods never lost to the others, or were never compared with them"
            found += [Strength(question, method, None, None, reason) for method in study.methods]
            continue
        reason = _too_few(len(wins))
        intervals = [None] * len(values) if reason else strength_intervals(wins, values)
        found += [
            Strength(question, method, float(value), interval, reason)
            for method, value, interval in zip(study.methods, values, intervals)
        ]
    return found


def bradley_terry(wins: Array) -> Array:
    """Maximum-likelihood strengths (Bradley and Terry, Biometrika 39, 1952), by Newton's steps in their logarithms.

    Args:
        wins: how often each of M methods was preferred to each other one, (M, M), >= 0, zero diagonal.

    Returns:
        (M,) that add up to 1; NaN where the maximum is not finite: the methods split into two parts of which one never
        lost to the other; or where it is not found in :data:`STEPS`, of which twenty were enough for odds of a million.
    """
    count = len(wins)
    parts, _ = connected_components(wins > 0, directed=True, connection="strong")
    if parts > 1:
        return np.full(count, np.nan)
    games, logs = wins + wins.T, np.zeros(count)
    for _ in range(STEPS):
        chance = expit(logs[:, None] - logs)  # of one being preferred to the other
        weight = games * chance * chance.T
        curvature = np.diag(weight.sum(1)) - weight + weight.mean()  # all alike is no change: any weight will do there
        step = np.linalg.solve(curvature, wins.sum(1) - (games * chance).sum(1))
        logs = logs + step * min(1.0, LONGEST_STEP / max(np.abs(step).max(), LONGEST_STEP))
        if np.abs(step).max() < 1e-10:
            return softmax(logs)
    return np.full(count, np.nan)


def _wins(choices: Sequence[Choice], methods: Sequence[str]) -> dict[str, Array]:
    """By question, how often each of the P participants who answered it preferred a method to another, (P, M, M)."""
    asked: dict[str, list[Choice]] = {question: [] for question in QUESTIONS}
    for choice in choices:
        asked[choice.question].append(choice)
    return {question: _wins_by_person(given, methods) for question, given in asked.items()}


def _wins_by_person(asked: Sequence[Choice], methods: Sequence[str]) -> Array:
    people, who = np.unique([choice.participant for choice in asked], return_inverse=True)
    place = {method: i for i, method in enumerate(methods)}
    pairs = np.array([(place[choice.winner], place[choice.loser]) for choice in asked], int).reshape(-1, 2)
    wins = np.zeros((len(people), len(methods), len(methods)))
    np.add.at(wins, (who, pairs[:, 0], pairs[:, 1]), 1)
    return wins


def _too_few(people: int) -> str:
    """Why so many have no interval, empty where they have."""
    return "" if people >= FEWEST else f"too few participants for an interval: {people}, expected {FEWEST} or more"
