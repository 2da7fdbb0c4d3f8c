from __future__ import annotations

import os
import subprocess
import sys

FAR = """
import numpy as np
from cltransfer.renderers.kernels import f32
from cltransfer.renderers.kernels.grid_learn import Field, look

density, sh = np.full((9, 9, 9), 1e-3, np.float32), np.zeros((9, 9, 9, 3), np.float32)
field = Field(density, sh, np.ones((8, 8, 8), bool), np.zeros((1, 1, 1), np.uint8), (f32(1),) * 3, f32(0.1), f32(0.5))
rays = np.array([[-8.4537496e7, 8.5537152e7, -8.5220560e7, 0.845375, -0.8553715, 0.85220563]], np.float32)
colors = np.zeros((1, 3), np.float32)
look(field, rays, colors)
assert 0 < colors[0, 0] < 0.1, colors
"""


def test_a_ray_from_so_far_that_its_span_rounds_up_stays_within_its_log() -> None:
    """Not compiled, where a write beyond the end is an error."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", FAR], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
