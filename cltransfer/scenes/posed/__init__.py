"""Posed image sets: photographs with known cameras, in the layouts people have them in.

Images are read when asked for, and only from the set's own folder.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor

from ...camera import Camera, fitted_size
from ...clips.decoding import IMAGE_SUFFIXES, decode
from ...clips.frame import Frame
from ...computer.array_type import Array
from ...computer.memory import require_free
from ...errors import InputError, UsageError
from .lens import Lens, image_at, straighten

POSED_VIDEOS = (".mp4", ".mkv", ".mov")
SIZE_SLACK = 2  # [px], how far an image's shape may be from its camera's: reduced sizes are rounded


@dataclass(frozen=True)
class PosedImages:
    """N photographs of one scene.

    Args:
        path: what it was read from.
        camera: N pinhole cameras of one size, as the images are once their lens is straightened. It is the size most
            of them have; the others are cut in the middle to its shape and brought to it.
        lenses: N lenses as the images were taken with, each at its own size.
        names: N names, as the set gives them.
        files: N image files (or videos, whose first frame counts); None where there is no such file.
        points: reconstructed points in the world, (P, 3) float64, where the set has them.
        colors: their RGB, (P, 3) uint8.
        exif: whether the cameras are of images turned as their EXIF says; COLMAP's are of the pixels as stored.
        masks: N image files that are black where a pixel of the photograph does not count, None where all do; or none.

    Raises:
        ValueError: the lengths differ.
    """

    path: Path
    camera: Camera
    lenses: tuple[Lens, ...]
    names: tuple[str, ...]
    files: tuple[Path | None, ...]
    points: Tensor | None = None  # (P, 3)
    colors: Tensor | None = None  # (P, 3)
    exif: bool = False
    masks: tuple[Path | None, ...] = ()

    def __post_init__(self) -> None:
        lengths = {len(self.camera), len(self.lenses), len(self.names), len(self.files)}
        if len(lengths) != 1:
            raise ValueError(f"camera, lenses, names and files must have one length, got {sorted(lengths)}")
        if len(self.masks) not in (0, len(self.names)):
            raise ValueError(f"masks must be none or {len(self.names)}, got {len(self.masks)}")

    def __len__(self) -> int:
        return len(self.camera)

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of images that are not there."""
        return tuple(name for name, file in zip(self.names, self.files) if file is None)

    @property
    def present(self) -> list[int]:
        """Index of every image that is there."""
        return [index for index, file in enumerate(self.files) if file is not None]

    def whole(self, index: int) -> Camera:
        """Camera of one image, (1), of all that is seen of it once it is straightened, at its lens's own size."""
        lens = self.lenses[index]
        return Camera(self.camera.w2c[[index]], torch.from_numpy(lens.straight_matrix())[None], lens.size)

    def images(self, index: Sequence[int], side: int) -> tuple[Camera, Tensor]:
        """Cameras (B) and straightened images (B, 3, H, W) uint8 RGB over black, the longer side at most ``side`` [px].

        Raises:
            InputError: an image is missing, damaged, of a kind that is not read, or of another shape than its camera.
            ResourceError: they take more memory than is free.
        """
        size = self._size(side)
        taken = 3 * size[0] * size[1] * (2 * len(index) + 1)  # the images, and all once more while they are stacked
        require_free(taken, self.path, f"{len(index)} images of {size[0]}x{size[1]}", "take a smaller side")
        images = [self._image(i, size) for i in index]
        return self.camera[list(index)].at_size(size), torch.stack(images)

    def counted(self, index: Sequence[int], side: int) -> Tensor | None:
        """Pixels of :meth:`images` of which all counts, (B, H, W) bool; None where the set leaves nothing out of them.

        Raises:
            InputError: a mask is missing, damaged, of a kind that is not read, or of another shape than its camera.
            ResourceError: they take more memory than is free.
        """
        masks, size = [(i, self.masks[i]) for i in index if self.masks], self._size(side)
        if not any(mask for _, mask in masks):
            return None
        taken = size[0] * size[1] * (len(masks) + 2)  # the answer, and one mask while it is looked at
        require_free(taken, self.path, f"{len(masks)} masks of {size[0]}x{size[1]}", "take a smaller side")
        counted = np.ones((len(masks), *size[::-1]), np.bool_)
        for row, (i, mask) in zip(counted, masks):
            if mask:
                row[:] = self._straight(i, mask, size, _mask) == 255
        return torch.from_numpy(counted)

    def _size(self, side: int) -> tuple[int, int]:
        """Of the images (W, H) whose longer side is at most ``side``."""
        return fitted_size(self.camera.size, min(side, max(self.camera.size)))

    def _image(self, index: int, size: tuple[int, int]) -> Tensor:
        file = self.files[index]
        if file is None:
            raise InputError(self.path, self.names[index], "the image is missing")
        return torch.from_numpy(self._straight(index, file, size, _photograph)).permute(2, 0, 1).contiguous()

    def _straight(
        self, index: int, file: Path, size: tuple[int, int], pixels: Callable[[Frame, tuple[int, int]], Array]
    ) -> Array:
        """What the pinhole of ``index`` would have seen of ``file``, at ``size``, read by ``pixels``."""
        lens = self.lenses[index]
        frame, (width, height) = first_frame(file, self.exif), lens.size
        if abs(frame.size[1] * width - frame.size[0] * height) > SIZE_SLACK * max(width, height):
            raise InputError(file, "size", f"expected the shape of {width}x{height}, got {frame.size}")
        if lens.size == self.camera.size:
            return straighten(pixels(frame, size), lens, self.camera.K[index].numpy())
        least = min(width, frame.size[0]), min(height, frame.size[1])  # what a set says of its lens can be anything
        return image_at(pixels(frame, least), lens, size)


