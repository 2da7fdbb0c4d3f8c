"""poses_bounds.npy of LLFF, as DyNeRF has it: a row an image, axes down, right, backward."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError

import numpy as np

from ...clips.decoding import IMAGE_SUFFIXES
from ...computer.array_type import Array
from ...errors import InputError
from ...storage.files import check_size
from . import POSED_VIDEOS, PosedImages
from .assemble import IMAGE_LIMIT, View, find_image, inverse, lens_of, names_in, posed_images, rigid

ROW = 17  # 3 x 5 of rotation, centre and (height, width, focal), then the nearest and farthest depth
BYTE_LIMIT = IMAGE_LIMIT * ROW * 8 + 4096
BROKEN = (ValueError, TypeError, IndexError, OverflowError, SyntaxError, TokenError)  # as NumPy does of a header


def read_llff(path: Path) -> PosedImages:
    """Images and cameras of a poses_bounds.npy.

    Rows belong to the images of ``images/``, else to the videos beside the file, in the order of their names' letters:
    LLFF writes them so, img_10 before img_2.

    Raises:
        InputError: see :func:`cltransfer.scenes.posed.read_posed`; or there are not as many images as rows.
    """
    rows = _rows(path)
    files = _files(path)
    if files and len(files) != len(rows):
        raise InputError(path, "rows", f"holds {len(rows)}, there are {len(files)} images", "they go by order")
    views = []
    for index, row in enumerate(rows):
        pose = row[:15].reshape(3, 5)
        height, width, focal = pose[:, 4]
        down, right, backward = pose[:, :3].T
        where = f"row {index}"
        c2w = rigid(path, where, np.stack([right, down, -backward], axis=1), pose[:, 3])
        lens = lens_of(path, where, (width, height), (focal, focal, width / 2, height / 2))
        name = files[index].name if files else f"{index:03d}"
        views.append(View(name, files[index] if files else None, inverse(c2w), lens))
    return posed_images(path, views)


def _rows(path: Path) -> Array:
    check_size(path, BYTE_LIMIT)
    try:
        rows = np.lib.format.open_memmap(path, mode="r")  # by map: a shape larger than the file is refused
    except (*BROKEN, OSError, MemoryError, RecursionError) as error:
        # the last two of nothing but a header that is nested too deep: no array is made
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(path, "", f"not a NumPy file: {reason}") from None
    if rows.ndim != 2 or rows.shape[1] != ROW or rows.dtype.kind != "f":
        raise InputError(path, "shape", f"expected (N, {ROW}) numbers, got {rows.shape} {rows.dtype}")
    return np.array(rows, np.float64)


def _files(path: Path) -> list[Path]:
    folder, suffixes = path.parent / "images", IMAGE_SUFFIXES
    if not folder.is_dir():
        folder, suffixes = path.parent, POSED_VIDEOS
    names = sorted(names_in(folder, suffixes))
    found = [find_image(path.parent, f"{folder.relative_to(path.parent)}/{name}", path) for name in names]
    return [file for file in found if file is not None]
