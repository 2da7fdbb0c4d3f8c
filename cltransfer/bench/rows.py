"""Rows on disk: one line of JSON a trial, safe before the next one is begun, so that a bench can go on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import torch

from ..computer.memory import require_parsed
from ..computer.processor import load_average, processor
from ..computer.revision import commit
from ..computer.safe_path import safe_path
from ..errors import CltransferError
from ..storage.alone import alone
from ..storage.kept_lines import keep, read_kept
from .judge import HELD_OUT, Reader
from .protocol import Trial
from .trial import Row, run_trial

FILE = "rows.jsonl"
Task = TypeVar("Task")
LIMIT = 2**30  # bytes; a row of 24 frames takes about 8 kB


def read_rows(folder: Path) -> dict[str, Row]:
    """Rows of ``folder`` by their key; a last line that a kill has torn is cut off the file.

    Raises:
        InputError: another line is no row, or the file is too large or a link.
        ResourceError: there may not be memory for them.
    """
    return {row["key"]: row for row in read_kept(folder / FILE, LIMIT, _row_of, "row", require_parsed)}


def _row_of(line: Any) -> Row:
    if not (isinstance(line, dict) and isinstance(line["key"], str)):
        raise TypeError
    return line


def kept_rows(
    tasks: Mapping[str, Task],
    measure: Callable[[str, Task], Row],
    folder: Path,
    jobs: int = 1,
    told: Callable[[str], None] = lambda line: None,
    named: Callable[[Row], str] = lambda row: str(row["key"]),
) -> list[Row]:
    """Rows of all tasks, in their order; those that are on disk already are taken from there.

    Args:
        tasks: by key; a key says all that a row depends on.
        measure: the row of a task and its key, plain values.
        folder: of the rows.
        jobs: tasks at a time, each in a process of its own where there are several.
        told: hears a line for every new row.
        named: a row in a few words, for that line.

    Raises:
        InputError: the rows on disk are damaged.
        ResourceError: another process measures into that folder.
        CltransferError: a task could not be measured; the rows of all others are kept before.
    """
    with alone(folder, "runs a bench", "--rows"):
        done = read_rows(folder)
        todo = {key: task for key, task in tasks.items() if key not in done}
        told(f"{len(tasks)} trials, {len(tasks) - len(todo)} of them done before")
        where = {"commit": commit(), "machine": processor(), "torch": torch.__version__}  # the code as it was loaded
        begun, lost = time.perf_counter(), []
        for count, (key, row) in enumerate(_run(todo, measure, jobs), 1):
            left = f"about {(time.perf_counter() - begun) / count * (len(todo) - count) / 60:.0f} min to go"
            if isinstance(row, CltransferError):
                lost.append(row)
                told(f"{count} of {len(todo)}: {row}; {left}")
                continue
            done[key] = {**row, "key": key, **where, "load": load_average()}
            keep(folder / FILE, done[key])
            told(f"{count} of {len(todo)}: {named(done[key])}; {left}")
    if lost:
        raise lost[0]
    return [done[key] for key in tasks]


def _run(
    todo: Mapping[str, Task], measure: Callable[[str, Task], Row], jobs: int
) -> Iterator[tuple[str, Row | CltransferError]]:
    """Keys and rows as they come; in place of a row the error that says why there is none."""

    def measured(key: str, task: Task) -> tuple[str, Row | CltransferError]:
        try:
            return key, measure(key, task)
        except CltransferError as error:
            return key, error

    if jobs == 1:
        yield from (measured(key, task) for key, task in todo.items())
        return
    with safe_path():
        from joblib import Parallel, delayed

        parallel = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        yield from parallel(delayed(measured)(key, task) for key, task in todo.items())


def measured_at(rows: Iterable[Row]) -> str:
    """Line that says by which commits ``rows`` were measured."""
    return f"Rows measured at {', '.join(sorted({row.get('commit', 'an earlier one') for row in rows}))}."


def run_trials(
    trials: list[Trial],
    folder: Path,
    jobs: int = 1,
    told: Callable[[str], None] = lambda line: None,
    networks: bool = False,
) -> list[Row]:
    """Rows of all trials, in their order; see :func:`kept_rows`. With ``networks`` these read the results too."""
    if networks and trials:  # one that is missing shows at once
        Reader.of(trials[0].pupil, HELD_OUT["networks"]).parts.plan("image").load_networks()
    return kept_rows(
        {trial.key(networks): trial for trial in trials},
        lambda key, trial: run_trial(trial, key, folder, networks),
        folder,
        jobs,
        told,
        lambda row: f"{row['method']}, {row['shot']}, {row['pupil']}",
    )