def first_frame(file: Path, exif: bool) -> Frame:
    """The image in a file of a set, of a video the first one; ``exif`` as of :class:`PosedImages`.

    Raises:
        InputError: it is missing, damaged, or of a kind that is not read.
    """
    kind = file.suffix.lower()
    if kind and kind not in (*IMAGE_SUFFIXES, *POSED_VIDEOS) and file.is_file():
        raise InputError(file, "", f"is {kind}, expected PNG or JPEG", "convert the images, and their names in the set")
    return next(decode(file, exif))


def _photograph(frame: Frame, size: tuple[int, int]) -> Array:
    return frame.rgb(size, over_black=True)


def _mask(frame: Frame, size: tuple[int, int]) -> Array:
    """255 (H, W) where nothing of a pixel is black, however little above black the mask is: some are of 0 and 1."""
    white: Array = np.where(frame.rgb(frame.size, over_black=True).any(-1), 255, 0).astype(np.uint8)
    return cv2.resize(white, size, interpolation=cv2.INTER_AREA)


def read_posed(path: str | Path) -> PosedImages:
    """Read a posed image set.

    Args:
        path: a folder or file of COLMAP (a folder with ``sparse/0``, or the model's own folder, text or binary),
            nerfstudio or instant-ngp (transforms.json), the INRIA trainer (cameras.json), LLFF (poses_bounds.npy), or
            EasyMocap (intri.yml and extri.yml). Of a folder with COLMAP's model and what LLFF made of it the former is
            read, of which more is left; the file may be named. Of a folder of the Blender sets the views to train on
            are read (transforms_train.json).

    Raises:
        InputError: it is none of these, is damaged, names a file outside its folder or is a link to one, has a lens
            that cannot be straightened.
    """
    from . import formats

    return formats.read(Path(path))


def named_camera(source: str, option: str) -> Camera | None:
    """The camera ``SET:INDEX`` of a posed image set, (1), counted from 0, see :meth:`PosedImages.whole`.

    None where ``source`` ends in no index.

    Raises:
        InputError: the set cannot be read.
        UsageError: it has no such camera; ``option`` names where ``source`` was given.
    """
    name, colon, index = source.rpartition(":")
    if colon and not index.isdecimal() and Path(name).exists() and not Path(source).exists():
        raise UsageError(name, option, f"expected a whole number from 0 behind the colon, got {index!r}")
    if not (colon and index.isdecimal()):
        return None
    posed = read_posed(name)
    if int(index) >= len(posed):
        raise UsageError(name, option, f"expected 0 to {len(posed) - 1}, got {index}")
    return posed.whole(int(index))
