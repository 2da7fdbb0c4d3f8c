"""PlayCanvas' compressed layout of splats in a PLY: ranges of 256 Gaussians, and 32-bit words between their ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..computer.array_type import Array
from .columns import Columns, sh_of_color

CHUNK = 256  # Gaussians that share a range
PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")


def ranges(prefix: str, axes: str = "xyz") -> tuple[str, ...]:
    """Names of the least and greatest value in a chunk: min_x, ..., max_z."""
    return tuple(f"{end}_{prefix}{axis}" for end in ("min", "max") for axis in axes)


def _stack(table: Array, names: Sequence[str]) -> Array:
    """Columns side by side, (N, len(names)) float32."""
    return np.stack([table[name].astype(np.float32) for name in names], axis=1)


def _unorm(words: Array, shift: int, bits: int) -> Array:
    """``bits`` bits of unsigned words as a number in [0, 1], float32."""
    return ((words >> shift) & (2**bits - 1)).astype(np.float32) / np.float32(2**bits - 1)


def from_compressed(tables: Mapping[str, Array], harmonics: Sequence[str]) -> Columns:
    """Values of tables vertex, chunk and perhaps sh, of which the columns ``harmonics`` are taken.

    Positions, scales and, in newer files, colours are 11-10-11 bits between the ends of a chunk.
    """
    vertex, chunk = tables["vertex"], tables["chunk"]
    which = np.arange(len(vertex)) // CHUNK

    def between(part: Array, prefix: str, axes: str = "xyz") -> Array:
        ends = _stack(chunk, ranges(prefix, axes))[which]
        return ends[:, :3] * (1 - part) + ends[:, 3:] * part

    def triple(words: Array) -> Array:
        return np.stack([_unorm(words, 21, 11), _unorm(words, 11, 10), _unorm(words, 0, 11)], axis=1)

    color = np.stack([_unorm(vertex["packed_color"], shift, 8) for shift in (24, 16, 8)], axis=1)
    if "min_r" in (chunk.dtype.names or ()):
        color = between(color, "", "rgb")
    sh = sh_of_color(color)
    if harmonics:
        rest = _stack(tables["sh"], harmonics) * np.float32(8 / 255) - 4
        sh = np.concatenate([sh, rest], axis=1)
    return {
        "means": between(triple(vertex["packed_position"]), ""),
        "log_scales": between(triple(vertex["packed_scale"]), "scale_"),
        "quats": smallest_three(vertex["packed_rotation"]),
        "opacity": _unorm(vertex["packed_color"], 0, 8),
        "sh": sh.reshape(len(vertex), -1, 3),
    }


def smallest_three(words: Array) -> Array:
    """Quaternions (N, 4) w, x, y, z: two bits say which is largest, ten bits each give the others in turn."""
    small = np.stack([_unorm(words, shift, 10) for shift in (20, 10, 0)], axis=1)
    small = (2 * small - 1) * np.float32(np.sqrt(0.5))
    largest = np.sqrt((1 - (small**2).sum(1)).clip(0))
    quats = np.empty((len(words), 4), np.float32)
    index = words >> 30
    for k in range(4):
        of_k = index == k
        quats[of_k] = np.insert(small[of_k], k, largest[of_k], axis=1)
    return quats
