"""Lenses that no search has: a principal point beside the middle, pixels that are not square."""

from __future__ import annotations

import logging

import torch

from ..camera import Camera

ASIDE = 0.01  # of the frame, by how much a principal point may lie beside the middle, or of fy fx, without a word

_log = logging.getLogger("cltransfer")


def tell_beside(source: object, camera: Camera, then: str) -> None:
    """Tell where the principal point of one of the cameras lies beside the middle, and what is done ``then``."""
    beside = camera.K[:, :2, 2] / torch.tensor(camera.size) - 0.5
    most = beside[int(beside.abs().amax(1).argmax())].tolist()
    if max(map(abs, most)) > ASIDE:
        got = f"expected it in the middle, got {most[0]:+.1%} of the width and {most[1]:+.1%} of the height beside"
        _log.warning("%s: principal point: %s; %s", source, got, then)


def tell_oblong(source: object, camera: Camera, then: str) -> bool:
    """Whether pixels of one of the cameras are not square, which is told with what is done ``then``."""
    widest = int((camera.K[:, 0, 0] / camera.K[:, 1, 1]).log().abs().argmax())
    horizontal, vertical = camera.K[widest, [0, 1], [0, 1]].tolist()
    if oblong := abs(horizontal / vertical - 1) > ASIDE:
        got = f"expected fx as fy, got {horizontal:.6g} and {vertical:.6g}"
        _log.warning("%s: focal length: %s; %s", source, got, then)
    return oblong
