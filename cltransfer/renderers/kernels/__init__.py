"""Inner loops in numba, without torch: numpy arrays in, numpy arrays out.

What is called from Python is a :func:`~cltransfer.computer.compiled.kernel`, whose machine code is kept; its helpers
are compiled into it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...computer import numba_settings as numba_settings  # before any of the modules here imports it
from ...computer.array_type import Array as Array

f32 = np.float32

CACHED: dict[str, Any] = {"nogil": True, "error_model": "numpy", "boundscheck": False}
"""For code that must see NaN and infinity."""
FAST: dict[str, Any] = {**CACHED, "fastmath": True}
"""For code whose inputs are known to be finite."""
INLINE: dict[str, Any] = {"error_model": "numpy", "boundscheck": False, "forceinline": True}
"""For helpers of a loop: a real call would pass every array and scalar again."""
FAST_INLINE: dict[str, Any] = {**INLINE, "fastmath": True}


class Outputs(NamedTuple):
    """Buffers of one view; what was not asked for has no rows."""

    image: Array  # (3, H, W) float32
    alpha: Array  # (H, W)
    label: Array  # (H, W)
    depth: Array  # (H, W), median, scene units
    expected_depth: Array  # (H, W), mean, scene units
