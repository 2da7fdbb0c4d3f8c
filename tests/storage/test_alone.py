"""A folder is locked by the process that works in it, until that has ended in any way."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import pytest

from cltransfer.errors import InputError, ResourceError
from cltransfer.storage.alone import alone, in_turn

HOLD = """
import sys
from pathlib import Path
from cltransfer.storage.alone import alone
with alone(Path(sys.argv[1]), "waits"):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_another_process_is_refused_until_the_first_was_killed(tmp_path: Path) -> None:
    folder, words = tmp_path / "a" / "b", [sys.executable, "-c", HOLD, str(tmp_path / "a" / "b")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(ResourceError) as caught, alone(folder, "works"):
            pass
        other.kill()
    assert str(caught.value) == (
        f"{folder}: --out: another process works there (wait until it ends, or name another --out)"
    )
    with alone(folder, "works"):
        (folder / "closed").open("w").close()
        with pytest.raises(ResourceError), alone(folder, "works"):
            pass
    with alone(folder, "works"):
        pass
    assert [path.name for path in folder.iterdir()] == ["closed"]


def test_a_folder_that_was_made_for_nothing_is_gone_again_and_no_other(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with alone(tmp_path / "there", "works"):
        pass
    with pytest.raises(InputError), alone(tmp_path / "there" / "a" / "b", "works"):
        raise InputError("", "clip", "is damaged")
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    assert list((tmp_path / "there").iterdir()) == []


@contextmanager
def nobody() -> Iterator[None]:
    """Within, files are opened as by one who owns none of them, though the superuser runs the tests."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


def test_a_lock_that_may_only_be_read_is_held_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fcntl = pytest.importorskip("fcntl")
    (tmp_path / "pins.lock").touch(0o444)
    tmp_path.chmod(0o555)
    monkeypatch.chdir(tmp_path)  # from where what lies here is reached, whoever owns the folders above
    try:
        with nobody(), in_turn(Path("pins.lock")), Path("pins.lock").open() as other, pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with nobody(), pytest.raises(PermissionError, match="missing"), in_turn(Path("missing.lock")):
            pass
    finally:
        tmp_path.chmod(0o700)


def test_who_takes_its_turn_waits_for_the_first(tmp_path: Path) -> None:
    lock, order = tmp_path / "cache" / "pins.lock", list[str]()

    def second() -> None:
        with in_turn(lock):
            order.append("second")

    with in_turn(lock):
        other = Thread(target=second)
        other.start()
        other.join(0.1)
        order.append("first")
    other.join()
    assert order == ["first", "second"]
    assert [path.name for path in lock.parent.iterdir()] == ["pins.lock"]
