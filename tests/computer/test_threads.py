import os
from pathlib import Path

import cv2
import pytest
import torch

from cltransfer import Inputs, load_config, transfer
from cltransfer.computer import threads
from cltransfer.computer.threads import default_count, set_threads, thread_count
from cltransfer.errors import InputError, UsageError
from cltransfer.progress import silent
from cltransfer.run.render import render_run


def test_the_variable_decides(monkeypatch):
    monkeypatch.setenv("CLTRANSFER_THREADS", "3")
    assert thread_count() == 3


@pytest.mark.parametrize("value", ["0", "-1", "many", "1.5", "1025", "99999999999", "9999999999999999999999"])
def test_a_variable_that_is_no_count_is_refused(monkeypatch, value):
    monkeypatch.setenv("CLTRANSFER_THREADS", value)
    with pytest.raises(UsageError, match="CLTRANSFER_THREADS"):
        thread_count()


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system has no CPU affinity")
def test_without_the_variable_the_affinity_counts(monkeypatch):
    monkeypatch.delenv("CLTRANSFER_THREADS", raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 2, 5})
    assert thread_count() == 3


def test_an_empty_variable_names_no_count(monkeypatch):
    monkeypatch.setenv("CLTRANSFER_THREADS", "")
    assert default_count() == thread_count() > 0


def test_set_threads_reaches_every_library(monkeypatch):
    monkeypatch.setenv("CLTRANSFER_THREADS", "1")
    before = torch.get_num_threads(), cv2.getNumThreads()
    set_threads(1)
    assert (torch.get_num_threads(), cv2.getNumThreads(), thread_count()) == (1, 1, 1)
    set_threads(2)
    assert (torch.get_num_threads(), cv2.getNumThreads(), thread_count()) == (1, 2, 2)
    set_threads(2, tensors=2)
    assert torch.get_num_threads() == 2
    torch.set_num_threads(before[0])
    cv2.setNumThreads(before[1])
    with pytest.raises(ValueError, match="at least 1"):
        set_threads(0)


def test_the_count_of_one_run_is_not_that_of_the_next(monkeypatch):
    monkeypatch.setattr("cltransfer.computer.threads._set", ("", 0))
    monkeypatch.setenv("CLTRANSFER_THREADS", "2")
    assert default_count() == 2
    for count in (1, 3, 3):
        set_threads(count)
        assert (thread_count(), default_count()) == (count, 2)
    monkeypatch.setenv("CLTRANSFER_THREADS", "1")  # asked for anew
    assert default_count() == 1


def test_who_calls_a_transfer_keeps_its_own_threads(
    tiny_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(threads.VARIABLE, raising=False)
    torch.set_num_threads(2)
    cv2.setNumThreads(3)
    during = list[tuple[int, ...]]()

    def note(step: str, done: int, of: int) -> None:
        during.append((torch.get_num_threads(), cv2.getNumThreads(), thread_count()))

    small = ["preset=fast", "frames=1", "search_side=48", "output_side=64", "threads=1"]
    transfer(Inputs("builtin:plaza", "builtin:static"), load_config(overrides=small), note)
    assert set(during) == {(1, 1, 1)}
    with pytest.raises(InputError, match="no such file"):
        transfer(Inputs("missing.ply", "builtin:static"), load_config(overrides=small))
    render_run(tiny_run, ["threads=1"], None, None, tmp_path / "again.mp4", silent)
    assert (torch.get_num_threads(), cv2.getNumThreads(), os.environ.get(threads.VARIABLE)) == (2, 3, None)
    assert threads._set == ("nothing", 0)


@pytest.mark.parametrize("turn", ["first", "second"])
def test_what_a_test_leaves_behind_is_gone_for_the_next(turn: str, cache: Path) -> None:
    """Either turn finds nothing of the other; pytest runs them one after the other."""
    assert os.environ["CLTRANSFER_CACHE"] == str(cache)
    assert "CLTRANSFER_MODELS" not in os.environ
    assert threads._set != ("7", 7)
    assert 7 not in (torch.get_num_threads(), cv2.getNumThreads())
    assert os.environ.get(threads.VARIABLE) != "7"
    os.environ["CLTRANSFER_CACHE"] = os.environ["CLTRANSFER_MODELS"] = "left behind"
    os.environ[threads.VARIABLE] = "7"
    threads.set_threads(7, tensors=7)
