"""Gaussian splats from and to PLY: the layout of the INRIA trainer, and PlayCanvas' compressed one (read only)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.lib.recfunctions import unstructured_to_structured
from plyfile import PlyData, PlyElement, PlyParseError

from ..errors import InputError
from ..files import atomic
from ..renderers.kernels import Array
from .ply_header import Element, check_header
from .splats import SH_DEGREES, Splats

MAX_DROPPED = 0.01  # share of Gaussians that may be left out because they are not finite
MIN_SCALE = 1e-9  # scene units; a flat Gaussian is a very thin one
MAX_SCALE = 1e9  # scene units; beyond it the squares of the renderers overflow
CHUNK = 256  # Gaussians that share a range in the compressed layout
BLOCK = 2**16  # rows read at a time
SH0 = 0.28209479177387814  # value of the first spherical harmonic, everywhere
_HINT = "is it a Gaussian-splat PLY?"

POSITION, COLOR = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2")
SCALE, ROTATION = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")

Columns = dict[str, Array]  # means, log_scales, quats, opacity, sh by name, all float32


def read_splats(path: Path) -> Splats:
    """Gaussians of a binary PLY, as trained (SH degree 0-3) or compressed by PlayCanvas' tools.

    Args:
        path: a file of at most 20 million Gaussians.

    Returns:
        Splats without label; Gaussians with a value that is not finite, a rotation of length 0 or a scale beyond
        1e9 are left out and counted in ``dropped``.

    Raises:
        InputError: the file is not such a PLY, is damaged, or more than 1 % of it would be left out.
    """
    elements = check_header(path)
    _check_elements(path, elements)
    try:
        ply = PlyData.read(str(path), mmap="r")
    except (PlyParseError, ValueError, UnicodeDecodeError) as error:
        raise InputError(path, "header", f"not readable: {error}") from None
    with np.errstate(all="ignore"):  # what is not finite is counted, not warned of
        if "packed_position" in elements["vertex"].types:
            columns = _from_compressed({name: ply[name].data for name in elements})
        else:
            columns = _from_trained(ply["vertex"].data)
        return drawable(path, columns)


def write_splats(path: Path, splats: Splats) -> None:
    """Write ``splats`` in the INRIA layout, whole or not at all; labels are not part of that format."""
    sh = splats.sh.transpose(1, 2)  # (N, 3, K): the file keeps channels together
    rest = sh[:, :, 1:].reshape(len(splats), -1)
    names = (*POSITION, *COLOR, *(f"f_rest_{i}" for i in range(rest.shape[1])), "opacity", *SCALE, *ROTATION)
    tensors = (
        splats.means,
        sh[:, :, 0],
        rest,
        splats.opacity.logit()[:, None],
        splats.scales.log(),
        splats.quats,
    )
    rows = torch.cat(tensors, dim=1).detach().to("cpu", torch.float32).numpy()
    table = unstructured_to_structured(rows, np.dtype([(name, "<f4") for name in names]))
    with atomic(path) as temporary:
        PlyData([PlyElement.describe(table, "vertex")], byte_order="<").write(str(temporary))


def _check_elements(path: Path, elements: dict[str, Element]) -> None:
    """Require the columns of one of the two layouts."""
    vertex = elements.get("vertex")
    if vertex is None:
        raise InputError(path, "element vertex", "is missing", _HINT)
    if vertex.count == 0:
        raise InputError(path, "element vertex", "holds no Gaussians")
    if "packed_position" in vertex.types:
        _check_compressed(path, elements)
        return
    _require(
        path,
        vertex,
        (*POSITION, *COLOR, "opacity", *SCALE, *ROTATION),
        ("float", "float32", "double", "float64"),
    )
    rest = _rest_names(vertex.types)
    _require(path, vertex, rest, ("float", "float32", "double", "float64"))
    _check_rest(path, len(rest))


def _check_compressed(path: Path, elements: dict[str, Element]) -> None:
    vertex, chunk = elements["vertex"], elements.get("chunk")
    _require(path, vertex, PACKED, ("uint", "uint32"))
    if chunk is None:
        raise InputError(path, "element chunk", "is missing", "needed by packed_position")
    _require(path, chunk, _ranges("") + _ranges("scale_"), ("float", "float32"))
    if chunk.count != -(-vertex.count // CHUNK):
        raise InputError(path, "element chunk", f"expected {-(-vertex.count // CHUNK)} rows, got {chunk.count}")
    if "min_r" in chunk.types:
        _require(path, chunk, _ranges("", "rgb"), ("float", "float32"))
    if "sh" in elements:
        rest = _rest_names(elements["sh"].types)
        _require(path, elements["sh"], rest, ("uchar", "uint8"))
        _check_rest(path, len(rest))
        if elements["sh"].count != vertex.count:
            raise InputError(path, "element sh", f"expected {vertex.count} rows, got {elements['sh'].count}")


def _ranges(prefix: str, axes: str = "xyz") -> tuple[str, ...]:
    """Names of the least and greatest value in a chunk: min_x, ..., max_z."""
    return tuple(f"{end}_{prefix}{axis}" for end in ("min", "max") for axis in axes)


def _require(path: Path, element: Element, names: Sequence[str], types: Sequence[str]) -> None:
    for name in names:
        if name not in element.types:
            raise InputError(path, f"property {name}", "is missing", _HINT)
        if element.types[name] not in types:
            raise InputError(path, f"property {name}", f"expected type {types[0]}, got {element.types[name]}")


def _rest_names(names: Iterable[str]) -> list[str]:
    """f_rest_0, f_rest_1, ... as many as there are."""
    return [f"f_rest_{i}" for i in range(sum(name.startswith("f_rest_") for name in names))]


def _check_rest(path: Path, count: int) -> None:
    if count % 3 or count // 3 + 1 not in SH_DEGREES:
        raise InputError(path, "property f_rest", f"expected 0, 9, 24 or 45 coefficients, got {count}")


def _stack(table: Array, names: Sequence[str]) -> Array:
    """Columns side by side, (N, len(names)) float32; in blocks, so that each row is fetched once."""
    out = np.empty((len(table), len(names)), np.float32)
    for start in range(0, len(table), BLOCK):
        rows = slice(start, start + BLOCK)
        for column, name in enumerate(names):
            out[rows, column] = table[rows][name]
    return out


def _harmonic_names(table: Array) -> list[str]:
    """f_rest columns in the order coefficient, channel; files keep each channel together."""
    count = len(_rest_names(table.dtype.names or ())) // 3
    return [f"f_rest_{channel * count + k}" for k in range(count) for channel in range(3)]


def _from_trained(table: Array) -> Columns:
    """Values of the INRIA layout: opacity is a logit, scales are logarithms."""
    return {
        "means": _stack(table, POSITION),
        "log_scales": _stack(table, SCALE),
        "quats": _stack(table, ROTATION),
        "opacity": 1 / (1 + np.exp(-_stack(table, ["opacity"])[:, 0])),
        "sh": _stack(table, [*COLOR, *_harmonic_names(table)]).reshape(len(table), -1, 3),
    }


def _unorm(words: Array, shift: int, bits: int) -> Array:
    """``bits`` bits of unsigned words as a number in [0, 1], float32."""
    return ((words >> shift) & (2**bits - 1)).astype(np.float32) / np.float32(2**bits - 1)


def _from_compressed(tables: dict[str, Array]) -> Columns:
    """Values of the PlayCanvas layout: 11-10-11 bits between the ends of a chunk, smallest-three rotations."""
    vertex, chunk = tables["vertex"], tables["chunk"]
    which = np.arange(len(vertex)) // CHUNK

    def between(part: Array, prefix: str, axes: str = "xyz") -> Array:
        ends = _stack(chunk, _ranges(prefix, axes))[which]
        return ends[:, :3] * (1 - part) + ends[:, 3:] * part

    def triple(words: Array) -> Array:
        return np.stack([_unorm(words, 21, 11), _unorm(words, 11, 10), _unorm(words, 0, 11)], axis=1)

    color = np.stack([_unorm(vertex["packed_color"], shift, 8) for shift in (24, 16, 8)], axis=1)
    if "min_r" in (chunk.dtype.names or ()):
        color = between(color, "", "rgb")
    sh = sh_of_color(color)
    if "sh" in tables:
        rest = _stack(tables["sh"], _harmonic_names(tables["sh"])) * np.float32(8 / 255) - 4
        sh = np.concatenate([sh, rest], axis=1)
    return {
        "means": between(triple(vertex["packed_position"]), ""),
        "log_scales": between(triple(vertex["packed_scale"]), "scale_"),
        "quats": _smallest_three(vertex["packed_rotation"]),
        "opacity": _unorm(vertex["packed_color"], 0, 8),
        "sh": sh.reshape(len(vertex), -1, 3),
    }


def _smallest_three(words: Array) -> Array:
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


def sh_of_color(color: Array) -> Array:
    """First harmonic (N, 3) of a colour in [0, 1] that is the same from all sides, (N, 3)."""
    return (color - np.float32(0.5)) / np.float32(SH0)


def drawable(path: Path, columns: Columns) -> Splats:
    """Splats of the rows that can be drawn; too many others are an error."""
    scales = np.exp(columns["log_scales"])
    length = np.linalg.norm(columns["quats"], axis=1, keepdims=True)
    bad = {
        "x, y, z": ~np.isfinite(columns["means"]).all(1),
        "scale": ~(scales <= MAX_SCALE).all(1),
        "rot": ~(np.isfinite(length[:, 0]) & (length[:, 0] > 0)),
        "opacity": ~np.isfinite(columns["opacity"]),
        "f_dc, f_rest": ~np.isfinite(columns["sh"]).all((1, 2)),
    }
    keep = ~np.logical_or.reduce(list(bad.values()))
    dropped = int((~keep).sum())
    if dropped > MAX_DROPPED * len(keep):
        name, rows = next((name, rows) for name, rows in bad.items() if rows.any())
        reason = f"not finite or out of range in Gaussian {int(rows.argmax())}; {dropped} of {len(keep)} are unusable"
        raise InputError(path, f"property {name}", reason)
    quats = columns["quats"] / np.where(keep[:, None], length, 1)
    arrays = {
        "means": columns["means"],
        "scales": scales.clip(min=MIN_SCALE),
        "quats": quats,
        "opacity": columns["opacity"],
        "sh": columns["sh"],
    }
    tensors = {name: torch.from_numpy(a[keep] if dropped else a) for name, a in arrays.items()}
    return Splats(**tensors, label=torch.zeros(len(keep) - dropped), dropped=dropped)
