"""A PLY whose remarks are no ASCII is read as any other, and as fast."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData, PlyElement

from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.scenes.meshes.ply_faces import of_triangles
from cltransfer.scenes.meshes.read_mesh import read_mesh

CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)]
TRIANGLES = [[0, 1, 2], [0, 2, 3]]
POLYGONS = [[0, 1, 2, 3], [1, 4, 2]]
ENCODINGS = ["utf-8", "latin-1"]


def saved(path: Path, polygons: list[list[int]], remark: str, encoding: str = "utf-8") -> Path:
    """A binary PLY of ``polygons`` with places in a texture, and ``remark`` as its comment."""
    vertex = np.array(CORNERS, [(axis, "f4") for axis in "xyz"])
    face = np.empty(len(polygons), [("vertex_indices", "O"), ("texcoord", "O")])
    for row, polygon in enumerate(polygons):
        face[row] = np.array(polygon, "i4"), np.linspace(0, 1, 2 * len(polygon), dtype="f4")
    types = {"vertex_indices": "i4", "texcoord": "f4"}
    elements = [PlyElement.describe(vertex, "vertex"), PlyElement.describe(face, "face", val_types=types)]
    PlyData(elements, byte_order="<", comments=["REMARK"]).write(str(path))
    path.write_bytes(path.read_bytes().replace(b"REMARK", remark.encode(encoding), 1))
    return path


@pytest.fixture
def wood(tmp_path: Path) -> str:
    """The name of an image beside the meshes."""
    Image.fromarray(np.full((4, 2, 3), 90, np.uint8)).save(tmp_path / "körper.png")
    return "körper.png"


def read(*args: Any) -> Mesh:
    """What is read of what is saved."""
    return read_mesh(saved(*args)).mesh


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("polygons", [TRIANGLES, POLYGONS], ids=["triangles", "polygons"])
def test_a_texture_may_have_a_name_in_any_letters(
    tmp_path: Path, wood: str, polygons: list[list[int]], encoding: str
) -> None:
    mesh = read(tmp_path / "a.ply", polygons, f"TextureFile {wood}", encoding)
    assert [image.shape for image in mesh.textures] == [(4, 2, 4)]
    assert len(mesh) == sum(len(polygon) - 2 for polygon in polygons)


def test_a_file_of_triangles_is_as_it_is_whoever_wrote_it(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.ply", TRIANGLES, "by Jörg")
    data = path.read_bytes()
    assert of_triangles(path, data) is data


def test_a_remark_of_latin_1_keeps_no_file_from_being_read(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.ply", TRIANGLES, "by Jörg", "latin-1")
    expected = saved(tmp_path / "b.ply", TRIANGLES, "by Jörg").read_bytes()
    assert of_triangles(path, path.read_bytes()) == expected
    assert len(read_mesh(path).mesh) == 2


@pytest.mark.parametrize("name", ["Jörg", "Joerg"])
def test_triangles_are_looked_at_without_an_array_for_each(tmp_path: Path, name: str) -> None:
    path = saved(tmp_path / "a.ply", 2000 * TRIANGLES, f"by {name}")
    data = path.read_bytes()
    of_triangles(path, data)  # what is imported counts once
    tracemalloc.start()
    of_triangles(path, data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < len(data)


def test_the_remarks_of_polygons_stay_wherever_they_are(tmp_path: Path, wood: str) -> None:
    path = saved(tmp_path / "a.ply", POLYGONS, f"by Jörg\nobj_info größe 3\ncomment TextureFile {wood}")
    lines = path.read_bytes().replace(b"element face", "comment zwölf Flächen\nelement face".encode(), 1)
    lines = lines.replace(b"element vertex", "comment für Ecken\nelement vertex".encode(), 1)
    path.write_bytes(lines.replace(b"element face 2\n", b"element face 2\ncomment of walls\n", 1))
    header = of_triangles(path, path.read_bytes()).partition(b"end_header")[0].decode()
    remarks = ["comment by Jörg", "obj_info größe 3", f"comment TextureFile {wood}", "comment für Ecken"]
    remarks += ["comment zwölf Flächen", "comment of walls"]
    assert header.splitlines()[:8] == ["ply", "format binary_little_endian 1.0", *remarks]
    assert len(read_mesh(path).mesh.textures) == 1
