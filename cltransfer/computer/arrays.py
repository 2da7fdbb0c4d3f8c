"""Tensors as the arrays that kernels take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

if TYPE_CHECKING:
    from numpy.typing import NDArray


def plain(value: Tensor) -> NDArray[Any]:
    """``value`` without its gradient, on the CPU; half precision, which numba does not know, as float32."""
    value = value.detach().cpu()
    return (value.float() if value.dtype in (torch.float16, torch.bfloat16) else value).numpy()
