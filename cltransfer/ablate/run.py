"""The story of an ablation: table of overrides -> trials -> ledger -> tables; it goes on where it was stopped."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ..computer.revision import commit
from ..errors import UsageError
from ..models.content import read_by
from ..paired import CONFIDENCE, FEWEST, LEVEL
from ..pipeline.components import Components
from ..plugins import settle
from ..progress import Progress, silent
from ..registry.plugin_code import own_code
from ..report.tables import escape, to_latex, to_markdown
from ..storage.alone import alone
from ..storage.files import check_out, refuse_outside, write_json, write_text
from ..storage.run_files import DONE
from ..storage.unfinished import clear_left, left_in
from .content import Digest, digests, plugin_codes
from .drawn import DRAWN_REFERENCES, draw_references
from .ledger import append, read_ledger
from .measurable import check_measurable, unmeasured
from .outcome import Outcome
from .pool import outcomes
from .read import DRAWN
from .sources import check_sources
from .summary import RowSummary, alike, shot_of, summarise
from .sweep import Sweep
from .tables import differences_table, directions_table, failure_lines, to_csv, values_table
from .trial import Job, trials

_log = logging.getLogger("cltransfer")
LEDGER, FILE = "trials.jsonl", "ablation.yaml"
MARK = "# made by: "  # how an ablation.yaml that was written here begins
TABLES = ("table.csv", "table.md", "table.tex", "summary.json")
WRITTEN = re.compile("|".join(map(re.escape, (FILE, *TABLES))))


@dataclass(frozen=True)
class Options:
    """How a sweep is run.

    Args:
        out: folder; a sweep that was begun there goes on.
        keep_runs: leave every run's whole folder in ``out/runs``.
        retry: run the trials again that failed.
        plugins: to allow in the workers too.
        command: that makes it again; empty where it was not one.
    """

    out: Path
    keep_runs: bool = False
    retry: bool = False
    plugins: tuple[str, ...] = ()
    command: str = ""


@dataclass(frozen=True)
class Ablation:
    """A sweep that was run.

    Args:
        sweep: what was run.
        rows: a summary for each.
        outcomes: what came of every trial, in the order of the table.
        unkept: trials whose runs were to be kept, but that had been run before without that.
        old: trials that failed in an earlier run of the command, and were not run again.
    """

    sweep: Sweep
    rows: tuple[RowSummary, ...]
    outcomes: tuple[Outcome, ...]
    unkept: int = 0
    old: int = 0

    @property
    def failed(self) -> int:
        """Trials without a result."""
        return sum(bool(outcome.failed) for outcome in self.outcomes)


def ablate(sweep: Sweep, options: Options, progress: Progress = silent) -> Ablation:
    """Run every trial of ``sweep`` that its folder does not have yet, and write the tables.

    Leaves trials.jsonl, table.csv, table.md, table.tex, summary.json and ablation.yaml in the folder.

    Args:
        sweep: what is run.
        options: where and how.
        progress: called with a step, trials done, trials in all.

    Raises:
        UsageError: the folder holds something else, a row cannot be built, the metrics name a loss that they cannot
            feed, or there is no such scene or shot.
        InputError: a scene or a reference is missing, the ledger is damaged, or a part of the folder leads elsewhere.
        ResourceError: another process runs one in that folder, or the cluster cannot be reached, or is lost.
        ModelError: a worker has other code, packages, plugins or networks.
    """
    _check_folder(options.out)
    for row in sweep.rows:
        Components.build(row.config)
        row.config.build_one("search")
    lacking = check_measurable(sweep)
    digest = digests()
    check_sources(sweep, digest)
    with alone(options.out, "runs an ablation"):
        return _run(sweep, options, digest, [*lacking, *unmeasured(sweep)], progress)


def _run(sweep: Sweep, options: Options, digest: Digest, notes: Sequence[str], progress: Progress) -> Ablation:
    """Run what is missing of a sweep that can be run, in a folder that is held; ``notes`` are told before that."""
    clear_left(options.out, WRITTEN)
    asked = trials(sweep, draw_references(sweep, options.out), digest)
    made_by = " ".join(options.command.split()) or "cltransfer.ablate"
    _tell_replaced(options.out, sweep)
    write_text(options.out / FILE, f"{MARK}{made_by}\n{sweep.to_yaml()}")
    known = {key: outcome for key, outcome in read_ledger(options.out / LEDGER).items() if outcome.lasts}
    missing = [t for t in asked if t.key not in known or (options.retry and known[t.key].failed)]
    runs = options.out.resolve() / "runs"
    kept_in = str(runs) if options.keep_runs else None
    elsewhere = sweep.file.engine.backend == "dask"
    job = Job(tuple(settle(options.plugins)), kept_in, plugin_codes(), own_code(), elsewhere, tuple(read_by()))
    wanting = {t.key for t in missing}
    before = [t.key for t in asked if t.key not in wanting and not known[t.key].failed]
    unkept = sum(not (runs / key / DONE).is_file() for key in before) if options.keep_runs else 0
    old = sum(bool(known[t.key].failed) for t in asked if t.key not in wanting)
    for note in notes if missing else ():
        _log.warning("%s", note)
    if missing:  # what lies there is of another sweep, or not of all of this
        for name in TABLES:
            (options.out / name).unlink(missing_ok=True)
    progress("trials", len(asked) - len(missing), len(asked))
    here = commit()
    for done, outcome in enumerate(outcomes(missing, job, sweep.file.engine), len(asked) - len(missing) + 1):
        known[outcome.key] = outcome = replace(outcome, commit=here)
        append(options.out / LEDGER, outcome)
        progress("trials", done, len(asked))
    found = tuple(replace(known[trial.key], row=trial.row, case=trial.case) for trial in asked)  # renamed since, maybe
    ablation = Ablation(sweep, tuple(summarise([row.name for row in sweep.rows], found)), found, unkept, old)
    _write(options.out, ablation)
    return ablation


def _tell_replaced(out: Path, sweep: Sweep) -> None:
    """Tell where the tables of another sweep lie in the folder: they go, its trials are kept."""
    if (out / TABLES[0]).is_file() and (out / FILE).is_file():
        with (out / FILE).open("rb") as stream:
            stream.readline(2**16)  # the command
            there = stream.read(2**20)
        asked, before = (text.rpartition(b"\nengine:")[0] for text in (sweep.to_yaml().encode(), there))
        if asked != before:  # by how many workers it runs, which stands last, changes no table
            _log.warning("%s: the tables of another sweep are replaced, its trials kept (--out names another)", out)


def _check_folder(out: Path) -> None:
    check_out(out)
    there = {path.name for path in {*out.iterdir()} - {*left_in(out, WRITTEN)}} if out.is_dir() else set()
    ours = LEDGER in there or (FILE in there and _is_marked(out / FILE))  # a file of that name may be the user's own
    if not there <= {DRAWN_REFERENCES} and not ours:  # what is drawn comes first
        raise UsageError(out, "--out", "is neither empty nor an ablation", "name another folder")
    refuse_outside(out, out.rglob("*"), "ablation")  # somebody else may have made it; runs are written into it too


def _is_marked(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(len(MARK)) == MARK.encode()


def _write(out: Path, ablation: Ablation) -> None:
    write_text(out / "table.csv", to_csv(ablation.rows))
    write_text(out / "table.md", "\n".join(markdown(ablation)) + "\n")
    tables = [values_table(ablation.rows)]
    if len(ablation.rows) > 1:
        tables.append(differences_table(ablation.rows))
    if any(row.directions for row in ablation.rows):
        tables.append(directions_table(ablation.rows))
    write_text(out / "table.tex", "\n\n".join("\n".join(to_latex(table)) for table in tables) + "\n")
    write_json(out / "summary.json", summary_values(ablation))


def markdown(ablation: Ablation) -> list[str]:
    """The tables with what a reader must know, and every failure with its reason."""
    lines = [
        *_head(ablation.sweep),
        f"Mean [{CONFIDENCE:.0%} bootstrap interval] over references, of {FEWEST} or more; of few",
        "such percentiles hold the truth less often (of 6 in 86 % of cases, of 9 in 91). All rows are measured by the",
        f"same metrics at {ablation.sweep.metrics.output_side} px, lower is better; (a/b): only a of b frames have a",
        "value, where the render alone lacks one it pays the penalty. Failed trials have no value and are counted.",
        _drawn(ablation.sweep),
        f"References: {len({shot_of(outcome.case) for outcome in ablation.outcomes})}. Each counts as one, its scenes",
        "averaged first, and its seeds too where they do not draw it: intervals and tests speak of references, in the",
        "scenes that are named.",
        *_alike_by_seed(ablation.sweep),
        f"Measured at {', '.join(_commits(ablation))}.",
        "",
        *to_markdown(values_table(ablation.rows)),
    ]
    if len(ablation.rows) > 1:
        first = ablation.rows[0].name
        lines += [
            "",
            f"Paired with {escape(first)}, case by case (n pairs); bold: the interval excludes zero and the",
            f"signed-rank test has p at most {LEVEL}, of {FEWEST} pairs or more that differ. The p are not corrected",
            "for their number.",
            "",
        ]
        lines += to_markdown(differences_table(ablation.rows))
    if any(row.directions for row in ablation.rows):
        lines += [
            "",
            "Which way a row errs: mean of render less reference, 0 is right (jerk is that of the path); bold: apart",
            "from the first row, as above.",
            "",
        ]
        lines += to_markdown(directions_table(ablation.rows))
    lines += ["", *_notes(ablation)]
    failures = failure_lines(ablation.outcomes)
    old = f" {ablation.old} of them in an earlier run: --retry runs them again." * bool(ablation.old)
    return [*lines, f"Failed: {len(failures)} of {len(ablation.outcomes)} trials.{old}", *failures]


def _head(sweep: Sweep) -> list[str]:
    lines = [f"# {escape(sweep.name)}", ""]
    if sweep.file.about:
        lines += [escape(sweep.file.about), ""]
    if sweep.over:
        lines += [f"Over every row, from the command line: {_items(sweep.over)}."]
        if sweep.judging:
            lines += [f"All rows are measured by {_items(sweep.judging)} too, where the metrics say nothing else."]
        lines += [""]
    return lines


def _items(said: Sequence[str]) -> str:
    return ", ".join(f"`{item}`" for item in said)


def _drawn(sweep: Sweep) -> str:
    name = next(iter(sweep.metrics.renderer))
    return f"What is measured is drawn by {name} in every row, a scene of another geometry by the renderer of that."


def _alike_by_seed(sweep: Sweep) -> list[str]:
    """A warning where a seed draws several references, which is more than it has people."""
    shots = sum(reference.startswith(DRAWN) for reference in sweep.file.references)
    if shots < 2:
        return []
    told = (
        f"The {shots} drawn shots of a seed show one person: intervals and tests take them for independent, too sure."
    )
    return [told]


def _commits(ablation: Ablation) -> list[str]:
    return sorted({outcome.commit or "an earlier commit" for outcome in ablation.outcomes})


def _notes(ablation: Ablation) -> list[str]:
    """What the searches of a row have to say, losses of a row that nothing measures, and rows that do not differ."""
    said = Counter((outcome.row, outcome.note) for outcome in ablation.outcomes if outcome.note)
    notes = [f"{escape(row)}: {escape(note)} ({count} trials)" for (row, note), count in said.items()]
    measures = [item for outcome in ablation.outcomes for item in (outcome.metrics or {}).items()]
    lacking = Counter((name, metric.mean is None, metric.reason) for name, metric in measures if metric.reason)
    for (name, empty, reason), count in lacking.items():
        told = "has no value" if empty else "pays its penalty"
        notes.append(f"{escape(name)} {told}: {escape(reason)} ({count} trials)")
    notes += unmeasured(ablation.sweep, escape)
    if len(frames := {row.config.frames for row in ablation.sweep.rows}) > 1:
        counts = ", ".join(str(count or "all") for count in sorted(frames, key=lambda count: (count is None, count)))
        notes.append(f"rows differ in frames ({counts}): so does what moves from one frame to the next")
    for one, other in alike(ablation.outcomes):
        told = "came out the same in every value: what sets them apart has no effect here"
        notes.append(f"rows {escape(one)} and {escape(other)} {told}")
    return [*sorted(f"- {note}" for note in notes), ""] if notes else []


def summary_values(ablation: Ablation) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "format": "cltransfer.ablation",
        "version": 1,
        "name": ablation.sweep.name,
        "rows": [asdict(row) for row in ablation.rows],
        "failures": _failures(ablation.outcomes),
    }


def _failures(found: Sequence[Outcome]) -> list[dict[str, Any]]:
    return [{"row": o.row, **asdict(o.case), "reason": o.failed} for o in found if o.failed]
