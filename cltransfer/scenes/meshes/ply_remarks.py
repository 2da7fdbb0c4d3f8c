"""Remarks in the header of a PLY mesh, which name a texture or a person in any letters: plyfile takes ASCII alone."""

from __future__ import annotations

import io
from pathlib import Path

from ..ply_header import FORMAT, REMARKS, header_of

_ASCII = bytes(byte if byte < 128 else ord("?") for byte in range(256))
_FIRST = f"ply\nformat {FORMAT}\n".encode()


class AsciiHeader(io.BufferedReader):
    """A file whose first ``size`` bytes are read as ASCII, one character a byte: what follows may still be mapped."""

    def __init__(self, path: Path, size: int) -> None:
        super().__init__(io.FileIO(path))
        self._size = size

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any file, with ``?`` for each byte of the header that is no ASCII."""
        within = max(0, self._size - self.tell())
        data = super().read(size)
        return data[:within].translate(_ASCII) + data[within:] if within else data


def in_utf8(data: bytes) -> bytes:
    """The file with a header that trimesh reads: one that is no UTF-8 is taken for Latin-1, of older programs."""
    header = header_of(data)
    try:
        header.decode()
    except UnicodeDecodeError:
        return header.decode("latin-1").encode() + data[len(header) :]
    return data


def with_remarks(written: memoryview, header: bytes) -> bytes:
    """A little-endian PLY that was ``written`` without remarks, with those of ``header``."""
    lines = in_utf8(header).splitlines()
    remarks = [line + b"\n" for line in lines if line.split()[:1] in REMARKS]
    return b"".join([written[: len(_FIRST)], *remarks, written[len(_FIRST) :]])
