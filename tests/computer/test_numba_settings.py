"""A file of settings in the folder that a command is started in changes nothing of Numba."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SETTINGS = "cache_dir: {}\ndisable_jit: 1\nboundscheck: 1\n"
KERNELS = """
{before}
from cltransfer.renderers.kernels.splat_cull import View
import numba
from cltransfer.computer import compiled
from cltransfer.losses._kernels import depth_modes

before = dict(vars(numba.config))
numba.njit(lambda x: x)(1)  # which reads settings again
changed = [name for name, value in vars(numba.config).items() if name.isupper() and value is not before[name]]
print(compiled.folder(), hasattr(depth_modes, "inspect_llvm"), numba.config.BOUNDSCHECK, changed, sep="|")
"""


@pytest.mark.parametrize("before", ["", "import numba"])
def test_settings_in_the_folder_we_are_in_are_not_read(before: str, tmp_path: Path) -> None:
    """Nor kept by who imported Numba first, as the code of a plugin."""
    (tmp_path / ".numba_config.yaml").write_text(SETTINGS.format(tmp_path / "kept by a stranger"))
    variables = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    command = [sys.executable, "-c", KERNELS.format(before=before)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=variables)
    assert done.returncode == 0, done.stderr
    place, *rest = done.stdout.strip().split("|")
    assert not Path(place).is_relative_to(tmp_path)
    assert rest == ["True", "None", "[]"]
    assert [path.name for path in tmp_path.iterdir()] == [".numba_config.yaml"]


def test_what_the_environment_sets_holds(tmp_path: Path) -> None:
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "own"), "NUMBA_BOUNDSCHECK": "1"}
    command = [sys.executable, "-c", KERNELS.format(before="")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=variables)
    assert done.returncode == 0, done.stderr
    place, *rest = done.stdout.strip().split("|")
    assert Path(place).parent == tmp_path / "own"
    assert rest == ["True", "1", "[]"]
