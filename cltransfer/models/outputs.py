"""What an ONNX network gives, against what it is to give."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ModelError

Shape = tuple[int | None, ...]
"""Expected sizes, batch first; None is any."""


def joined(path: Path, name: str, parts: Sequence[np.ndarray]) -> np.ndarray:
    """The output ``name`` (B, ...) of a batch that ran in ``parts``.

    Raises:
        ModelError: it has no rows, or rows of several shapes.
    """
    shapes = {part.shape[1:] for part in parts}
    if any(part.ndim == 0 for part in parts):
        raise ModelError(path, f"output {name}", "expected a row for each input, got a single value")
    if len(shapes) > 1:
        raise ModelError(path, f"output {name}", f"expected rows of one shape, got {sorted(shapes)}")
    return np.concatenate(parts)


def differs(wanted: Shape | None, given: Any) -> bool:
    """Whether ``given`` (whole numbers, or names and None for any) cannot be ``wanted``."""
    if wanted is None:
        return False
    pairs = zip(wanted, given)
    return len(wanted) != len(given) or any(w is not None and isinstance(g, int) and w != g for w, g in pairs)
