"""Polygons of a PLY are cut into triangles, as exporters leave them untriangulated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from plyfile import PlyData, PlyElement

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.ply_faces import of_triangles
from cltransfer.scenes.meshes.read_mesh import read_mesh

WALL = [(0, 0), (1.5, 0), (1.5, 2), (2.5, 2), (2.5, 0), (4, 0), (4, 3), (0, 3)]  # with a door, area 10
FORMS: list[dict[str, Any]] = [{"text": True}, {"byte_order": "<"}, {"byte_order": ">"}]


def saved(path: Path, polygons: list[Any], comments: tuple[str, ...] = (), **more: Any) -> Path:
    """A PLY of WALL's corners and two beside it, whose faces are ``polygons`` and have ``more`` each; see ``form``."""
    form = more.pop("form", {"byte_order": "<"})
    vertex = np.array([(x, y, 0) for x, y in [*WALL, (5, 0), (5, 3)]], [(axis, "f4") for axis in "xyz"])
    columns: dict[str, list[Any]] = {"vertex_indices": polygons, **more}
    lists = {name for name, values in columns.items() if isinstance(values[0], list)}
    face = np.empty(len(polygons), [(name, "O" if name in lists else "u1") for name in columns])
    for name, values in columns.items():
        for row, value in enumerate(values):
            face[name][row] = np.array(value, "i4" if name == "vertex_indices" else "f4") if name in lists else value
    types = {name: "i4" if name == "vertex_indices" else "f4" for name in lists}
    elements = [PlyElement.describe(vertex, "vertex"), PlyElement.describe(face, "face", val_types=types)]
    PlyData(elements, comments=list(comments), **form).write(str(path))
    return path


@pytest.mark.parametrize("form", FORMS, ids=["text", "little", "big"])
def test_a_wall_keeps_its_door_beside_faces_of_other_sizes(tmp_path: Path, form: dict[str, Any]) -> None:
    path = saved(tmp_path / "a.ply", [[*range(8)], [5, 8, 9, 6], [5, 8, 9]], form=form)
    mesh = read_mesh(path).mesh
    corners = mesh.vertices[mesh.faces.long()].double()
    normal = (corners[:, 1] - corners[:, 0]).cross(corners[:, 2] - corners[:, 0], dim=1)
    assert normal[:, 2].sum().item() / 2 == pytest.approx(10 + 3 + 1.5)
    assert bool((normal[:, 2] >= 0).all())
    middle = corners.mean(1)
    assert not bool(((middle[:, 0] > 1.5) & (middle[:, 0] < 2.5) & (middle[:, 1] < 2)).any())


@pytest.mark.parametrize("form", FORMS, ids=["text", "little", "big"])
def test_a_remark_that_is_no_ascii_costs_no_door(tmp_path: Path, form: dict[str, Any]) -> None:
    path = saved(tmp_path / "a.ply", [[*range(8)], [5, 8, 9, 6]], ("by Mueller",), form=form)
    path.write_bytes(path.read_bytes().replace(b"Mueller", "Müller".encode()))
    mesh = read_mesh(path).mesh
    corners = mesh.vertices[mesh.faces.long()].double()
    normal = (corners[:, 1] - corners[:, 0]).cross(corners[:, 2] - corners[:, 0], dim=1)
    assert normal.norm(dim=1).sum().item() / 2 == pytest.approx(10 + 3)


def test_the_triangles_of_a_polygon_have_its_colour(tmp_path: Path) -> None:
    colors = {"red": [255, 0], "green": [0, 255], "blue": [0, 0]}
    mesh = read_mesh(saved(tmp_path / "a.ply", [[0, 5, 6, 7], [0, 1, 2]], **colors)).mesh
    assert mesh.colors[mesh.faces.long()].mean(1).tolist() == [[1, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_the_triangles_of_a_polygon_show_its_part_of_the_texture(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "wood.png")
    square, corner = [0.0, 0, 1, 0, 1, 1, 0, 1], [0.25, 0, 0.5, 0, 0.5, 0.5]
    texture = ("TextureFile wood.png",)
    mesh = read_mesh(saved(tmp_path / "a.ply", [[0, 5, 6, 7], [5, 8, 9]], texture, texcoord=[square, corner])).mesh
    assert len(mesh.textures) == 1
    at = {tuple(p): (u, 1 - v) for p, (u, v) in zip(mesh.vertices.tolist(), mesh.uv.tolist())}
    assert (at[0, 3, 0], at[4, 3, 0], at[5, 3, 0]) == ((0, 1), (1, 1), (0.5, 0.5))
    path = saved(tmp_path / "b.ply", [[0, 5, 6, 7], [5, 8, 9]], texture, texcoord=[square, square])
    with pytest.raises(InputError, match="faces: expected two numbers of texcoord for each corner"):
        read_mesh(path)


def test_a_file_of_triangles_is_as_it_is(tmp_path: Path) -> None:
    for form in FORMS:
        path = saved(tmp_path / "a.ply", [[0, 1, 2], [2, 3, 4]], form=form)
        data = path.read_bytes()
        assert of_triangles(path, data) is data


def test_a_polygon_of_a_vertex_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="faces: name vertex 10 of 10"):
        read_mesh(saved(tmp_path / "a.ply", [[0, 1, 2, 10], [0, 1, 2]]))


@pytest.mark.parametrize("form", FORMS, ids=["text", "little", "big"])
@pytest.mark.parametrize("polygons", [[[0, 1, 2]], [[*range(8)], [0, 1, 2]]], ids=["triangles", "polygons"])
def test_one_number_in_place_of_a_list_is_told(tmp_path: Path, form: dict[str, Any], polygons: list[list[int]]) -> None:
    one = [7] * len(polygons)
    for name in ("vertex_index", "texcoord"):
        path = saved(tmp_path / "a.ply", polygons, form=form, **{name: one})
        with pytest.raises(InputError, match=f"a.ply: faces: expected a list of {name} for each, got one number"):
            read_mesh(path)
    saved(path, one, form=form)
    with pytest.raises(InputError, match=r"a.ply: faces: expected a list of vertex_indices for each"):
        read_mesh(path)


def test_lines_and_points_among_the_faces_are_left_out(tmp_path: Path) -> None:
    mesh = read_mesh(saved(tmp_path / "a.ply", [[0, 1], [0, 5, 6, 7], [3]])).mesh
    assert torch.equal(mesh.faces, torch.tensor([[0, 5, 6], [0, 6, 7]], dtype=torch.int32))
