"""The lift to judge by eye: every view with the mask it voted with, joints seen and joints found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch
from torch import Tensor

from ..feature_shapes import on_grid
from ..skeleton import VISIBLE
from .picture import DRAWABLE, pixel, write_picture

if TYPE_CHECKING:
    from ..scenes.person.lift import Lift

COLUMNS = 4
TINT = np.array([80, 160, 40])  # BGR of the mask
GREEN, LEGEND = (110, 220, 80), 28  # BGR of the word for it; height of the line [px]
SEEN, FOUND = (255, 220, 0), (40, 40, 255)  # BGR of a joint the network saw, and of the one triangulated


def write_contact_sheet(path: Path, image: Tensor, found: Lift) -> None:
    """Write a PNG of all views below a legend: mask tinted, seen joints as dots, found joints as rings.

    Args:
        path: ``.png``.
        image: the views, (V, 3, H, W) in [0, 1].
        found: the lift they were used for.
    """
    tiles = [_tile(image[v], found, v) for v in range(len(image))]
    blank = np.zeros_like(tiles[0])
    tiles += [blank] * (-len(tiles) % COLUMNS)
    rows = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    write_picture(path, np.vstack([_legend(rows[0].shape[1]), *rows])[..., ::-1])


def _legend(width: int) -> np.ndarray:
    """What the colours mean, in these, on a line (LEGEND, width, 3) that its letters fit into."""
    words = (
        ("green: voted for the person", GREEN),
        ("dot: joint seen by a network", SEEN),
        ("ring: joint found", FOUND),
    )
    scale = min(0.5, width / 1300)
    line, x = np.zeros((LEGEND, width, 3), np.uint8), 8
    for text, color in words:
        cv2.putText(line, text, (x, 20), cv2.FONT_HERSHEY_DUPLEX, scale, color, 1, cv2.LINE_AA)
        x += cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, 1)[0][0] + round(48 * scale)
    return line


def _tile(image: Tensor, found: Lift, view: int) -> np.ndarray:
    frame = (image.clamp(0, 1).permute(1, 2, 0).numpy()[..., ::-1] * 255).astype(np.uint8).copy()
    mask = on_grid(found.features.require("subject")[view][None], frame.shape[:2])[0].numpy()
    frame[mask] = (0.6 * frame[mask] + 0.4 * TINT).astype(np.uint8)
    for x, y, confidence in found.features.require("keypoints")[view].tolist():
        if confidence > VISIBLE:
            cv2.circle(frame, pixel(x, y), 2, SEEN, -1, cv2.LINE_AA)
    pixels, depth = found.cameras[view].project(found.subject.joints)
    shown = (pixels[0].abs() < DRAWABLE).all(-1) & (depth[0] > 0)  # false for what is not finite
    for x, y in pixels[0][shown].tolist():
        cv2.circle(frame, pixel(x, y), 5, FOUND, 1, cv2.LINE_AA)
    with_person = bool(torch.isfinite(found.features.require("box")[view, 0]))
    text = f"view {view}" if with_person else f"view {view}: no person"
    cv2.putText(frame, text, (8, 20), cv2.FONT_HERSHEY_DUPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return frame
