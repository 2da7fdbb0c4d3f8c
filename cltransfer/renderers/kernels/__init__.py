"""Inner loops in numba, without torch: numpy arrays in, numpy arrays out.

Numba keys its cache by the file of a function and does not look at what it calls. So a kernel calls only
kernels of its own file, and the Python function above them joins the files. After changing a constant that
other files import, delete their ``__pycache__``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
f32 = np.float32

CACHED: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "boundscheck": False}
"""For code that must see NaN and infinity."""
FAST: dict[str, Any] = {**CACHED, "fastmath": True}
"""For code whose inputs are known to be finite."""
INLINE: dict[str, Any] = {"error_model": "numpy", "boundscheck": False, "forceinline": True}
"""For helpers of a loop: a real call would pass every array and scalar again."""
FAST_INLINE: dict[str, Any] = {**INLINE, "fastmath": True}
