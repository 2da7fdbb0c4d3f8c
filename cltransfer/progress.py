"""Progress on stderr: one live line on a terminal, one plain line a step elsewhere; results go to stdout."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SILENCE = 10.0  # [s] after which a plain progress says where it is
Progress = Callable[[str, int, int], None]  # step, done, total; a total of 0 means that nobody knows


def silent(step: str, done: int, total: int) -> None:
    """A progress that says nothing."""


@contextmanager
def progress(quiet: bool) -> Iterator[Progress]:
    """What long work reports to."""
    if quiet:
        yield silent
    elif sys.stderr.isatty():
        with _live() as report:
            yield report
    else:
        yield _plain()


def _plain() -> Progress:
    """A line for every quarter of a step, and after :data:`SILENCE` without one, as long as anybody reads them."""
    told: set[tuple[str, int]] = set()
    last, read = -math.inf, True

    def report(step: str, done: int, total: int) -> None:
        nonlocal last, read
        quarter = 4 * done // total if total else 0
        if read and ((step, quarter) not in told or time.monotonic() - last >= SILENCE):
            told.add((step, quarter))
            last = time.monotonic()
            try:
                print(f"{step} {done}/{total}" if total else step, file=sys.stderr, flush=True)
            except OSError:  # no reader, no room: the work goes on
                read = False

    return report


@contextmanager
def _live() -> Iterator[Progress]:
    from rich import progress as bar
    from rich.console import Console

    columns = (bar.TextColumn("{task.description:<24}"), bar.BarColumn(), bar.MofNCompleteColumn())
    times = (bar.TimeElapsedColumn(), bar.TimeRemainingColumn())
    with bar.Progress(*columns, *times, console=Console(stderr=True)) as bars:
        tasks: dict[str, bar.TaskID] = {}
        endless = ""  # step under way of which nobody knows how long it takes: it has ended where another begins

        def end() -> None:
            if endless:
                bars.update(tasks[endless], completed=1, total=1)

        def report(step: str, done: int, total: int) -> None:
            nonlocal endless
            if step != endless:
                end()
            if step not in tasks or (not total and step != endless):  # one that has ended begins anew, as one line
                if step in tasks:
                    bars.remove_task(tasks[step])
                tasks[step] = bars.add_task(step, total=total or None)
            bars.update(tasks[step], completed=done, total=total or None)
            endless = "" if total else step

        yield report
        end()
