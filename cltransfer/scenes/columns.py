"""Gaussians column by column, as every file format of splats is read, within the memory there is."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import torch

from ..computer.array_type import Array
from ..computer.memory import VARIABLE, free_bytes
from ..errors import InputError, ResourceError
from .splats import Splats

MAX_DROPPED = 0.01  # share of Gaussians that may be left out because they are not finite
MIN_SCALE = 1e-9  # scene units; a flat Gaussian is a very thin one
MAX_SCALE = 1e9  # scene units; beyond it the squares of the renderers overflow
MAX_MEAN = 1e9  # scene units, along an axis; so do their products beyond it
MAX_SH = 1e9  # beyond it the sums over harmonics overflow
SH0 = 0.28209479177387814  # value of the first spherical harmonic, everywhere
BYTES, BYTES_PER_TERM = 210, 24  # of a Gaussian read and packed for the kernels; the terms of its colour come on top
RESERVE = 400 * 2**20  # bytes for all that is not the scene

Columns = dict[str, Array]  # means, log_scales, quats, opacity, sh by name, all float32

_log = logging.getLogger("cltransfer")


def affordable_degree(path: Path, count: int, degree: int, stored: int = 0) -> int:
    """Degree of harmonics, at most ``degree``, with which ``count`` Gaussians fit in memory; fewer are told of.

    Args:
        path: their file, for error lines.
        count: how many there are.
        degree: of the harmonics in the file.
        stored: bytes that are read as they stand in the file before they are unpacked.

    Raises:
        ResourceError: they do not fit without any.
    """
    free = free_bytes()
    if free is None:
        return degree
    for kept in range(degree, -1, -1):
        if stored + needed_bytes(count, kept) <= free:
            break
    else:
        need = _mb(stored + needed_bytes(count, 0))
        reason = f"{count} Gaussians need {need} MB without harmonics, {_mb(free)} MB are free"
        raise ResourceError(path, "memory", reason, f"raise the limit of the system or of {VARIABLE}, or thin the file")
    if kept < degree:
        need = _mb(stored + needed_bytes(count, degree))
        _log.warning("%s: read with harmonics of degree %d of %d: all need %s MB, %s MB are free",
                     path, kept, degree, need, _mb(free))  # fmt: skip
    return kept


def needed_bytes(count: int, degree: int) -> int:
    """What reading ``count`` Gaussians and drawing them by one thread takes at its peak.

    More threads draw them only as far as there is memory for what those work in.
    """
    return RESERVE + count * (BYTES + BYTES_PER_TERM * (degree + 1) ** 2)


def _mb(size: int) -> int:
    return round(size / 2**20)


def sh_of_color(color: Array) -> Array:
    """First harmonic (N, 3) of a colour in [0, 1] that is the same from all sides, (N, 3)."""
    return (color - np.float32(0.5)) / np.float32(SH0)


def drawable(path: Path, columns: Columns) -> Splats:
    """Splats of the rows that can be drawn; how many others there are is told, and too many are an error."""
    scales = np.exp(columns["log_scales"])
    length = np.linalg.norm(columns["quats"], axis=1, keepdims=True)
    bad = {
        "x, y, z": ~(np.abs(columns["means"]) <= MAX_MEAN).all(1),
        "scale": ~(scales <= MAX_SCALE).all(1),
        "rot": ~(np.isfinite(length[:, 0]) & (length[:, 0] > 0)),
        "opacity": ~np.isfinite(columns["opacity"]),
        "f_dc, f_rest": ~(np.abs(columns["sh"]) <= MAX_SH).all((1, 2)),
    }
    keep = ~np.logical_or.reduce(list(bad.values()))
    dropped = int((~keep).sum())
    if dropped > MAX_DROPPED * len(keep):
        name, rows = next((name, rows) for name, rows in bad.items() if rows.any())
        reason = f"not finite or out of range in Gaussian {int(rows.argmax())}; {dropped} of {len(keep)} are unusable"
        raise InputError(path, f"property {name}", reason)
    if dropped:
        what = ", ".join(name for name, rows in bad.items() if rows.any())
        told = "%s: %d of %d Gaussians are left out, not finite or out of range: %s"
        _log.warning(told, path, dropped, len(keep), what)
    quats = columns["quats"] / np.where(keep[:, None], length, 1)
    arrays = {
        "means": columns["means"],
        "scales": scales.clip(min=MIN_SCALE),
        "quats": quats,
        "opacity": columns["opacity"],
        "sh": columns["sh"],
    }
    tensors = {name: torch.from_numpy(a[keep] if dropped else a) for name, a in arrays.items()}
    return Splats(**tensors, label=torch.zeros(len(keep) - dropped))
