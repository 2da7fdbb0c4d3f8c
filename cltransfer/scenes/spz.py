"""``.spz`` files of Niantic, versions 2 and 3: a gzip stream of one header and one array for each property.

They are stored with y up and z backward, and read with y down and z forward as in the PLY files of trainers.
"""

from __future__ import annotations

import shlex
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..computer.array_type import Array
from ..errors import InputError
from ..storage.files import check_size
from .columns import Columns, affordable_degree, drawable
from .splats import Splats

MAGIC = 0x5053474E
HEADER = struct.Struct("<IIIBBBB")
COUNT_LIMIT = 20_000_000
BYTE_LIMIT = 4 * 2**30
PIECE = 2**18  # bytes that are read, or unpacked, at a time
EXTENDED = 2  # flag: something stands between header and arrays
COLOR_SCALE = 0.15  # of the first harmonic in 8 bits
TURN = np.array([1, -1, -1], np.float32)  # half a turn about x, of x, y, z
TURN_SH = np.array([-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)  # of harmonics 1 to 15


@dataclass(frozen=True)
class Header:
    """What stands before the arrays."""

    version: int
    count: int
    degree: int
    fraction: int  # bits of a coordinate behind the point

    @property
    def arrays(self) -> dict[str, int]:
        """Bytes a Gaussian, in the file's order."""
        rest = 3 * ((self.degree + 1) ** 2 - 1)
        return {"means": 9, "opacity": 1, "color": 3, "scales": 3, "quats": 4 if self.version == 3 else 3, "rest": rest}


def read_spz(path: Path) -> Splats:
    """Gaussians of an ``.spz`` file.

    Raises:
        InputError: the file is missing, damaged, of another version, or holds more or less than its header says.
        ResourceError: it does not fit in memory even without harmonics.
    """
    check_size(path, BYTE_LIMIT)
    stream = zlib.decompressobj(wbits=31)
    with path.open("rb") as packed:
        header = _header(path, _inflated(path, stream, packed, HEADER.size))
        size = header.count * sum(header.arrays.values())
        degree = affordable_degree(path, header.count, header.degree, size)
        body = _inflated(path, stream, packed, size + 1)  # one more byte would be one too many
    if len(body) != size:
        found = f"more than {size}" if len(body) > size else str(len(body))
        raise InputError(path, "body", f"expected {size} bytes, got {found}")
    return drawable(path, _columns(header, body, (degree + 1) ** 2))


def _inflated(path: Path, stream: zlib._Decompress, packed: BinaryIO, most: int) -> bytearray:
    """What comes next, at most ``most`` bytes, unpacked piece by piece into its place."""
    data, end = bytearray(most), 0
    while end < most and not stream.eof:
        some = stream.unconsumed_tail or packed.read(PIECE)
        try:
            piece = stream.decompress(some, min(PIECE, most - end))
        except zlib.error as error:
            raise InputError(path, "", f"not readable as gzip: {error}", _hint(path)) from None
        if not some and not piece:
            break  # cut off
        data[end : end + len(piece)] = piece
        end += len(piece)
    del data[end:]
    return data


def _header(path: Path, data: bytearray) -> Header:
    if len(data) < HEADER.size:
        raise InputError(path, "header", "cut off")
    magic, version, count, degree, fraction, flags, _ = HEADER.unpack(data)
    if magic != MAGIC:
        raise InputError(path, "magic", f"expected {MAGIC:#x}, got {magic:#x}")
    if version not in (2, 3) or flags & EXTENDED:
        what = "extensions are" if version in (2, 3) else f"version {version} is"
        raise InputError(path, "header", f"{what} not read", _hint(path))
    if not 1 <= count <= COUNT_LIMIT:
        raise InputError(path, "header", f"expected 1 to {COUNT_LIMIT} Gaussians, got {count}")
    if degree > 3 or fraction > 23:
        raise InputError(path, "header", f"expected degree 0 to 3 and at most 23 bits, got {degree} and {fraction}")
    return Header(version, count, degree, fraction)


def _hint(path: Path) -> str:
    return f"convert it: {shlex.join(['splat-transform', path.name, f'{path.stem}.ply'])}"


def _columns(header: Header, body: bytearray, terms: int) -> Columns:
    """Values of the arrays, with ``terms`` harmonics a channel."""
    parts, at = {}, 0
    for name, width in header.arrays.items():
        parts[name] = np.frombuffer(body, np.uint8, header.count * width, at).reshape(header.count, width)
        at += header.count * width
    sh = np.empty((header.count, terms, 3), np.float32)
    sh[:, 0] = (parts["color"] / np.float32(255) - np.float32(0.5)) / np.float32(COLOR_SCALE)
    sh[:, 1:] = parts["rest"].reshape(header.count, -1, 3)[:, : terms - 1]
    sh[:, 1:] -= 128  # in place: they are the most of a Gaussian
    sh[:, 1:] *= TURN_SH[: terms - 1, None] / 128
    quats = _smallest_three(parts["quats"]) if header.version == 3 else _first_three(parts["quats"])
    quats[:, 1:] *= TURN
    return {
        "means": _fixed(parts["means"]) * np.float32(2.0**-header.fraction) * TURN,
        "log_scales": parts["scales"].astype(np.float32) / 16 - 10,
        "quats": quats,
        "opacity": parts["opacity"][:, 0] / np.float32(255),
        "sh": sh,
    }


def _fixed(bytes_: Array) -> Array:
    """Signed 24-bit numbers, little-endian, (N, 9) uint8 as (N, 3) float32."""
    low, middle, high = bytes_.reshape(-1, 3, 3).astype(np.int32).transpose(2, 0, 1)
    return ((low | middle << 8 | high << 16) - ((high & 0x80) << 17)).astype(np.float32)


def _first_three(bytes_: Array) -> Array:
    """Quaternions (N, 4) w, x, y, z of x, y, z in 8 bits; w is not negative."""
    small = bytes_.astype(np.float32) / np.float32(127.5) - 1
    return np.concatenate([np.sqrt((1 - (small**2).sum(1, keepdims=True)).clip(0)), small], axis=1)


def _smallest_three(bytes_: Array) -> Array:
    """Quaternions (N, 4) w, x, y, z: two bits name the largest of x, y, z, w; sign and nine bits are each other."""
    words = np.ascontiguousarray(bytes_).view("<u4")[:, 0]
    largest = words >> 30
    xyzw = np.zeros((len(words), 4), np.float32)
    for index in range(3, -1, -1):
        given = largest != index
        value = (words & 511).astype(np.float32) * np.float32(np.sqrt(0.5) / 511)
        xyzw[:, index] = np.where(given, np.where(words & 512, -value, value), 0)
        words = np.where(given, words >> 10, words)
    rest = np.sqrt((1 - (xyzw**2).sum(1)).clip(0))
    xyzw[np.arange(len(words)), largest] = rest
    return xyzw[:, [3, 0, 1, 2]]
