"""COLMAP's sparse models, text or binary: cameras, images with world-to-camera poses, points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from kornia.geometry.conversions import quaternion_to_rotation_matrix

from ...computer.array_type import Array
from ...errors import InputError
from . import PosedImages
from .assemble import View, find_image, lens_of, posed_images, rigid
from .colmap_tables import STRAIGHTEN, Calibration, Shot, Tables
from .lens import Lens

# number of parameters of each lens model we know the formula of, by COLMAP's name
FOCALS = {"SIMPLE_PINHOLE": 1, "PINHOLE": 2, "SIMPLE_RADIAL": 1, "RADIAL": 1, "OPENCV": 2, "FULL_OPENCV": 2}
OWN_FOLDERS = ("sparse/0", "sparse")  # of a model of the images in the folder itself
MODEL_FOLDERS = (*OWN_FOLDERS, "colmap/sparse/0", ".")


def find_model(folder: Path, names: Sequence[str] = MODEL_FOLDERS) -> Path | None:
    """The folder of the sparse model in one of ``names`` of ``folder``, None where there is none."""
    for name in names:
        if any((folder / name / f"cameras{suffix}").is_file() for suffix in (".bin", ".txt")):
            return folder / name
    return None


def read_colmap(model: Path) -> PosedImages:
    """Images, cameras and points of the sparse model in the folder ``model``; images in the order of their names.

    The images are in ``images/`` of the folder above ``sparse``, or beside the model.

    Raises:
        InputError: see :func:`cltransfer.scenes.posed.read_posed`.
    """
    tables = _read_tables(model)
    root = _root(model)
    lenses = {key: _lens(model, key, value) for key, value in tables.cameras.items()}
    views = [_view(model, root, shot, lenses) for shot in sorted(tables.images, key=lambda shot: shot.name)]
    return posed_images(model, views, tables.points, tables.colors)


def _read_tables(model: Path) -> Tables:
    if (model / "cameras.bin").is_file():
        from .colmap_binary import read_tables
    else:
        from .colmap_text import read_tables
    return read_tables(model)


def _root(model: Path) -> Path:
    """The set's folder: what holds ``sparse``, else the model's own."""
    model = model.absolute()
    above = model.parent if model.name.isdecimal() else model
    root = above.parent if above.name == "sparse" else model
    return root.parent if root.name == "colmap" and not (root / "images").is_dir() else root


def _lens(model: Path, key: int, camera: Calibration) -> Lens:
    where = f"camera {key}"
    if camera.model not in FOCALS:
        raise InputError(model, where, f"lens {camera.model} cannot be straightened", STRAIGHTEN)
    focals = FOCALS[camera.model]
    parameters = list(camera.parameters)
    focal, center, bend = parameters[:focals], parameters[focals : focals + 2], parameters[focals + 2 :]
    return lens_of(model, where, camera.size, [focal[0], focal[-1], *center], bend)


def _view(model: Path, root: Path, shot: Shot, lenses: dict[int, Lens]) -> View:
    if shot.camera not in lenses:
        raise InputError(model, shot.name, f"is taken with camera {shot.camera}, which is not in the model")
    file = find_image(root, f"images/{shot.name}", model) or find_image(root, shot.name, model)
    w2c = rigid(model, shot.name, _rotation(shot.quaternion), shot.translation)
    return View(shot.name, file, w2c, lenses[shot.camera])


def _rotation(quaternion: Array) -> Array:
    with np.errstate(invalid="ignore"):  # of length 0 it becomes NaN, which is refused
        unit = quaternion / np.linalg.norm(quaternion)
    return quaternion_to_rotation_matrix(torch.from_numpy(unit)).numpy()
