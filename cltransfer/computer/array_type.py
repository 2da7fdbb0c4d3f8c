"""Numpy arrays of any numbers, in signatures. No torch."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

Array = npt.NDArray[Any]
