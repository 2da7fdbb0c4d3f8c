"""Which format a posed image set is in: by the names of its files, and for JSON by what it holds."""

from __future__ import annotations

from pathlib import Path

from ...errors import InputError
from ...storage.files import refuse_outside
from . import PosedImages
from .colmap import OWN_FOLDERS, find_model, read_colmap
from .colmap_tables import TABLES
from .easymocap import read_easymocap
from .inria import read_inria
from .llff import read_llff
from .transforms import read_transforms

LLFF = "poses_bounds.npy"  # made of a model of COLMAP, without its points, second focal length and distortion
SET_FILES = ("transforms.json", "cameras.json", LLFF, "intri.yml")
TRAIN = "transforms_train.json"  # of the Blender sets, beside one of views to test on: taken where there is no other
KNOWN = f"{', '.join(SET_FILES)}, sparse/0, or {TRAIN}"


def read(path: Path) -> PosedImages:
    """The set at ``path``; see :func:`cltransfer.scenes.posed.read_posed`."""
    if not path.exists():
        raise InputError(path, "", "no such file or folder")
    if path.is_dir():
        return _read_folder(path)
    if path.name in ("intri.yml", "extri.yml"):
        return read_easymocap(path.parent)
    if path.suffix == ".npy":
        return read_llff(path)
    if path.suffix == ".json":
        with path.open("rb") as stream:
            start = stream.read(64).lstrip()
        return read_inria(path) if start.startswith(b"[") else read_transforms(path)
    raise InputError(path, "", "is no posed image set", f"expected {KNOWN}")


def _read_folder(folder: Path) -> PosedImages:
    whole = find_model(folder, OWN_FOLDERS)
    for name in SET_FILES:
        if (folder / name).is_file():
            if whole is not None and name == LLFF:
                return _read_model(folder, whole)
            refuse_outside(folder, [folder / name], "set")
            return read(folder / name)
    model = find_model(folder)
    if model is None and (folder / TRAIN).is_file():
        refuse_outside(folder, [folder / TRAIN], "set")
        return read(folder / TRAIN)
    if model is None:
        raise InputError(folder, "", "is no posed image set", f"expected {KNOWN}")
    return _read_model(folder, model)


def _read_model(folder: Path, model: Path) -> PosedImages:
    refuse_outside(folder, (model / name for name in TABLES), "set")
    return read_colmap(model)
