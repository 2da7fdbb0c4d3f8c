"""OBJ as exporters leave it: polygons with inlets, several libraries, faces with and without places in a texture."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.errors import InputError
from cltransfer.scenes.meshes import mesh_need
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.scenes.meshes.mtl import LIBRARY_LIMIT, ObjFiles
from cltransfer.scenes.meshes.obj_text import readable
from cltransfer.scenes.meshes.read_mesh import read_mesh

WALL = "v 0 0 0\nv 1.5 0 0\nv 1.5 2 0\nv 2.5 2 0\nv 2.5 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\n"
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
PLACED, BARE = "f 1/1/1 2/2/1 3/3/1\n", "f 1//1 3//1 4//1\n"


@pytest.fixture
def stage(tmp_path: Path, image_file: Callable[..., bytes]) -> Callable[..., Path]:
    """Writes stage.obj, and files of other names beside it; red.png and blue.png are images."""

    def write(text: str, **beside: str) -> Path:
        for name, color in (("red", (255, 0, 0)), ("blue", (0, 0, 255))):
            (tmp_path / f"{name}.png").write_bytes(image_file(np.full((2, 2, 3), color, np.uint8)))
        for name, library in beside.items():
            (tmp_path / f"{name}.mtl").write_text(library)
        (tmp_path / "stage.obj").write_text(text)
        return tmp_path / "stage.obj"

    return write


def shown(mesh: Mesh, at: tuple[float, float]) -> tuple[list[float], bool]:
    """Colour in [0, 1], or first pixel of the texture, and whether light falls on the face whose middle is ``at``."""
    middle = mesh.vertices[mesh.faces.long()].mean(1)[:, :2]
    face = int((middle - torch.tensor(at)).norm(dim=1).argmin())
    vertex = int(mesh.faces[face, 0])
    texture = int(mesh.texture[face])
    color: Tensor = mesh.colors[vertex] if texture < 0 else mesh.textures[texture][0, 0, :3] / 255
    return [round(c, 2) for c in color.tolist()], bool(mesh.shaded[face])


def test_a_mark_of_byte_order_is_no_part_of_the_first_line(stage: Callable[..., Path]) -> None:
    faces = "v 5 5 5\nusemtl red\nf 1/1 2/2 3/3\n"
    mesh = read_mesh(stage(f"\ufeff{SQUARE}mtllib look.mtl\n{faces}", look="\ufeffnewmtl red\nmap_Kd red.png\n")).mesh
    assert mesh.vertices[mesh.faces.long()].tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]]
    assert len(mesh.textures) == 1


def test_a_place_of_one_number_has_0_for_the_other(stage: Callable[..., Path]) -> None:
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nmtllib a.mtl\nusemtl red\nf 1/1 2/2 3/3\n"
    library = "newmtl red\nmap_Kd red.png\n"
    one, two = (
        read_mesh(stage("".join(f"vt {u}{v}\n" for u in (0.1, 0.5, 0.9)) + square, a=library)).mesh for v in ("", " 0")
    )
    assert torch.equal(one.uv, two.uv)
    assert torch.equal(one.texture, two.texture)


def test_spaces_behind_a_library_take_no_time(
    stage: Callable[..., Path], within: Callable[[float, float], bool]
) -> None:
    path = stage(f"mtllib a.mtl{' ' * 100_000}b.mtl  \n{SQUARE}f 1 2 3\n", a="# a\n", b="# b\n")
    begun = time.process_time()
    read_mesh(path)
    assert within(time.process_time() - begun, 5)  # a minute by a pattern that looks for their end from each of them


@pytest.mark.parametrize(
    ("first", "other", "read"),
    [
        ("v 1 2 3", "v 1 2 3", "v 1 2 3"),
        ("v 1 2 3 .1 .2 .3", "v 1 2 3 .1 .2 .3", "v 1 2 3 .1 .2 .3"),  # with its colour
        ("v 1 2 3 .1 .2 .3", "v 1 2 3 .1  .2 .3 1 1 ", "v 1 2 3 .1  .2 .3"),
        ("v 1 2 3 .1 .2 .3 ", "v 1 2 3 1", "v 1 2 3"),  # of which one has none
        ("v 1 2 3 1", "v 1 2  3 1 1", "v 1 2  3"),
        ("vt 1 2 3 4", "vt 1 2", "vt 1 2"),
        ("vt 1 2 3 4", "vt 1", "vt 1"),
        ("vn 1 2 3", "vn 1 2 3 4 5", "vn 1 2 3"),
    ],
)
def test_numbers_that_nobody_reads_are_cut_off(tmp_path: Path, first: str, other: str, read: str) -> None:
    text = readable(tmp_path, f"{first}\n{other}\n".encode(), ObjFiles(tmp_path / "a.obj")).decode()
    assert text.splitlines(keepends=True)[-1] == f"{read}\n"
    assert {len(line.split()) for line in text.split("\n")[:-1]} == {len(read.split())}


def test_vertices_of_many_uneven_numbers_take_no_more_than_was_estimated(
    stage: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [f"v {x} {y} 0" + " 1.5" * (5000 + x) for x, y in ((0, 0), (2, 0), (2, 2), (1, 1), (0, 2))]
    read_mesh(stage(WALL + "f 1 2 3\n"))  # what is imported by the first one takes more
    path = stage("\n".join(rows * 20) + "\nf 1 2 3 4 5\n")
    estimated: list[int] = []
    monkeypatch.setattr(mesh_need, "require_free", lambda need, *_: estimated.append(need))
    tracemalloc.start()
    try:
        assert len(read_mesh(path).mesh) == 3
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < estimated[-1]


@pytest.mark.parametrize("face", ["f 1 2 3", "f 1/1/1 2/2/1 3/3/1", "f 1 2 3 4"])
def test_a_remark_behind_numbers_is_passed_over(stage: Callable[..., Path], face: str) -> None:
    lines = [f"{line} # {line}" for line in SQUARE.splitlines()]
    bare, told = (read_mesh(stage("\n".join([*text, ""]))).mesh for text in ([SQUARE, face], [*lines, f"{face} # up"]))
    assert torch.equal(bare.vertices[bare.faces.long()], told.vertices[told.faces.long()])


TWO = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\n", "\n  "),
        (" ", "\t"),
        (" ", " \t "),
        ("v ", "v\t"),
        ("v 0 1 0", "v\t0\t1\t0"),
        ("v 0 1 0", " v 0 1 0"),
        ("v 1 0 0", "\tv 1 0 0"),
        ("f ", "f\t"),
        ("f 1 3 4", "  f 1 3 4"),
        ("f 1 3 4", "f\t1\t3\t4"),
        ("usemtl ", "usemtl\t"),
        ("usemtl", "  usemtl"),
        ("mtllib", "# mtllib is below\nmtllib"),
        ("mtllib", "  # mtllib is below\n\tmtllib"),
        ("usemtl blue", "usemtl blue\n# usemtl red (off)"),
        ("f 1 2 3", "# usemtl blue is below\nf 1 2 3"),
        ("f 1 2 3", "o usemtl blue\nf 1 2 3"),
        ("f 1 2 3", "fo 1\nf 1 2 3"),
    ],
)
def test_indents_tabs_and_remarks_change_nothing(stage: Callable[..., Path], old: str, new: str) -> None:
    library = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n"
    mesh = read_mesh(stage(TWO.replace(old, new), a=library)).mesh
    corners = mesh.vertices[mesh.faces.long()].tolist()
    assert sorted(corners) == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert (shown(mesh, LOWER), shown(mesh, UPPER)) == (([1, 0, 0], True), ([0, 0, 1], True))


UPPER, LOWER = (1 / 3, 2 / 3), (2 / 3, 1 / 3)  # middles of BARE and PLACED


@pytest.mark.parametrize(
    "face", ["f 1 2 3 4 5 6 7 8", "f -8 -7 -6 -5 -4 -3 -2 -1", "f 1 2 3 4 5 \\\n 6 7 8", "f 1 2 3 4 5 6 7 8 # door"]
)
def test_a_wall_keeps_its_door(stage: Callable[..., Path], face: str) -> None:
    for end in ("\n", "\r\n"):
        mesh = read_mesh(stage((WALL + face + "\nv 9 9 9\n").replace("\n", end))).mesh
        corners = mesh.vertices[mesh.faces.long()].double()
        normal = (corners[:, 1] - corners[:, 0]).cross(corners[:, 2] - corners[:, 0], dim=1)
        assert normal[:, 2].sum().item() / 2 == pytest.approx(10)
        assert bool((normal[:, 2] >= 0).all())


def test_the_triangles_of_a_polygon_have_its_places(stage: Callable[..., Path]) -> None:
    places = "".join(f"vt {line.split()[1]} {line.split()[2]}\n" for line in WALL.splitlines())
    face = "mtllib a.mtl\nusemtl A\nf " + " ".join(f"{i}/{i}" for i in range(1, 9)) + "\n"
    mesh = read_mesh(stage(WALL + places + face, a="newmtl A\nmap_Kd red.png\n")).mesh
    torch.testing.assert_close(mesh.uv * torch.tensor([1.0, -1.0]) + torch.tensor([0.0, 1.0]), mesh.vertices[:, :2])


def test_numbers_count_back_from_where_they_stand(stage: Callable[..., Path]) -> None:
    first = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n"
    second = first.replace("v 0 0 0", "v 9 0 0").replace("v 1 0 0", "v 10 0 0").replace("v 0 1 0", "v 9 1 0")
    for face in ("f -3 -2 -1\n", "f -3/-3/-1 -2/-2/-1 -1/-1/-1\n", "f -3//-1 -2//-1 -1//-1\n"):
        mesh = read_mesh(stage(first + face + second + face)).mesh
        middles = mesh.vertices[mesh.faces.long()].double().mean(1)[:, 0]
        assert sorted(middles.tolist()) == pytest.approx([1 / 3, 9 + 1 / 3])


SAME = "usemtl my A\n"


@pytest.mark.parametrize("order", [PLACED + BARE, BARE + PLACED, BARE + SAME + BARE + PLACED, PLACED + SAME + BARE])
def test_a_face_without_places_takes_the_texture_of_no_other(stage: Callable[..., Path], order: str) -> None:
    text = f"mtllib a.mtl\n{SQUARE}usemtl my A\n{order}"
    mesh = read_mesh(stage(text, a="newmtl B\nKd 0 1 0\nnewmtl my A\nKd 1 0.5 0\nmap_Kd red.png\n")).mesh
    assert shown(mesh, LOWER) == ([1, 0, 0], False)
    assert shown(mesh, UPPER) == ([1, 0.5, 0], True)


@pytest.mark.parametrize("libraries", ["mtllib a.mtl\nmtllib b.mtl\n", "mtllib a.mtl b.mtl\n"])
def test_every_library_counts(stage: Callable[..., Path], libraries: str) -> None:
    text = f"{libraries}{SQUARE}usemtl A\n{PLACED}usemtl B\nf 1/1 3/3 4/4\n"
    path = stage(text, a="newmtl A\nmap_Kd red.png\n", b="newmtl B\nmap_Kd blue.png\n")
    found = read_mesh(path)
    assert (shown(found.mesh, LOWER), shown(found.mesh, UPPER)) == (([1, 0, 0], False), ([0, 0, 1], False))
    assert {file.name for file in found.files} == {"stage.obj", "a.mtl", "b.mtl", "red.png", "blue.png"}


def test_a_library_s_name_may_have_spaces(stage: Callable[..., Path]) -> None:
    text = f"mtllib my a.mtl\nmtllib b.mtl\n{SQUARE}usemtl A\n{PLACED}usemtl B\n{BARE}"
    mesh = read_mesh(stage(text, **{"my a": "newmtl A\nmap_Kd red.png\n", "b": "newmtl B\nKd 0 0 1\n"})).mesh
    assert (shown(mesh, LOWER), shown(mesh, UPPER)) == (([1, 0, 0], False), ([0, 0, 1], True))


def test_what_is_wrong_in_any_library_is_told(stage: Callable[..., Path], tmp_path: Path) -> None:
    text = f"mtllib a.mtl\nmtllib b.mtl\n{SQUARE}usemtl B\n{PLACED}"
    path = stage(text, a="newmtl A\n", b="newmtl B\nmap_Kd none.png\n")
    (tmp_path / "none.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"b\.mtl: map_Kd: 'none.png' of material 'B' cannot be decoded"):
        read_mesh(path)
    with pytest.raises(InputError, match=r"uri: no such file 'gone\.mtl'"):
        read_mesh(stage(text.replace("b.mtl", "gone.mtl")))
    with pytest.raises(InputError, match=r"uri: names '\.\./b\.mtl'"):
        read_mesh(stage(text.replace("b.mtl", "../b.mtl")))
    half = "#" * (LIBRARY_LIMIT // 2) + "\n"
    with pytest.raises(InputError, match=f"mtllib: expected at most {LIBRARY_LIMIT} bytes, got"):
        read_mesh(stage(text, a=half, b=half))


def test_vertices_keep_their_colours_under_a_material_without_an_image(stage: Callable[..., Path]) -> None:
    rows = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0 1 0 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
    for face in (PLACED, BARE):
        text = f"mtllib a.mtl\n{rows}usemtl A\n{face}"
        mesh = read_mesh(stage(text, a="newmtl A\nKd 0.8 0.8 0.8\n")).mesh
        assert shown(mesh, LOWER) == ([1, 0, 0], False)
        with pytest.raises(InputError, match="all transparent"):
            read_mesh(stage(text, a="newmtl A\nd 0.2\n"))
    text = f"mtllib a.mtl\n{rows}usemtl A\n{PLACED}"
    assert shown(read_mesh(stage(text, a="newmtl A\nmap_Kd blue.png\n")).mesh, LOWER) == ([0, 0, 1], False)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (WALL + "f 1 2 3 4 9\n", "face 1: expected a number of the 8 vertices, which count from 1, got 9"),
        (WALL + "f 1 2 3 x\n", "which count from 1, got x"),
        ("v 0 0\nv 1 0\n" + WALL + "f 3 4 5 6\n", "vertices: expected three numbers or more of each"),
    ],
)
def test_polygons_that_cannot_be_are_told(stage: Callable[..., Path], text: str, line: str) -> None:
    with pytest.raises(InputError) as caught:
        read_mesh(stage(text))
    assert str(caught.value).endswith(line)


@pytest.mark.parametrize("number", ["99", "0", "-9", "x", "3.5", "9" * 5000])
def test_a_face_beyond_the_vertices_is_told_by_its_number(stage: Callable[..., Path], number: str) -> None:
    line = f"face 2: expected a number of the 4 vertices, which count from 1, got {number[:900]}"
    for corner in (number, f"{number}/1"):
        with pytest.raises(InputError) as caught:
            read_mesh(stage(f"{SQUARE}f 1 2 3\nf 1/1 2/2 {corner}  # 3\n"))
        assert line in str(caught.value)


def test_faces_are_counted_however_many_are_looked_at_together(
    stage: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"{readable.__module__}._TOGETHER", 2)
    with pytest.raises(InputError, match="face 5: expected"):
        read_mesh(stage(SQUARE + "f 1 2 3\n" * 4 + "f 1 2 9\n"))


@pytest.mark.parametrize("number", ["99", "0", "-9", "x"])
def test_a_place_that_is_not_there_is_told_where_a_texture_is_lost_with_it(
    stage: Callable[..., Path], number: str
) -> None:
    library, faces = "newmtl red\nmap_Kd red.png\n", f"usemtl red\n{PLACED}f 1//1 2//1 3/{number}/1\n"
    with pytest.raises(
        InputError, match=r"face 2: expected a number of the 4 places in a texture \(vt\), which count"
    ) as c:
        read_mesh(stage(f"mtllib look.mtl\n{SQUARE}{faces}", look=library))
    assert str(c.value).endswith(f"got {number}")


@pytest.mark.parametrize("number", ["99", "0"])
def test_a_place_that_is_not_there_harms_no_mesh_without_a_texture(stage: Callable[..., Path], number: str) -> None:
    assert len(read_mesh(stage(f"{SQUARE}f 1/1 2/2 3/{number}\n")).mesh) == 1
    bare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1/1 2/2 3/3\n"
    assert len(read_mesh(stage(f"mtllib look.mtl\n{bare}", look="newmtl red\n")).mesh) == 1


def test_a_file_of_faces_with_two_corners_has_no_faces(stage: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match="holds no faces"):
        read_mesh(stage(f"{SQUARE}f 1 2\n"))
