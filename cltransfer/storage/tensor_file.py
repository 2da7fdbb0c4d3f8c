"""Safetensors: written whole or not at all, and what each is looked at for before anything in it is believed."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

from torch import Tensor

from ..errors import InputError
from .files import atomic, check_size

HEADER_LIMIT = 2**20  # bytes


def check_tensor_file(path: Path, limit: int, kind: str) -> None:
    """Refuse what cannot be a ``kind`` in safetensors of at most ``limit`` bytes; nothing large is read or allocated.

    Raises:
        InputError: the file is missing, a folder, too large, or its header is longer than the file or 1 MiB.
    """
    check_size(path, limit)
    with path.open("rb") as stream:
        start = stream.read(8)
    if len(start) < 8 or struct.unpack("<Q", start)[0] > min(HEADER_LIMIT, path.stat().st_size):
        raise InputError(path, "header", f"not a {kind}")


def save_tensors(path: Path, tensors: Mapping[str, Tensor], meta: Mapping[str, str] | None = None) -> None:
    """Write ``tensors``, whole or not at all.

    Raises:
        OSError: it cannot be, which safetensors tells by an error of its own.
    """
    from safetensors import SafetensorError
    from safetensors.torch import save_file

    with atomic(path) as temporary:
        try:
            save_file(dict(tensors), temporary, metadata=None if meta is None else dict(meta))
        except SafetensorError as error:
            raise OSError(0, str(error), str(path)) from None
