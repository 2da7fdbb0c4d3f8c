"""Trials in parallel: by processes of this computer (joblib's loky) or on a dask cluster."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any

from ..computer.safe_path import safe_path
from ..computer.threads import thread_count
from ..errors import ModelError, ResourceError, UsageError
from .outcome import Outcome
from .sweep import EngineConfig
from .trial import Job, Trial, run_trial

PATIENCE = 30  # seconds to wait for a scheduler


def outcomes(trials: Sequence[Trial], job: Job, engine: EngineConfig) -> Iterator[Outcome]:
    """What comes of each trial, in the order in which they end.

    A trial that takes its process down with it (out of memory, a crash in native code) is a failed one; those that
    only shared the pool with it are run again.

    Raises:
        ResourceError: the cluster cannot be reached, or is lost.
        UsageError: dask is not installed.
        ModelError: a worker has other code, packages, plugins or networks, see :func:`run_trial`.
    """
    if engine.backend == "dask":
        return _on_cluster(trials, job, engine.address or "")
    return _by_processes(trials, job, engine.workers or thread_count())


def _by_processes(trials: Sequence[Trial], job: Job, workers: int) -> Iterator[Outcome]:
    with safe_path():  # as long as workers may be started anew
        yield from _by_workers(trials, job, workers)


def _by_workers(trials: Sequence[Trial], job: Job, workers: int) -> Iterator[Outcome]:
    from joblib.externals.loky import get_reusable_executor
    from joblib.externals.loky.process_executor import BrokenProcessPool

    waiting = {trial.key: trial for trial in trials}
    while waiting:
        begun: list[Trial] = []
        try:
            for outcome in _parallel(list(waiting.values()), job, workers, begun.append):
                del waiting[outcome.key]
                yield outcome
        except BrokenProcessPool:  # somebody among those begun: each of them gets a pool of its own
            for trial in begun:
                if waiting.pop(trial.key, None):
                    try:
                        yield from _parallel([trial], job, workers)
                    except BrokenProcessPool:
                        yield _killed(trial)
    if trials:  # idle workers would be waited for when all is said
        get_reusable_executor(max_workers=1, kill_workers=True).shutdown(kill_workers=True)


def _parallel(
    trials: Iterable[Trial], job: Job, workers: int, begin: Callable[[Trial], None] = lambda trial: None
) -> Iterator[Outcome]:
    from joblib import Parallel, delayed, parallel_config

    def calls() -> Iterator[Any]:
        for trial in trials:
            begin(trial)
            yield delayed(run_trial)(trial, job)

    # a pool of one would be this process itself, and a crash would end the sweep: of two, one has nothing to do
    with warnings.catch_warnings(), parallel_config("loky", n_jobs=max(2, workers), inner_max_num_threads=1):
        warnings.filterwarnings("ignore", message=".*tasks which were still being processed")  # on an interrupt
        yield from Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch=workers)(calls())


def _on_cluster(trials: Sequence[Trial], job: Job, address: str) -> Iterator[Outcome]:
    try:
        from distributed import Client
    except ImportError:
        raise UsageError("", "engine.backend", "dask is not installed", "pip install 'cltransfer[cluster]'") from None
    for logger in ("distributed", "distributed.client"):  # a lost connection is told once, by us
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ResourceError(address, "engine.address", f"no scheduler answers: {error}") from None
    left = len(trials)
    try:
        with client:
            together: list[Trial] = []
            for found in _answers(client, trials, job):
                if isinstance(found, Trial):
                    together.append(found)
                else:
                    left -= 1
                    yield found
            for trial in together:  # each alone, as somebody else's crash may have taken it along
                (found,) = _answers(client, [trial], job)
                left -= 1
                yield _killed(trial) if isinstance(found, Trial) else found
    except (CancelledError, OSError):
        reason = f"the scheduler was lost, {left} of {len(trials)} trials are left"
        hint = "start it again; the same command goes on from here"
        raise ResourceError(address, "engine.address", reason, hint) from None


def _answers(client: Any, trials: Sequence[Trial], job: Job) -> Iterator[Outcome | Trial]:
    """What comes of trials, as they end; the trial itself where the workers that it ran or waited on have died.

    Raises:
        CancelledError, OSError: the scheduler is lost.
        ModelError: see :func:`run_trial`.
    """
    from distributed import KilledWorker, as_completed

    calls = {client.submit(run_trial, trial, job, pure=False): trial for trial in trials}
    for future in as_completed(calls, loop=client.loop):
        lost, trial = future.exception(), calls[future]
        if lost is None:
            yield future.result()
        elif isinstance(lost, KilledWorker):
            yield trial
        elif isinstance(lost, ModelError | CancelledError):
            raise lost
        else:  # the worker could not even begin, or could not answer
            yield Outcome(trial.key, trial.row, trial.case, failed=f"{type(lost).__name__}: {lost}")


def _killed(trial: Trial) -> Outcome:
    return Outcome(trial.key, trial.row, trial.case, failed="its process was killed (out of memory?)")
