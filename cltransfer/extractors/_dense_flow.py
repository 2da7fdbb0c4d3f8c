"""What the classical flows share: pairs of grey frames at a working height, and the check there and back."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..computer.threads import thread_count
from ..features import Features
from ._flow_check import round_trip_confidence
from ._pixels import to_uint8

SMALLEST = 24  # side below which a search has no room [px]
PairFlow = Callable[[NDArray, NDArray], NDArray]  # grey (h, w) uint8 twice -> (h, w, 2) [px], from the first on


def with_flow(now: Features, before: Features | None, pair_flow: PairFlow, height: int, check: bool) -> Features:
    """``now`` with ``flow``, and with ``flow_confidence`` where ``check``; NaN without a frame before.

    Args:
        now: B frames with their image.
        before: the frame before each, or one that all share.
        pair_flow: the method; as many pairs at once as there are threads, since it does not fill them by itself.
        height: rows it works at [px]; a frame with fewer keeps its own.
        check: compute the flow the other way round too, and compare.
    """
    image = now.require("image")
    count, _, rows, columns = image.shape
    flow = torch.full((count, 2, rows, columns), torch.nan)
    confidence = torch.full((count, rows, columns), torch.nan)
    if before is not None:
        then = before.require("image").expand(count, -1, -1, -1)

        def look(new: NDArray, old: NDArray) -> tuple[Tensor, Tensor | None]:
            backward = _planes(pair_flow(new, old))
            scale = torch.tensor([now.size[0] / new.shape[1], now.size[1] / new.shape[0]])[:, None, None]
            seen = _resized(backward * scale, rows, columns)
            if not check:
                return seen, None
            trust = round_trip_confidence(backward[None], _planes(pair_flow(old, new))[None])
            return seen, _resized(trust, rows, columns)[0]

        with ThreadPoolExecutor(max(1, min(thread_count(), count))) as pool:
            for i, (seen, trust) in enumerate(pool.map(look, _grey(image, height), _grey(then, height))):
                flow[i] = seen  # here: another thread is in no inference mode
                if trust is not None:
                    confidence[i] = trust
    found = replace(now, flow=flow.to(image.device))
    return replace(found, flow_confidence=confidence.to(image.device)) if check else found


def check_height(height: int) -> None:
    """Refuse a working height without room for a search."""
    if height < SMALLEST:
        raise ValueError(f"height must be at least {SMALLEST}, got {height}")


def _grey(image: Tensor, height: int) -> list[NDArray]:
    """Frames (B, 3, H, W) as grey uint8 of ``height`` rows, the shape kept."""
    rows, columns = image.shape[2:]
    small = min(rows, height)
    size = (max(SMALLEST, round(columns * small / rows)), max(SMALLEST, small))
    grey = (cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in to_uint8(image))
    return [cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in grey]


def _planes(flow: NDArray) -> Tensor:
    """(h, w, 2) as (2, h, w)."""
    return torch.from_numpy(np.ascontiguousarray(flow.transpose(2, 0, 1)))


def _resized(planes: Tensor, rows: int, columns: int) -> Tensor:
    """Planes (P, h, w) on another grid, linearly."""
    wanted = [cv2.resize(plane.numpy(), (columns, rows), interpolation=cv2.INTER_LINEAR) for plane in planes]
    return torch.from_numpy(np.stack(wanted))
