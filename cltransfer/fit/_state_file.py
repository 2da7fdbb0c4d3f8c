"""Nested training state as safetensors: tensors as tensors, all else as JSON in the header. No pickle, no code."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from torch import Tensor

from ..errors import InputError
from ..storage.tensor_file import check_tensor_file, save_tensors

FORMAT = "cltransfer.state.1"
LIMIT = 16 * 2**30  # bytes


def write_state(path: Path, state: Any) -> None:
    """Write dicts, lists, tuples, tensors, strings, numbers, booleans and None, whole or not at all.

    Raises:
        TypeError: something else is in it.
        OSError: it cannot be written.
    """
    tensors: dict[str, Tensor] = {}
    tree = _fold(state, tensors)
    meta = {"format": FORMAT, "tree": json.dumps(tree, allow_nan=False)}
    save_tensors(path, tensors, meta)


def read_state(path: Path) -> Any:
    """What :func:`write_state` wrote.

    Raises:
        InputError: the file is missing, too large, of another format, or its parts do not fit together.
    """
    from safetensors import SafetensorError, safe_open

    check_tensor_file(path, LIMIT, "training state")
    try:
        with safe_open(path, framework="pt") as stream:
            meta: dict[str, str] = stream.metadata() or {}
            if meta.get("format") != FORMAT:
                raise InputError(path, "format", f"expected {FORMAT!r}, got {meta.get('format')!r}")
            tensors = {key: stream.get_tensor(key).clone() for key in stream.keys()}  # noqa: SIM118
        return _unfold(json.loads(meta["tree"]), tensors)
    except (SafetensorError, KeyError, ValueError, TypeError, RecursionError) as error:
        raise InputError(path, "", f"not a training state: {error}") from None


def _fold(value: Any, tensors: dict[str, Tensor]) -> Any:
    """JSON of ``value``; what JSON has no word for becomes [kind, content]."""
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else ["float", str(value)]
    if isinstance(value, Tensor):
        name = str(len(tensors))
        tensors[name] = value.detach().cpu().contiguous().clone()
        return ["tensor", name]
    if isinstance(value, dict):
        return ["dict", [[_fold(key, tensors), _fold(content, tensors)] for key, content in value.items()]]
    if type(value) in (list, tuple):
        return [type(value).__name__, [_fold(content, tensors) for content in value]]
    raise TypeError(f"training state must hold plain values and tensors, got {type(value).__name__}")


def _unfold(tree: Any, tensors: dict[str, Tensor]) -> Any:
    if not isinstance(tree, list):
        return tree
    kind, content = tree
    if kind == "float":
        return float(content)
    if kind == "tensor":
        return tensors[content]
    if kind == "dict":
        return {_unfold(key, tensors): _unfold(value, tensors) for key, value in content}
    if kind in ("list", "tuple"):
        values = [_unfold(value, tensors) for value in content]
        return values if kind == "list" else tuple(values)
    raise ValueError(f"unknown kind {kind!r}")
