"""Scenes that lie so far from their origin, as scans in map coordinates do, that float32 tears them to steps."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from ..errors import InputError

SOME = 100_000  # places that tell where a scene is and how large
COARSE = 1e-3  # of the distance of half of them from their middle: half a centimetre of a room
UNKNOWN = 1.0  # that distance, scene units, where float32 may have put all of them on one point


def check_steps(path: Path, places: Tensor) -> None:
    """Refuse a scene whose places float32 does not tell apart.

    Args:
        path: the file, for the error line.
        places: where its primitives are, of a mesh the corners of its faces, (N, 3), N at least 1, scene units.

    Raises:
        InputError: it lies too far from its origin for its size.
    """
    some = places[:: max(1, len(places) // SOME)]
    middle = some.median(0).values
    away = (some - middle).abs().amax(1)
    away = away[away > 0]
    reach = float(away.median()) if len(away) else UNKNOWN
    farthest = float(middle.abs().max())
    step = farthest * torch.finfo(torch.float32).eps
    if len(some) > 1 and step > COARSE * reach:
        size = f"a scene of {2 * reach:.2g}" if len(away) else f"{len(places)} places on one point"
        reason = f"lies {farthest:.3g} units from its origin, where float32 goes by steps of {step:.2g}"
        raise InputError(path, "", f"{reason}, too coarse for {size}", "move it to its origin")
