"""One decoded frame: its pixels, upright, as RGB."""

from __future__ import annotations

from dataclasses import dataclass, field

import av
import cv2
import numpy as np
from av.video.reformatter import Colorspace, VideoReformatter

from .alpha import has_alpha
from .alpha import over_black as laid_over_black

UNSAID = 2  # colour matrix of a file that does not tell it, as FFmpeg counts them
SMALL = (32, 18)  # (w, h) of the small pictures by which frames are compared [px]
HD = 720  # rows from which on a video that does not say is of BT.709, and not of BT.601


@dataclass(frozen=True)
class Frame:
    """One decoded frame; its pixels are converted only when asked for.

    Args:
        raw: as decoded, before rotation.
        size: (W, H) as shown, upright and with square pixels.
        time: presentation time in the file [s].
        turns: quarter turns to the left that bring it upright.
        mirrored: whether its rows are shown in reverse order before it is turned.
        converter: of pixels, for all frames of a file: to set one up takes as long as to convert many.
        notes: what a reader should know of how it comes out.
    """

    raw: av.VideoFrame
    size: tuple[int, int]
    time: float
    turns: int
    mirrored: bool
    converter: VideoReformatter = field(repr=False, compare=False)
    notes: tuple[str, ...] = ()

    def rgb(self, size: tuple[int, int], over_black: bool = False) -> np.ndarray:
        """Upright RGB at ``size`` (W, H), (H, W, 3) uint8; area averages where it is smaller.

        What is transparent shows the colour that lies under it, or black where ``over_black``.
        """
        laid = over_black and has_alpha(self.raw)
        pixels = laid_over_black(self._decoded("rgba")) if laid else self._decoded("rgb24")
        upright = np.rot90(pixels[::-1] if self.mirrored else pixels, self.turns)
        if upright.shape[1::-1] == size:
            return np.ascontiguousarray(upright)
        return cv2.resize(np.ascontiguousarray(upright), size, interpolation=cv2.INTER_AREA)

    def _decoded(self, kind: str) -> np.ndarray:
        """Pixels as decoded; a video that does not say by which matrix has that of its height, as players take it.

        A JPEG always says: its decoder has it of BT.601.
        """
        unsaid = self.raw.colorspace == UNSAID and not self.raw.format.is_rgb
        if unsaid and self.raw.height >= HD and not self.raw.format.name.startswith("gray"):
            return self.converter.reformat(self.raw, format=kind, src_colorspace=Colorspace.ITU709).to_ndarray()
        return self.converter.reformat(self.raw, format=kind).to_ndarray()

    def small(self) -> np.ndarray:
        """RGB of size :data:`SMALL` as decoded, before rotation, (h, w, 3) uint8: to compare frames of a file."""
        return self.converter.reformat(self.raw, *SMALL, format="rgb24", interpolation="AREA").to_ndarray()
