"""All trials of a stress bench, run in parallel, kept on disk, told of in a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...storage.files import write_text
from ..pages import SECTIONS
from ..rows import kept_rows, measured_at
from ..section import machine, table, write_section
from ..trial import Row
from .chart import write_success, write_totals
from .sheet import trials_csv
from .trial import STRESSORS, StressTrial, run_stress, stressor_called
from .verdicts import HEADER, LEVELS, STRICTER_HEADER, stricter, summary, verdicts

FIRST_SEED = 1000  # seeds below were looked at while the methods were made
CLIPS = (  # shot, teacher, pupil: cross-scene, going round
    ("push_in", "plaza", "room"),
    ("orbit", "room", "stage"),
    ("dolly_zoom", "stage", "path"),
    ("pan", "path", "plaza"),
)


@dataclass(frozen=True)
class StressBench:
    """What is run.

    Args:
        methods: see :mod:`cltransfer.bench.methods`.
        stressors: keys of :data:`cltransfer.bench.stress.trial.STRESSORS`.
        seeds: of the clips and the stress.
        frames: of each clip, unless a stressor needs more.
        options: config overrides of every method.
    """

    methods: tuple[str, ...] = ("balanced", "jaws_clean", "replay")
    stressors: tuple[str, ...] = tuple(STRESSORS)
    seeds: tuple[int, ...] = (FIRST_SEED,)
    frames: int = 6
    options: tuple[str, ...] = ()

    def under(self, options: tuple[str, ...]) -> StressBench:
        """The same with ``options`` over it; of a key that is set twice the last value holds, and is told."""
        last = {option.partition("=")[0]: option for option in (*self.options, *options)}
        return replace(self, options=tuple(last.values()))

    def trials(self) -> list[StressTrial]:
        """Every method on every clip, without stress and at every level of every stressor; one clip a seed.

        Raises:
            UsageError: there is no such stressor.
        """
        frames = {name: max(self.frames, stressor_called(name).frames) for name in self.stressors}
        calm = [("", 0, count) for count in sorted(set(frames.values()))]
        stressed = [(stressor, level, frames[stressor]) for stressor in self.stressors for level in range(1, LEVELS)]
        return [
            StressTrial(method, stressor, level, *self._clip(seed), seed, count, self.options)
            for stressor, level, count in [*calm, *stressed]
            for seed in self.seeds
            for method in self.methods
        ]

    @staticmethod
    def _clip(seed: int) -> tuple[str, str, str]:
        shot, teacher, pupil = CLIPS[seed % len(CLIPS)]
        return shot, f"{teacher}-{2 * seed}", f"{pupil}-{2 * seed + 1}"


# A quarter of the budget of the Adam presets, the same way to go
SHORT_ADAM = ("adam.iterations=10", "adam.rate=0.1")
TIERS = {
    "smoke": StressBench(("balanced", "replay"), ("turned_view", "lost_joints"), frames=3),
    "standard": StressBench(seeds=tuple(range(FIRST_SEED, FIRST_SEED + 4)), options=SHORT_ADAM),
    "full": StressBench(
        ("balanced", "fast", "paper", "five_adam", "jaws_clean", "jaws_code", "replay"),
        seeds=tuple(range(FIRST_SEED, FIRST_SEED + 10)),
        frames=12,
    ),
}


def run_bench(
    bench: StressBench, folder: Path, jobs: int = 1, told: Callable[[str], None] = lambda line: None
) -> list[Row]:
    """Rows of all trials, in their order; kept in ``folder``, and taken from there where they were run before.

    Args:
        bench: what is run.
        folder: of rows.jsonl.
        jobs: trials at a time, each on one thread.
        told: hears a line for every new row.
    """
    return kept_rows({trial.key: trial for trial in bench.trials()}, _measured, folder, jobs, told, _named)


def _measured(key: str, trial: StressTrial) -> Row:
    return run_stress(trial)


def _named(row: Row) -> str:
    stress = f"{row['stressor']} {row['value']:g}" if row["stressor"] else "no stress"
    return f"{row['method']}, {stress}, total {row['total']:.2f}, failed: {row['failed']}"


def write_stress(rows: Sequence[Row], path: Path, command: str) -> None:
    """Rewrite the section "Stress" of the Markdown file ``path``, and beside it both charts and stress.csv."""
    found = verdicts(rows)
    write_text(path.with_name("stress.csv"), trials_csv(rows))
    write_success(found, path.with_name("stress.svg"))
    write_totals(found, path.with_name("stress_totals.svg"))
    lines = [
        f"Made by `{command}`. What a method is given is made worse in one way; the clip as it was before judges what",
        "it found, and a clip fails by the definition of protocol.md. Breakdown: level at which half of the clips",
        "fail, of five, with its value. Worst tenth and spread (between quartiles): of totals, 1 is every term at its",
        "tolerance. Growth: last third of the frames less the first. Grew most: the weighted term that has, to the",
        "level at which half fail, or else to the last; none where nothing grew. Area: mean success of five levels.",
        *_budgets(rows),
        *machine(rows),
        measured_at(rows),
        "",
        *table(("stressor", "what", "unit", "levels"), _levels(rows)),
        "",
        "![Success against level](stress.svg)",
        "![Mean total against level](stress_totals.svg)",
        "",
        "Every trial: [stress.csv](stress.csv).",
        "",
        *table(HEADER, summary(found)),
        "",
        f"How much hangs on the definition: on how many stressors {found[0].method} breaks later or earlier than",
        "another method, where a clip fails above a smaller share of the total of random views. The first share",
        "is the one used.",
        "",
        *table(STRICTER_HEADER, stricter(rows, found[0].method)),
    ]
    write_section(path, SECTIONS["stress"], lines)


def _budgets(rows: Sequence[Row]) -> list[str]:
    """What was changed of the methods' own configs, so that nobody takes a cut budget for a whole one."""
    options = sorted({option for row in rows for option in row["options"]})
    return [f"Run with {', '.join(options)} over every method's own config."] if options else []


def _levels(rows: Sequence[Row]) -> list[list[str]]:
    named = dict.fromkeys(row["stressor"] for row in rows if row["stressor"])
    made = [(name, STRESSORS[name]) for name in named]
    return [[name, s.what, s.unit, ", ".join(f"{value:g}" for value in s.levels)] for name, s in made]
