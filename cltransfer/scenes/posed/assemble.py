"""What every format shares: checked numbers, files inside the set's folder, views put together."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ...camera import Camera
from ...clips.decoding import IMAGE_SUFFIXES
from ...computer.array_type import Array
from ...computer.memory import require_free
from ...errors import InputError
from . import POSED_VIDEOS, PosedImages, first_frame
from .lens import Lens, matrix_at

IMAGE_LIMIT = 20_000
POINT_LIMIT = 20_000_000
SIDE_LIMIT = 65_536  # [px]
POINT_BYTES = 60  # of a reconstructed point with its colour, while it is read
ROTATION_SLACK = 1e-3
UNBENT = "its image would fold or vanish: are these k1, k2, p1, p2 and k3 of OpenCV's model?"


@dataclass(frozen=True)
class View:
    """One image of a set.

    Args:
        name: as the set gives it.
        file: where it is, None where there is no such file.
        w2c: (4, 4), OpenCV axes.
        lens: it was taken with.
        mask: image that is black where a pixel does not count, None where all do.
    """

    name: str
    file: Path | None
    w2c: Array
    lens: Lens
    mask: Path | None = None


def posed_images(
    path: Path, views: Sequence[View], points: Array | None = None, colors: Array | None = None
) -> PosedImages:
    """Views as one value, at the size most of them have; the others are cut to its shape. No points at all are None.

    Raises:
        InputError: there are none or too many.
    """
    if not 1 <= len(views) <= IMAGE_LIMIT:
        raise InputError(path, "images", f"expected 1 to {IMAGE_LIMIT}, got {len(views)}")
    size = Counter(view.lens.size for view in views).most_common(1)[0][0]
    straight = {lens: matrix_at(lens, size) for lens in {view.lens for view in views}}
    K = torch.from_numpy(np.stack([straight[view.lens] for view in views]))
    camera = Camera(torch.from_numpy(np.stack([view.w2c for view in views])), K, size)
    if points is not None and len(points) == 0:
        points = colors = None
    if points is not None and not np.isfinite(points).all():
        raise InputError(path, "points", "expected finite numbers, got NaN or infinity")
    return PosedImages(
        path,
        camera,
        tuple(view.lens for view in views),
        tuple(view.name for view in views),
        tuple(view.file for view in views),
        None if points is None else torch.from_numpy(points),
        None if colors is None else torch.from_numpy(colors),
        masks=tuple(view.mask for view in views),
    )


def check_points(path: Path, count: int) -> None:
    """Hold the points of a set against the memory there is.

    Raises:
        ResourceError: they take more than is free.
    """
    require_free(POINT_BYTES * count, path, f"{count} points", "leave out points")


def find_image(root: Path, name: str, where: Path, suffixes: Sequence[str] = IMAGE_SUFFIXES) -> Path | None:
    """File ``name`` below ``root``, with one of ``suffixes`` where it has none, in capitals too; None if there is none.

    What has a suffix that is not read is found last, and is refused by who reads it.

    Raises:
        InputError: ``name`` leads out of ``root`` or can be no file's; ``where`` names the file that says so.
    """
    if name.replace("\\", "/").startswith("//"):  # Windows would ask another computer for it
        raise InputError(where, name[:80], "leads out of the folder of the set", "keep its images beside it")
    plain = root / name
    known = plain.suffix.lower() in (*IMAGE_SUFFIXES, *POSED_VIDEOS)
    cased = [cased for suffix in suffixes for cased in (suffix, suffix.upper())]
    last = [plain] if plain.suffix else []
    try:
        for file in last if known else [*(plain.with_name(plain.name + suffix) for suffix in cased), *last]:
            if not Path(os.path.realpath(file)).is_relative_to(os.path.realpath(root)):
                raise InputError(where, name, "leads out of the folder of the set", "keep its images beside it")
            if os.path.isfile(file):  # which a name that is too long is not
                return file
    except ValueError:  # what is no path, or none that the system can have
        raise InputError(where, f"{name[:80]!r}", "is no name of a file") from None
    return None


def names_in(folder: Path, suffixes: Collection[str]) -> list[str]:
    """Names of the files of ``folder`` with one of ``suffixes``; hidden ones, as a Mac leaves beside each, are none."""
    return [f.name for f in folder.iterdir() if f.suffix.lower() in suffixes and not f.name.startswith(".")]


def lens_of(
    where: Path, field: str, size: tuple[float, float], values: Sequence[float], distortion: Sequence[float] = ()
) -> Lens:
    """A lens of ``size`` (W, H) with ``values`` fx, fy, cx, cy [px], checked.

    Raises:
        InputError: a value is not finite or out of range, or such a lens cannot be straightened.
    """
    if not all(1 <= length <= SIDE_LIMIT and length == int(length) for length in size):
        raise InputError(where, field, f"expected a width and a height of 1 to {SIDE_LIMIT} px, got {tuple(size)}")
    if not all(math.isfinite(v) for v in (*values, *distortion)) or min(values[:2]) <= 0:
        raise InputError(where, field, f"expected finite intrinsics and a positive focal length, got {tuple(values)}")
    bend = tuple(distortion) if any(distortion) else ()
    lens = Lens((int(size[0]), int(size[1])), (values[0], values[1]), (values[2], values[3]), bend)
    if not lens.can_be_straightened:
        told = ", ".join(f"{value:g}" for value in bend)
        raise InputError(where, field, f"a lens with the distortion {told} cannot be straightened", UNBENT)
    return lens


def size_of_image(where: Path, name: str, file: Path | None, exif: bool = False) -> tuple[int, int]:
    """(W, H) [px] of an image whose set does not say; ``exif`` as of :class:`PosedImages`.

    Raises:
        InputError: the image is missing, damaged, or of a kind that is not read.
    """
    if file is None:
        raise InputError(where, name, "the set states no width and height, and the image is missing")
    return first_frame(file, exif).size


def numbers(where: Path, field: str, value: Any, shape: tuple[int, ...]) -> Array:
    """``value`` as finite float64 of ``shape``, () of a single one.

    Raises:
        InputError: it is of another shape or kind.
    """
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0)
    if array.shape != shape or not np.isfinite(array).all():
        wanted = f"{' x '.join(map(str, shape))} finite numbers" if shape else "a finite number"
        raise InputError(where, field, f"expected {wanted}")
    return array


def rigid(where: Path, field: str, R: Array, t: Array) -> Array:
    """(4, 4) of a rotation (3, 3), made exact, and a translation (3,).

    Raises:
        InputError: R is no rotation.
    """
    if not np.isfinite(R).all() or not np.isfinite(t).all():
        raise InputError(where, field, "expected finite numbers")
    u, _, v = np.linalg.svd(R)
    exact = u @ v
    if np.abs(exact - R).max() > ROTATION_SLACK or np.linalg.det(exact) < 0:
        raise InputError(where, field, "expected a rotation", "a scaled or mirrored pose is no camera")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = exact, t
    return pose


def inverse(pose: Array) -> Array:
    """Camera-to-world of world-to-camera, and the other way round, (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = pose[:3, :3].T
    out[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return out
