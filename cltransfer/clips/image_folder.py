"""A folder of images as a clip: in which order they play, and when."""

from __future__ import annotations

import os
import re
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch

from ..along_clip import check_times
from ..errors import InputError, UsageError
from ..storage.files import content_hash, read_json
from .decoding import IMAGE_SUFFIXES, VIDEOS

TIMES = "times.json"
FOLDER_RATE = 24.0  # images a second where nothing says


def natural_order(name: str) -> list[tuple[int, str]]:
    """Key by which names sort as people count.

    >>> sorted(["cam10", "cam9"], key=natural_order)
    ['cam9', 'cam10']
    """
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def image_files(folder: Path) -> list[Path]:
    """PNG and JPEG files of ``folder`` as people count; hidden ones, as a Mac leaves beside each, are none.

    Raises:
        InputError: there are none, or one, or what tells their times, is a link that leads out of the folder.
    """
    files = [f for f in folder.iterdir() if _is_image(f)]
    files.sort(key=lambda file: natural_order(file.name))
    if not files:
        raise InputError(folder, "images", "expected PNG or JPEG files, found none")
    here = folder.resolve()
    for file in (*files, folder / TIMES):
        if file.is_symlink() and not Path(os.path.realpath(file)).is_relative_to(here):  # a loop leads nowhere
            raise InputError(file, "", "is a link that leads out of its folder", "put the file itself there")
    return files


def _is_image(file: Path) -> bool:
    return file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith(".")


def clip_hash(path: Path) -> str:
    """SHA-256 of a video, or of what is played of a folder: its images and times, whatever else lies there.

    Raises:
        InputError: as of :func:`image_files`.
    """
    if not path.is_dir():
        return content_hash(path)
    return content_hash(path, [*image_files(path), *([] if untimed(path) else [path / TIMES])])


def untimed(path: Path) -> bool:
    """Whether ``path`` is a folder that does not say when its images are shown."""
    return path.is_dir() and not (path / TIMES).exists()


def folder_times(folder: Path, files: list[Path], fps: float | None = None) -> np.ndarray:
    """When each of ``files`` is shown, (N,) increasing [s]: by ``times.json``, else ``fps`` images a second.

    Raises:
        InputError: ``times.json`` does not fit or tells times that are none of frames, or there is none and an image is
            missing, or not numbered as the others are.
        UsageError: there are both ``times.json`` and ``fps``.
    """
    if untimed(folder):
        _check_no_gap(files)
        return np.arange(len(files)) / (fps or FOLDER_RATE)
    if fps is not None:
        reason = f"expected a folder without {TIMES}, this one's says when each image is shown"
        raise UsageError(folder, "#fps", reason, f"leave out #fps, or take {TIMES} away")
    given = read_json(folder / TIMES)
    try:
        times = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        times = np.empty(0)
    if times.shape != (len(files),) or not (times[1:] > times[:-1]).all():
        raise InputError(folder / TIMES, "", f"expected {len(files)} increasing seconds, one per image")
    check_times(folder / TIMES, "", torch.from_numpy(times))
    return times


def _check_no_gap(files: list[Path]) -> None:
    named = [[int(digits) for digits in re.findall(r"\d+", file.stem)] for file in files]
    hint = f"put {TIMES} there, a JSON list of {len(files)} seconds, one per image, or"
    _check_alike(files, [len(numbers) for numbers in named], f"{hint} take away what is none of its frames")
    numbers = _counting(named)
    if numbers is None:
        return
    step, hint = min((b - a for a, b in pairwise(numbers)), default=1), f"{hint} renumber them"
    if step <= 0:
        raise InputError(files[0].parent, "numbers", "do not count up", hint)
    for (a, b), file in zip(pairwise(numbers), files[1:]):
        if b - a != step:
            raise InputError(file, "number", f"follows number {a}, expected {a + step}: an image is missing", hint)


def _check_alike(files: list[Path], counts: list[int], hint: str) -> None:
    """Refuse files in whose names there are not equally many numbers, ``counts`` each: some are of something else."""
    often = Counter(counts)
    usual, rare = max(often, key=often.__getitem__), min(reversed(often), key=often.__getitem__)
    if usual != rare:
        other = files[counts.index(usual)].name
        raise InputError(files[counts.index(rare)], "number", f"is not numbered as {other} is", hint)


def _counting(named: list[list[int]]) -> list[int] | None:
    """Of the numbers in each name those that count: the last that are not the same throughout; None where none are.

    >>> _counting([[1, 1080], [2, 1080]]), _counting([[7], [7]])
    ([1, 2], None)
    """
    return next((list(column) for column in reversed(list(zip(*named))) if len(set(column)) > 1), None)


def holds_clips(folder: Path) -> bool:
    """Whether ``folder`` holds videos or folders, and is no image folder itself."""
    entries = list(folder.iterdir()) if folder.is_dir() else []
    images = any(_is_image(entry) for entry in entries)
    return not images and any(entry.is_dir() or entry.suffix.lower() in VIDEOS for entry in entries)
