"""Machine code is kept where it can be, and never outlives a source that it was made of."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numba.core.caching
import pytest

import cltransfer
from cltransfer.computer import compiled

WHERE = """
from cltransfer.doctor import _kernels
try:
    where = _kernels()
except RuntimeError as error:
    where = str(error)
"""
WEIGH = f"""{WHERE}
import numpy as np
from cltransfer.extractors._kernels import static_flow
from cltransfer.losses._kernels import depth_modes
from cltransfer.renderers.kernels.splat_project import Slab, Tiles
from cltransfer.renderers.kernels.splat_weight import weigh
from cltransfer.renderers.kernels.splat_cull import Settings, make_view

view = make_view(np.eye(4), np.diag([4.0, 4.0, 1.0]), (1, 1), Settings(0.1, 0.0, True))
record = np.zeros((1, 12), np.float32)
record[0, 5] = 1  # peak
slab = Slab(record, np.zeros((1, 6), np.int32), np.zeros(1, np.float32), *np.zeros((2, 1), np.int32))
tiles = Tiles(np.zeros(1, np.uint8), np.array([0, 1], np.int32), *np.zeros((2, 1), np.int32))
weights = np.zeros(1, np.float32)
weigh(view, slab, tiles, np.ones((1, 1), np.float32), weights)
assert depth_modes(np.ones((1, 1, 1), np.float32), np.ones((1, 1, 1, 1), bool)) == 1
assert static_flow.py_func
print(round(float(weights[0]), 3), weigh.stats.cache_hits.total(), where, sep="|")
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the program that has compiled nothing."""
    copy = tmp_path / "cltransfer"
    shutil.copytree(Path(cltransfer.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


def weighed(package: Path, home: Path, script: str = WEIGH, **settings: str) -> list[str]:
    """The greatest share of a pixel by that program, whether it was compiled before, and where."""
    changed = {name: str(home) for name in ("HOME", "XDG_CACHE_HOME", "CLTRANSFER_CACHE")}
    variables = {**os.environ, **changed, "PYTHONPATH": str(package.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    for name in ("NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES"):
        variables.pop(name, None)
    variables |= settings
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env=variables, cwd=package.parent
    )
    return done.stdout.strip().split("|")


@pytest.mark.slow  # processes that compile
def test_what_another_file_says_is_compiled_anew_where_it_changes(package: Path, tmp_path: Path) -> None:
    """And whatever way of keeping code Numba has been set to, it is kept in the one place."""
    other = {"NUMBA_CACHE_LOCATOR_CLASSES": "InTreeCacheLocator"}
    first, again = weighed(package, tmp_path), weighed(package, tmp_path, **other)
    assert first[:2] == ["0.99", "0"]
    assert again == ["0.99", "1", first[2]]
    assert Path(first[2]).parent == package / "__pycache__"
    source = package / "renderers" / "kernels" / "splat_composite.py"
    source.write_text(source.read_text().replace("MAX_ALPHA = 0.99", "MAX_ALPHA = 0.50"))
    assert weighed(package, tmp_path, **other)[:2] == ["0.5", "0"]
    assert weighed(package, tmp_path)[:2] == ["0.5", "1"]


def test_threads_that_import_at_once_keep_their_kernels_in_one_place(monkeypatch: pytest.MonkeyPatch) -> None:
    usual, njit, seen = compiled._CONFIG.CACHE_DIR, numba.njit, []

    def slow(**options: Any) -> Any:
        time.sleep(0.2 if threading.current_thread() is early else 0.4)  # one ends while the other waits
        seen.append(compiled._CONFIG.CACHE_DIR)
        return njit(**options)

    monkeypatch.setattr(numba, "njit", slow)
    early, late = (threading.Thread(target=lambda: compiled.kernel()(lambda x: x)) for _ in range(2))
    early.start()
    late.start()
    early.join()
    late.join()
    assert seen == [str(compiled.folder())] * 2
    assert usual == compiled._CONFIG.CACHE_DIR


@pytest.mark.slow  # a process that compiles
def test_where_no_folder_can_be_written_kernels_work_and_the_doctor_says_so(package: Path) -> None:
    for folder in (package, package / "losses", package / "extractors"):
        (folder / "__pycache__").write_text("no folder")
    share, hits, where = weighed(package, package / "camera.py")  # a home that is a file
    assert (share, hits) == ("0.99", "0")
    assert where.startswith("not kept: each start compiles them anew; set NUMBA_CACHE_DIR")


def test_a_full_disk_costs_no_more_than_compiling_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(self: Any, name: str, data: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(compiled, "folder", lambda: tmp_path)
    monkeypatch.setattr(numba.core.caching.IndexDataCacheFile, "_save_data", full)
    twice, thrice = compiled.kernel()(lambda x: 2 * x), compiled.kernel()(lambda x: 3 * x)
    assert (twice(2), thrice(2), twice(3)) == (4, 6, 6)
    assert caplog.messages == [f"{tmp_path}: No space left on device: each start compiles kernels anew"]


def test_beside_an_installation_that_cannot_be_written_the_cache_is_used(package: Path, tmp_path: Path) -> None:
    (package / "__pycache__").write_text("no folder")
    assert Path(weighed(package, tmp_path / "home", WHERE + "print(where)")[0]).parent == tmp_path / "home"


def test_what_nothing_has_used_for_a_month_is_deleted_and_nothing_else(tmp_path: Path) -> None:
    old, new, own = (f"kernels-{letter * 16}" for letter in "0ab")
    for name, days in ((old, 40), (new, 3), ("kernels-of-mine", 40), ("other", 40)):
        (tmp_path / name).mkdir()
        then = (tmp_path / name).stat().st_mtime - days * 24 * 3600
        os.utime(tmp_path / name, (then, then))
    (tmp_path / f"kernels-{'c' * 16}").symlink_to("gone")  # as if another process had just deleted it
    assert compiled._opened(tmp_path / own) == tmp_path / own
    assert sorted(path.name for path in tmp_path.iterdir() if path.exists()) == [new, own, "kernels-of-mine", "other"]
