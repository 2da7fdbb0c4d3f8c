"""Gaussian splats from and to PLY: the layout of the INRIA trainer, and PlayCanvas' compressed one (read only)."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.lib.recfunctions import unstructured_to_structured
from plyfile import PlyData, PlyElement

from ..computer.array_type import Array
from ..errors import InputError
from ..storage.files import atomic
from .columns import MIN_SCALE, Columns, affordable_degree, drawable
from .ply_compressed import CHUNK, PACKED, from_compressed, ranges
from .ply_header import BLOCK, VERTICAL, Element, check_header, read_columns, read_rows
from .splats import SH_DEGREES, Splats

_HINT = "is it a Gaussian-splat PLY?"
_log = logging.getLogger("cltransfer")

POSITION, COLOR = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2")
FILTER = "filter_3D"  # of Mip-Splatting, a standard deviation [scene units] by which each Gaussian is drawn wider
SCALE, ROTATION = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
BEYOND = 72  # f_rest of degree 4, which is beyond what is drawn


def read_splats(path: Path) -> Splats:
    """Gaussians of a binary PLY, as trained (SH degree 0-3; of 4 the first 3) or compressed by PlayCanvas' tools.

    Those of 2DGS, which have two scales, are flat.

    Args:
        path: a file of at most 20 million Gaussians.

    Returns:
        Splats without label; Gaussians with a value that is not finite, a rotation of length 0, or a scale or a place
        beyond 1e9 are left out. Lines of the log say how many, and where memory is short and fewer harmonics are read.

    Raises:
        InputError: the file is not such a PLY, is damaged, or more than 1 % of it would be left out.
        ResourceError: it does not fit in memory even without harmonics.
    """
    elements = check_header(path, splats=True)
    _check_elements(path, elements)
    vertex = elements["vertex"]
    compressed = "packed_position" in vertex.types
    holder = elements.get("sh") if compressed else vertex
    rest = _rest_names(() if holder is None else holder.types)
    stored = sum(_size(elements[name], names) for name, names in _packed(elements, rest).items()) if compressed else 0
    degree = affordable_degree(path, vertex.count, _degree(path, len(rest)), stored)
    with np.errstate(all="ignore"):  # what is not finite is counted, not warned of
        if compressed:
            harmonics = _harmonic_names(len(rest), degree)
            wanted = _packed(elements, harmonics)
            tables = {name: read_columns(path, elements, name, names) for name, names in wanted.items()}
            columns = from_compressed(tables, harmonics)
        else:
            columns = _from_trained(path, elements, (*COLOR, *_harmonic_names(len(rest), degree)))
        return drawable(path, columns)


def write_splats(path: Path, splats: Splats, z_up: bool = False) -> None:
    """Write ``splats`` in the INRIA layout, whole or not at all; labels are not part of that format.

    Args:
        path: .ply.
        splats: N Gaussians.
        z_up: whether the header is to tell that z is up, for who reads it.
    """
    remarks = [f"{VERTICAL} z"] if z_up else []
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
        PlyData([PlyElement.describe(table, "vertex")], byte_order="<", comments=remarks).write(str(temporary))


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
    rest = _rest_names(vertex.types)
    filters = (FILTER,) if FILTER in vertex.types else ()
    names = (*POSITION, *COLOR, "opacity", *_scales(vertex), *ROTATION, *rest, *filters)
    _require(path, vertex, names, ("float", "float32", "double", "float64"))
    _check_rest(path, len(rest))


def _check_compressed(path: Path, elements: dict[str, Element]) -> None:
    vertex, chunk = elements["vertex"], elements.get("chunk")
    _require(path, vertex, PACKED, ("uint", "uint32"))
    if chunk is None:
        raise InputError(path, "element chunk", "is missing", "needed by packed_position")
    _require(path, chunk, ranges("") + ranges("scale_"), ("float", "float32"))
    if chunk.count != -(-vertex.count // CHUNK):
        raise InputError(path, "element chunk", f"expected {-(-vertex.count // CHUNK)} rows, got {chunk.count}")
    if "min_r" in chunk.types:
        _require(path, chunk, ranges("", "rgb"), ("float", "float32"))
    if "sh" in elements:
        rest = _rest_names(elements["sh"].types)
        _require(path, elements["sh"], rest, ("uchar", "uint8"))
        _check_rest(path, len(rest))
        if elements["sh"].count != vertex.count:
            raise InputError(path, "element sh", f"expected {vertex.count} rows, got {elements['sh'].count}")


def _packed(elements: dict[str, Element], harmonics: Sequence[str]) -> dict[str, Sequence[str]]:
    """Columns of the compressed layout by element; a file may hold others."""
    colors = ranges("", "rgb") if "min_r" in elements["chunk"].types else ()
    wanted: dict[str, Sequence[str]] = {"vertex": PACKED, "chunk": ranges("") + ranges("scale_") + colors}
    return {**wanted, "sh": harmonics} if harmonics else wanted


def _size(element: Element, columns: Sequence[str]) -> int:
    """Bytes of some columns."""
    return element.count * sum(element.dtype[column].itemsize for column in columns)


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
    if count != BEYOND and (count % 3 or count // 3 + 1 not in SH_DEGREES):
        raise InputError(path, "property f_rest", f"expected 0, 9, 24, 45 or {BEYOND} coefficients, got {count}")


def _degree(path: Path, count: int) -> int:
    """Of the harmonics that are read of ``count`` f_rest; that the last ones of degree 4 are not is told."""
    if count == BEYOND:
        _log.warning("%s: harmonics of degree 4 are left out, those of degree 0 to 3 are read", path)
        return max(SH_DEGREES.values())
    return SH_DEGREES[count // 3 + 1]


def _scales(vertex: Element) -> Sequence[str]:
    """Columns of scales: the third is not there where Gaussians are flat."""
    return SCALE[:2] if {*SCALE} - vertex.types.keys() == {SCALE[2]} else SCALE


def _harmonic_names(count: int, degree: int) -> list[str]:
    """f_rest columns of harmonics up to ``degree`` in the order coefficient, channel; files keep each channel together.

    >>> _harmonic_names(24, 1)[:4]
    ['f_rest_0', 'f_rest_8', 'f_rest_16', 'f_rest_1']
    """
    return [f"f_rest_{channel * count // 3 + k}" for k in range((degree + 1) ** 2 - 1) for channel in range(3)]


def _filter(columns: Columns, width: Array) -> None:
    """Gaussians as they were trained, under the 3D filter of Mip-Splatting (Yu et al., CVPR 2024), ``width`` (N,) wide.

    They are wider, and by as much thinner as their volume has grown.
    """
    for first in range(0, len(width), BLOCK):
        rows = slice(first, first + BLOCK)
        square = np.exp(2 * columns["log_scales"][rows].astype(np.float64))
        wider = square + width[rows, None].astype(np.float64) ** 2
        columns["log_scales"][rows] = 0.5 * np.log(wider)
        columns["opacity"][rows] *= np.sqrt((square / wider).prod(1))


def _from_trained(path: Path, elements: dict[str, Element], harmonics: Sequence[str]) -> Columns:
    """Values of the INRIA layout, read block by block: opacity is a logit, scales are logarithms."""
    vertex = elements["vertex"]
    scales = _scales(vertex)
    wanted = {"means": POSITION, "log_scales": scales, "quats": ROTATION, "opacity": ("opacity",), "sh": harmonics}
    columns: Columns = {
        name: np.empty((vertex.count, len(properties)), np.float32) for name, properties in wanted.items()
    }
    for first in range(0, vertex.count, BLOCK):
        rows = read_rows(path, elements, "vertex", first, BLOCK)
        for name, properties in wanted.items():
            for k, one in enumerate(properties):
                columns[name][first : first + BLOCK, k] = rows[one]
    columns["opacity"] = 1 / (1 + np.exp(-columns["opacity"][:, 0]))
    if FILTER in vertex.types:
        _filter(columns, read_columns(path, elements, "vertex", (FILTER,))[FILTER])
    if scales != SCALE:
        flat = np.full(vertex.count, math.log(MIN_SCALE), np.float32)
        columns["log_scales"] = np.column_stack([columns["log_scales"], flat])
    columns["sh"] = columns["sh"].reshape(vertex.count, -1, 3)
    return columns
