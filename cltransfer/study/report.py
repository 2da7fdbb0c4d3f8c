"""The analysis of a study as text, CSV and plain values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..report.tables import Table, to_markdown
from ..storage.files import csv_text, write_json, write_text
from .analysis import Preference, Strength, preferences, strengths
from .answers import Choice, read_answers
from .design import NO_STUDY, QUESTIONS, Study
from .intervals import CONFIDENCE, FEWEST


@dataclass(frozen=True)
class Analysis:
    """What the answers to a study come to.

    Args:
        study: that was answered.
        answered: how many answers each participant gave.
        preferences: of every question and pair.
        strengths: of every question and method; empty for two methods, where a share says the same.
    """

    study: Study
    answered: dict[str, int]
    preferences: tuple[Preference, ...]
    strengths: tuple[Strength, ...]

    @property
    def asked(self) -> int:
        """Answers of a participant who finished."""
        return len(self.study.items) * len(QUESTIONS)


def analyse(files: Sequence[Path], key: Path) -> Analysis:
    """Unblind and analyse the answers in ``files``.

    Raises:
        InputError: a file or the key cannot be used, or they do not belong together.
    """
    study = Study.load(key)
    choices = read_answers(files, study)
    ranked = strengths(choices, study) if len(study.methods) > 2 else []
    return Analysis(study, _answered(choices), tuple(preferences(choices, study)), tuple(ranked))


def _answered(choices: Sequence[Choice]) -> dict[str, int]:
    return dict(sorted(Counter(choice.participant for choice in choices).items()))


def markdown(analysis: Analysis) -> list[str]:
    """Tables with what a reader must know."""
    people = len(analysis.answered)
    lines = [
        f"Study {analysis.study.name}: {people} participant{'' if people == 1 else 's'}, "
        f"{sum(analysis.answered.values())} answers, two choices, sides and order random.",
        *(f"- {who} answered {n} of {analysis.asked}" for who, n in analysis.answered.items() if n < analysis.asked),
        "",
        *to_markdown(_preferences(analysis)),
    ]
    if analysis.strengths:
        lines += ["", *to_markdown(_strengths(analysis))]
    lines += [
        "",
        "The exact interval takes answers for independent; those of one person are not: cite the one by participant",
        f"({FEWEST} participants or more have one). It is wider the fewer they are and the more they differ; of shares",
        "it holds the bootstrap of participants, which alone is too narrow where they are few.",
        f"{NO_STUDY} Neither are answers by its authors or by a program.",
    ]
    return lines


def _preferences(analysis: Analysis) -> Table:
    exact, by_participant = f"exact {CONFIDENCE:.0%}", f"by participant {CONFIDENCE:.0%}"
    rows = [
        (
            p.question,
            p.first,
            p.second,
            _percent(p.share),
            _span(p.exact),
            _span(p.by_participant),
            f"{p.wins}/{p.count}",
            p.reason,
        )
        for p in analysis.preferences
    ]
    return Table(("question", "preferred", "to", "share", exact, by_participant, "answers", ""), tuple(rows))


def _strengths(analysis: Analysis) -> Table:
    rows = [(s.question, s.method, _percent(s.value), _span(s.by_participant), s.reason) for s in analysis.strengths]
    return Table(("question", "method", "Bradley-Terry strength", f"by participant {CONFIDENCE:.0%}", ""), tuple(rows))


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f} %"


def _span(interval: tuple[float, float] | None) -> str:
    return "–" if interval is None else f"[{100 * interval[0]:.1f}, {100 * interval[1]:.1f}]"


def values(analysis: Analysis) -> dict[str, Any]:
    """What ``--json`` prints; null where something is not known."""
    return {
        "format": "cltransfer.study-analysis",
        "version": 1,
        "study": analysis.study.name,
        "participants": analysis.answered,
        "asked": analysis.asked,
        "preferences": [{**asdict(p), "share": p.share} for p in analysis.preferences],
        "strengths": [asdict(s) for s in analysis.strengths],
        "note": NO_STUDY,
    }


def preferences_csv(analysis: Analysis) -> str:
    """One line for each question and pair; what is not known is an empty cell, with the reason."""
    head = ("question", "first", "second", "wins", "answers", "share")
    lines: list[Sequence[Any]] = [(*head, "exact_low", "exact_high", "people_low", "people_high", "reason")]
    for p in analysis.preferences:
        spans = [*(p.exact or ("", "")), *(p.by_participant or ("", ""))]
        lines.append([p.question, p.first, p.second, p.wins, p.count, p.share, *spans, p.reason])
    return csv_text(lines)


def write_analysis(out: Path, analysis: Analysis) -> None:
    """Write analysis.md, analysis.json and preferences.csv into ``out``."""
    write_text(out / "analysis.md", "\n".join(markdown(analysis)) + "\n")
    write_json(out / "analysis.json", values(analysis))
    write_text(out / "preferences.csv", preferences_csv(analysis))
