"""What is transparent in a frame: clips are read as if nothing were."""

from __future__ import annotations

import av
import numpy as np

TRANSPARENT = "transparent in parts: read as if it were opaque (lay it over a background first)"


def has_alpha(raw: av.VideoFrame) -> bool:
    """Whether a frame may be transparent, as one with a palette may; most that may are not."""
    return raw.format.has_palette or any(component.is_alpha for component in raw.format.components)


def is_transparent(raw: av.VideoFrame) -> bool:
    """Whether something would be seen through a frame."""
    return has_alpha(raw) and bool((raw.to_ndarray(format="rgba")[..., 3] < 255).any())


def over_black(rgba: np.ndarray) -> np.ndarray:
    """RGB times alpha, (H, W, 3) uint8, of (H, W, 4) uint8."""
    wide = rgba.astype(np.uint16)
    return ((wide[..., :3] * wide[..., 3:] + 127) // 255).astype(np.uint8)
