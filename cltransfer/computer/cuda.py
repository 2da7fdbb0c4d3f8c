"""What the CUDA paths need, and where their tensors go."""

from __future__ import annotations

import contextlib
import importlib.util
import sys
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from ..errors import ModelError

T = TypeVar("T")

_MOVED: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()  # geometry -> its copy on the CUDA device


def require_cuda(what: str, otherwise: str) -> None:
    """Whether ``what`` finds a CUDA device; ``otherwise`` is the hint.

    Raises:
        ModelError: there is none.
    """
    if not torch.cuda.is_available():
        raise ModelError("", what, "there is no CUDA device", otherwise)


def require_gsplat(what: str, otherwise: str) -> None:
    """Whether ``what`` finds gsplat, a CUDA device and gsplat's kernels; ``otherwise`` is the hint.

    Raises:
        ModelError: the line says which of them is missing.
    """
    if importlib.util.find_spec("gsplat") is None:
        raise ModelError("", what, "gsplat is not installed", f'pip install "cltransfer[cuda]", or {otherwise}')
    require_cuda(what, otherwise)
    hint = f"its kernels are compiled by the CUDA toolkit {torch.version.cuda}; install that, or {otherwise}"
    try:
        with contextlib.redirect_stdout(sys.stderr):  # it tells its progress, and stdout is for results
            from gsplat.cuda._backend import _C  # compiled on the first import, None where there is no nvcc
    except (ImportError, RuntimeError, OSError) as error:
        raise ModelError("", what, f"gsplat was not compiled: {str(error).strip().splitlines()[0]}", hint) from None
    if _C is None:
        raise ModelError("", what, "gsplat was not compiled: there is no nvcc", hint)


def moved(value: T, device: str) -> T:
    """A dataclass with every tensor in its fields, and in tuples there, on ``device``; itself where they are."""

    def there(part: Any) -> Any:
        if isinstance(part, Tensor):
            return part.to(device)
        return tuple(there(p) for p in part) if isinstance(part, tuple) else part

    if not is_dataclass(value) or isinstance(value, type):
        raise TypeError(f"expected a dataclass value, got {type(value).__name__}")
    return replace(value, **{f.name: there(getattr(value, f.name)) for f in fields(value)})


def on_device(geometry: T, device: str) -> T:
    """``geometry`` on ``device``; the copy on a CUDA device is made once and lives as long as the geometry."""
    if device == "cpu":
        return geometry
    if geometry not in _MOVED:
        _MOVED[geometry] = moved(geometry, device)
    copy: T = _MOVED[geometry]
    return copy
