"""Square crops about a person, upright in the crop, and the way back to the frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

COARSE = 1.5  # pixels of the frame to one of the crop above which two taps along an axis leave some out


@dataclass(frozen=True)
class Crops:
    """N squares in frames of N images; pixels have their corner at 0.

    Args:
        center: (N, 2) [px of the frame].
        side: (N,) [px of the frame].
        up: unit vector in the frame that points up in the crop, (N, 2); (0, -1) is no rotation.
        size: side of the crop once cut [px].
    """

    center: np.ndarray  # (N, 2)
    side: np.ndarray  # (N,)
    up: np.ndarray  # (N, 2)
    size: int

    @property
    def turn(self) -> np.ndarray:
        """Rotation frame -> crop, (N, 2, 2)."""
        x, y = self.up.T
        return np.stack([np.stack([-y, x], -1), np.stack([-x, -y], -1)], axis=-2)

    def to_frame(self, points: np.ndarray) -> np.ndarray:
        """Frame pixels (N, P, 2) of crop pixels (N, P, 2)."""
        scale = (self.side / self.size)[:, None, None]
        return (points - self.size / 2) * scale @ self.turn + self.center[:, None]  # p @ R is R^T p

    def cut(self, images: np.ndarray, smooth: bool = False) -> np.ndarray:
        """The crops (N, size, size, 3) uint8 of ``images`` (N, H, W, 3) uint8; black beyond the frame.

        Args:
            images: the frames.
            smooth: have all pixels of a frame that the crop makes much smaller count, and not two along each axis.
        """
        cuts = np.empty((len(images), self.size, self.size, 3), np.uint8)
        for cut, image, matrix, times in zip(cuts, images, self._matrices(), self.side / self.size):
            if smooth and times > COARSE:
                image, matrix = _averaged(image, matrix, times)
            cv2.warpAffine(image, matrix, (self.size, self.size), dst=cut)
        return cuts

    def paste(self, maps: np.ndarray, size: tuple[int, int], outside: float) -> np.ndarray:
        """Maps (N, S, S) float32 over the crops as seen in frames of ``size`` (W, H), (N, H, W)."""
        pasted = np.empty((len(maps), size[1], size[0]), np.float32)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        for frame, values, matrix in zip(pasted, maps, self._matrices()):
            cv2.warpAffine(values, matrix, size, dst=frame, flags=flags, borderValue=outside)
        return pasted

    def _matrices(self) -> np.ndarray:
        """Frame -> crop, (N, 2, 3), for OpenCV, whose pixels have their centre at 0."""
        linear = self.turn * (self.size / self.side)[:, None, None]
        shift = self.size / 2 - (linear @ self.center[..., None])[..., 0]
        shift = shift + linear.sum(-1) / 2 - 0.5
        return np.concatenate([linear, shift[..., None]], axis=-1)


def _averaged(image: np.ndarray, matrix: np.ndarray, times: float) -> tuple[np.ndarray, np.ndarray]:
    """``image`` (H, W, 3) made ``times`` smaller by area averages, and ``matrix`` (2, 3) that leads from there."""
    height, width = image.shape[:2]
    size = max(1, round(width / times)), max(1, round(height / times))
    step = np.array([width / size[0], height / size[1]])
    shift = matrix[:, 2] + matrix[:, :2] @ (step / 2 - 0.5)
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.column_stack([matrix[:, :2] * step, shift])


def about_boxes(boxes: np.ndarray, margin: float, size: int) -> Crops:
    """Upright squares of ``margin`` times the longer side of boxes (N, 4) as x, y, width, height."""
    up = np.tile([0.0, -1.0], (len(boxes), 1))
    return Crops(boxes[:, :2] + boxes[:, 2:4] / 2, boxes[:, 2:4].max(axis=1) * margin, up, size)
