"""Rows on disk: one line of JSON a trial, safe before the next one is begun, so that a bench can go on."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from .protocol import Trial
from .section import commit
from .trial import Row, run_trial

FILE = "rows.jsonl"
LIMIT = 2**30  # bytes; a row of 24 frames takes about 8 kB


def read_rows(folder: Path) -> dict[str, Row]:
    """Rows of ``folder`` by their key; a last line that a kill has torn is cut off the file.

    Raises:
        InputError: another line is no row, or the file is too large.
    """
    path = folder / FILE
    if not path.is_file():
        return {}
    if path.stat().st_size > LIMIT:
        raise InputError(path, "", f"expected at most {LIMIT} bytes, got {path.stat().st_size}")
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        os.truncate(path, len(whole))
    return dict(_keyed(path, number, line) for number, line in enumerate(whole.splitlines(), 1))


def _keyed(path: Path, number: int, line: bytes) -> tuple[str, Row]:
    try:
        row = json.loads(line)
        return str(row["key"]), row
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputError(path, f"line {number}", "is no row", "remove the line to run that trial again") from None


def append_row(folder: Path, row: Row) -> None:
    """Add a row; it is on the disk when this returns."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / FILE).open("ab") as stream:
        stream.write(json.dumps(row, allow_nan=False).encode() + b"\n")
        stream.flush()
        os.fsync(stream.fileno())


@dataclass(frozen=True)
class Bench:
    """Where and how trials are run.

    Args:
        folder: of the rows; what is there is not run again.
        jobs: trials at a time, each on one thread.
        networks: results are also read by the networks.
    """

    folder: Path
    jobs: int = 1
    networks: bool = False


def run_trials(trials: list[Trial], bench: Bench, told: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Rows of all trials, in their order; those that are on disk already are taken from there.

    ``told`` hears a line for every new row.

    Raises:
        InputError: the rows on disk are damaged.
    """
    done = read_rows(bench.folder)
    keys = {trial.key(): trial for trial in trials}
    todo = {key: trial for key, trial in keys.items() if key not in done}
    told(f"{len(keys)} trials, {len(keys) - len(todo)} of them done before")
    begun = time.perf_counter()
    for count, row in enumerate(_run(todo, bench), 1):
        row["commit"] = commit()
        append_row(bench.folder, row)
        done[row["key"]] = row
        left = (time.perf_counter() - begun) / count * (len(todo) - count) / 60
        told(f"{count} of {len(todo)}: {row['method']}, {row['shot']}, {row['pupil']}; about {left:.0f} min to go")
    return [done[key] for key in keys]


def _run(trials: Mapping[str, Trial], bench: Bench) -> Iterator[Row]:
    """Rows as they come."""
    if bench.jobs == 1:
        for key, trial in trials.items():
            yield run_trial(trial, key, bench.folder, bench.networks)
        return
    from joblib import Parallel, delayed

    parallel = Parallel(n_jobs=bench.jobs, return_as="generator_unordered", batch_size=1)
    yield from parallel(delayed(run_trial)(trial, key, bench.folder, bench.networks) for key, trial in trials.items())
