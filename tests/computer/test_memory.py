from __future__ import annotations

import json
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest

from cltransfer.computer import memory
from cltransfer.computer.memory import LITTLE, THREAD, VARIABLE, affordable, free_bytes, require_free, require_parsed
from cltransfer.errors import ResourceError, UsageError


@pytest.fixture
def proc(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process of 300 MB on a machine with 8,000 MB left, no container."""
    sizes = {
        "/proc/meminfo": {"MemAvailable": 8000 * 2**20},
        "/proc/self/status": {"VmSize": 900 * 2**20, "VmData": 400 * 2**20, "VmRSS": 300 * 2**20},
    }
    monkeypatch.setattr(memory, "_sizes", lambda path: sizes[str(path)])
    monkeypatch.setattr(memory, "_CGROUP", Path("/nowhere"))
    monkeypatch.setattr(memory, "_of_process", lambda sizes: [])
    monkeypatch.delenv(VARIABLE, raising=False)


def test_the_machine_says_what_is_left(proc: None) -> None:
    assert free_bytes() == 8000 * 2**20


def test_the_variable_is_about_the_whole_process(proc: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "1000")
    assert free_bytes() == 700 * 2**20
    monkeypatch.setenv(VARIABLE, "200")
    assert free_bytes() == 0
    for bad in ("0", "-5", "2 GB"):
        monkeypatch.setenv(VARIABLE, bad)
        with pytest.raises(UsageError, match="expected a positive whole number of MB"):
            free_bytes()


def test_a_container_leaves_less(proc: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(memory, "_CGROUP", tmp_path)
    for name, text in (("max", "4000000\n"), ("current", "3000000\n"), ("stat", "anon 5\ninactive_file 500000\n")):
        (tmp_path / f"memory.{name}").write_text(text)
    assert free_bytes() == 1_500_000
    (tmp_path / "memory.max").write_text("max\n")
    assert free_bytes() == 8000 * 2**20


@pytest.mark.skipif(sys.platform != "linux", reason="limits are read from /proc")
def test_a_limit_of_the_shell_leaves_less() -> None:
    code = """
import resource
resource.setrlimit(resource.RLIMIT_AS, (2**30,) * 2)
from cltransfer.computer.memory import free_bytes
print(free_bytes())
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 2**29 < int(run.stdout) < 2**30


def test_a_system_that_says_nothing_limits_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(memory, "_sizes", lambda path: {})
    monkeypatch.setattr(memory, "_CGROUP", tmp_path)
    monkeypatch.setattr(memory, "_of_process", lambda sizes: [])
    monkeypatch.delenv(VARIABLE, raising=False)
    assert free_bytes() is None


def test_what_is_more_than_free_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for free in (2**20, None):
        monkeypatch.setattr(memory, "free_bytes", lambda free=free: free)
        require_free(2**20, "a.glb", "meshes", "thin them")
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**20)
    with pytest.raises(ResourceError) as caught:
        require_free(3 * 2**20, "a.glb", "meshes", "thin them")
    hint = f"raise the limit of the system or of {VARIABLE}, or thin them"
    assert str(caught.value) == f"a.glb: memory: meshes need 3 MB, 1 MB are free ({hint})"


@pytest.mark.parametrize("value", ["[]", "{}", "[[]]", '{"":0}', "[" * 500 + "]" * 500, '"ab"', "0"])
def test_json_that_is_read_takes_no_more_memory_than_it_was_held_against(
    monkeypatch: pytest.MonkeyPatch, value: str
) -> None:
    text = f"[{','.join([value] * (2**18 // len(value)))}]"
    tracemalloc.start()
    values = json.loads(text)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    monkeypatch.setattr(memory, "free_bytes", lambda: most)
    with pytest.raises(ResourceError, match=rf"a\.jsonl: memory: values of {len(text)} bytes of JSON need"):
        require_parsed(len(text), "a.jsonl")
    assert values


@pytest.mark.parametrize(("free", "workers"), [(None, 8), (9.0, 8), (3.1, 3), (2.9, 2), (0.9, 1), (0, 1)])
def test_as_many_work_as_there_is_memory_for(monkeypatch: pytest.MonkeyPatch, free: float | None, workers: int) -> None:
    there = None if free is None else int(free * (LITTLE + THREAD))
    monkeypatch.setattr(memory, "free_bytes", lambda: there)
    assert affordable(8, LITTLE) == workers
    assert affordable(8, LITTLE // 8) == 8  # too little to ask
    assert affordable(8, LITTLE, beside=10 * (LITTLE + THREAD)) == (8 if free is None else 1)
