"""A PLY of several textures, as of photogrammetry: each of its faces says by ``texnumber`` which of them it shows."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..ply_header import REMARKS, header_of
from .asset_files import Beside
from .textures import FORMATS, image_size

NAMES = b"texturefile"  # the word before a name, in whatever letters; trimesh takes the last name for all faces
NUMBER = "texnumber"  # column of the faces, from 0 in the order of the names; -1 is none


def textures_of(data: bytes) -> list[str]:
    """Names of the images in the header of a PLY, in its order, found as trimesh finds them; the header is UTF-8."""
    remarks = [line for line in header_of(data).split(b"\n") if line.split()[:1] in REMARKS]
    found = [(remark, remark.lower().find(NAMES)) for remark in remarks]
    return [remark[at + len(NAMES) :].decode().strip() for remark, at in found if at >= 0]


def of_one_texture(path: Path, geometry: Any, names: Sequence[str], files: Beside) -> Iterator[Any]:
    """A trimesh geometry of a PLY with places in its textures as geometries of one texture each, or of none.

    Args:
        path: for error lines.
        geometry: its faces in the order of the file.
        names: of the textures; what names the same image is of one geometry.
        files: gives their bytes.

    Raises:
        InputError: faces do not say which texture they show, or name one that is not there or cannot be decoded.
    """
    from PIL import Image
    from trimesh import Trimesh
    from trimesh.visual import TextureVisuals

    face = geometry.metadata["_ply_raw"]["face"]
    if NUMBER not in face["properties"]:
        reason = f"the header names {len(set(names))} textures, and no {NUMBER} of a face says which it shows"
        raise InputError(path, "faces", reason, "export OBJ or glTF")
    shown = np.asarray(face["data"][NUMBER]).reshape(-1)
    wrong = shown[~np.isin(shown, range(-1, len(names)))]
    if len(wrong):
        raise InputError(path, "faces", f"expected a {NUMBER} of -1 to {len(names) - 1}, got {wrong[0]:g}")
    for name in dict.fromkeys([None, *names]):
        numbers = [-1] if name is None else [number for number, other in enumerate(names) if other == name]
        used, corners = np.unique(geometry.faces[np.isin(shown, numbers)], return_inverse=True)
        if not len(used):
            continue
        visual = None
        if name is not None:
            data = files.get(name)
            image_size(path, data)
            image = Image.open(io.BytesIO(data), formats=FORMATS)
            visual = TextureVisuals(uv=geometry.visual.uv[used], image=image)
        yield Trimesh(geometry.vertices[used], corners.reshape(-1, 3), process=False, visual=visual)
