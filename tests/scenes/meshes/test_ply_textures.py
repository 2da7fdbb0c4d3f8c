"""Each face of a PLY shows the texture that it names, as of photogrammetry, whose atlases are many."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData, PlyElement

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.mesh import GREY, Mesh
from cltransfer.scenes.meshes.ply_textures import textures_of
from cltransfer.scenes.meshes.read_mesh import read_mesh

COLORS = {"red.png": [255, 0, 0], "blue.png": [0, 0, 255]}
NAMES = tuple(COLORS)
FORMS: list[dict[str, Any]] = [{"text": True}, {"byte_order": "<"}, {"byte_order": ">"}]
TRIANGLES, MIXED = [[0, 1, 2], [2, 1, 3], [2, 3, 4]], [[0, 1, 3, 2], [2, 3, 4]]


def saved(
    path: Path, polygons: list[list[int]], numbers: list[int] | None, names: tuple[str, ...] = NAMES, **form: Any
) -> Path:
    """A PLY of ``polygons`` with places in textures, each face with one of ``numbers``; red.png and blue.png are there.

    Every corner of a face has u = 0.25, but for the first, which has u = 0.75.
    """
    for name, color in COLORS.items():
        Image.new("RGB", (4, 4), tuple(color)).save(path.parent / name)
    vertex = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 2, 0)], [(axis, "f4") for axis in "xyz"])
    columns: list[tuple[str, str]] = [("vertex_indices", "O"), ("texcoord", "O")]
    kind = "i1" if form.get("byte_order") == ">" else "i4"  # plyfile swaps no bytes of a number beside lists
    face = np.empty(len(polygons), columns + ([] if numbers is None else [("texnumber", kind)]))
    for row, polygon in enumerate(polygons):
        face["vertex_indices"][row] = np.array(polygon, "i4")
        face["texcoord"][row] = np.array([0.75, 0.5] + [0.25, 0.5] * (len(polygon) - 1), "f4")
    if numbers is not None:
        face["texnumber"] = numbers
    types = {"vertex_indices": "i4", "texcoord": "f4"}
    elements = [PlyElement.describe(vertex, "vertex"), PlyElement.describe(face, "face", val_types=types)]
    comments = ["VCGLIB generated", *(f"TextureFile {name}" for name in names)]
    PlyData(elements, comments=comments, **(form or {"byte_order": "<"})).write(str(path))
    return path


def shown(mesh: Mesh) -> dict[tuple[float, ...], Any]:
    """The colour of the texture of each face by its middle, None where it has none."""
    middles = [tuple(round(value, 2) for value in middle) for middle in mesh.means.tolist()]
    colors = [None if i < 0 else mesh.textures[i][0, 0, :3].tolist() for i in mesh.texture.tolist()]
    return dict(zip(middles, colors))


@pytest.mark.parametrize("form", FORMS, ids=["text", "little", "big"])
@pytest.mark.parametrize("polygons", [TRIANGLES, MIXED], ids=["triangles", "polygons"])
def test_each_face_shows_the_texture_that_it_names(
    tmp_path: Path, form: dict[str, Any], polygons: list[list[int]]
) -> None:
    found = read_mesh(saved(tmp_path / "a.ply", polygons, [0] * (len(polygons) - 1) + [1], **form))
    last = (0.33, 1.33, 0)
    colors = shown(found.mesh)
    assert colors.pop(last) == COLORS["blue.png"]
    assert list(colors.values()) == [COLORS["red.png"]] * 2
    assert {file.name for file in found.files} == {"a.ply", *NAMES}
    corners = found.mesh.uv[found.mesh.faces.long()][:, :, 0]
    assert sorted(corners[found.mesh.texture == 1].flatten().tolist()) == [0.25, 0.25, 0.75]


def test_what_names_one_image_twice_is_of_one_texture(tmp_path: Path) -> None:
    mesh = read_mesh(saved(tmp_path / "a.ply", TRIANGLES, [0, 2, 1], (*NAMES, "red.png"))).mesh
    assert len(mesh.textures) == 2
    assert sorted(shown(mesh).values()) == [COLORS["blue.png"], COLORS["red.png"], COLORS["red.png"]]
    mesh = read_mesh(saved(tmp_path / "b.ply", TRIANGLES, None, ("red.png", "red.png"))).mesh
    assert list(shown(mesh).values()) == [COLORS["red.png"]] * 3


def test_a_face_of_no_texture_beside_others_is_grey(tmp_path: Path) -> None:
    mesh = read_mesh(saved(tmp_path / "a.ply", TRIANGLES, [1, -1, 0])).mesh
    assert (shown(mesh)[0.67, 0.67, 0], len(mesh)) == (None, 3)
    assert mesh.colors[mesh.faces[mesh.texture < 0].long()].unique().tolist() == [pytest.approx(GREY)]


def test_faces_that_say_of_none_of_several_textures_that_they_show_it_are_refused(tmp_path: Path) -> None:
    told = r"a.ply: faces: the header names 2 textures, and no texnumber of a face says .* \(export OBJ or glTF\)"
    with pytest.raises(InputError, match=told):
        read_mesh(saved(tmp_path / "a.ply", TRIANGLES, None))


@pytest.mark.parametrize("number", [-2, 2])
def test_a_texture_that_is_not_there_is_told(tmp_path: Path, number: int) -> None:
    with pytest.raises(InputError, match=f"a.ply: faces: expected a texnumber of -1 to 1, got {number}"):
        read_mesh(saved(tmp_path / "a.ply", TRIANGLES, [0, number, 1]))
    with pytest.raises(InputError, match=r"a.ply: uri: no such file 'gone.png'"):
        read_mesh(saved(tmp_path / "a.ply", TRIANGLES, [0, 0, 1], ("gone.png", "red.png")))
    path = saved(tmp_path / "a.ply", TRIANGLES, [0, 0, 1])
    (tmp_path / "red.png").write_bytes(b"no image")
    with pytest.raises(InputError, match=r"a.ply: images: a texture cannot be decoded"):
        read_mesh(path)


def test_names_are_found_in_remarks_in_whatever_letters() -> None:
    header = "ply\nformat ascii 1.0\ncomment TEXTUREFILE my wood.png \r\nobj_info texturefile ä.png\nelement vertex 0\n"
    assert textures_of(f"{header}end_header\n".encode()) == ["my wood.png", "ä.png"]
