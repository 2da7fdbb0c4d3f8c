"""What lies in the folder that a command is started in is not imported by the processes that it starts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cltransfer.computer.safe_path import safe_path

WORK = """
from cltransfer.computer.safe_path import safe_path

with safe_path():
    from joblib import Parallel, delayed
    print(Parallel(2)(delayed(abs)(number) for number in (-1, -2)))
"""


def test_neither_workers_nor_what_keeps_track_of_them_import_from_there(tmp_path: Path) -> None:
    """Of a script that lies elsewhere, as the command does."""
    script, here, marker = tmp_path / "bin" / "work.py", tmp_path / "here", tmp_path / "was imported"
    script.parent.mkdir()
    here.mkdir()
    script.write_text(WORK)
    for name in ("joblib", "multiprocessing"):
        (here / f"{name}.py").write_text(f"open({str(marker)!r}, 'w').close()\nraise SystemExit(1)\n")
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    command = [sys.executable, str(script)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=here, env=variables)
    assert not marker.exists()
    assert (done.stdout, done.returncode) == ("[1, 2]\n", 0), done.stderr


@pytest.mark.parametrize("before", [None, "", "1"])
def test_afterwards_the_environment_is_as_it_was(before: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    if before is not None:
        monkeypatch.setenv("PYTHONSAFEPATH", before)
    with safe_path():
        assert os.environ["PYTHONSAFEPATH"] == "1"
    assert os.environ.get("PYTHONSAFEPATH") == before
