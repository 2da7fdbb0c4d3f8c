from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from PIL import EpsImagePlugin, Image

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.mesh import GREY
from cltransfer.scenes.meshes.moment import Moment
from cltransfer.scenes.meshes.read_mesh import read_mesh

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"
RGB = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
XYZ = "property float x\nproperty float y\nproperty float z\n"
PLACES = "property float s\nproperty float t\n"


def write_ply(path, rows, faces="3 0 1 2\n", count=1, vertices=3, more="") -> None:
    columns = "property float x\nproperty float y\nproperty float z\n" + more
    header = f"ply\nformat ascii 1.0\nelement vertex {vertices}\n{columns}"
    path.write_text(f"{header}element face {count}\nproperty list uchar int vertex_indices\nend_header\n{rows}{faces}")


def write_textured(folder, texture="wood.png") -> None:
    (folder / "stage.obj").write_text(
        "mtllib stage.mtl\nusemtl wood\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    (folder / "stage.mtl").write_text(f"newmtl wood\nKd 1 1 1\nmap_Kd {texture}\n")
    pixels = np.zeros((4, 2, 3), np.uint8)
    pixels[0] = [255, 0, 0]
    Image.fromarray(pixels).save(folder / "wood.png")


def test_an_obj_is_read_as_it_stands(tmp_path):
    (tmp_path / "stage.obj").write_text(OBJ)
    found = read_mesh(tmp_path / "stage.obj")
    corners = found.mesh.vertices[found.mesh.faces.long()]
    assert corners.tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]]]
    assert (found.subject, found.files) == (None, (tmp_path / "stage.obj",))
    assert bool(found.mesh.shaded.all())


def test_an_obj_brings_its_texture_the_right_way_up(tmp_path):
    write_textured(tmp_path)
    found = read_mesh(tmp_path / "stage.obj")
    mesh = found.mesh
    assert mesh.textures[0].shape == (4, 2, 4)
    assert mesh.textures[0][0, 0].tolist() == [255, 0, 0, 255]
    by_corner = {tuple(v): tuple(uv) for v, uv in zip(mesh.vertices.tolist(), mesh.uv.tolist())}
    assert by_corner == {(0, 0, 0): (0, 1), (1, 0, 0): (1, 1), (0, 1, 0): (0, 0)}  # v counts from the top here
    assert {file.name for file in found.files} == {"stage.obj", "stage.mtl", "wood.png"}


COLORS = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0], [255, 0, 255], [0, 255, 255]]
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]  # of the unit cube


def write_box(folder, materials) -> None:
    """A closed box whose sides are six squares of one texture, two rows of three; each corner is in three of them."""
    lines = ["mtllib box.mtl", *(f"v {i // 4} {i // 2 % 2} {i % 2}" for i in range(8))]
    for k, side in enumerate(SIDES):
        lines += [f"vt {(k % 3 + du) / 3} {(k // 3 + dv) / 2}" for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines += [f"usemtl m{k % materials}", "f " + " ".join(f"{v + 1}/{4 * k + i + 1}" for i, v in enumerate(side))]
    (folder / "box.obj").write_text("\n".join(lines) + "\n")
    (folder / "box.mtl").write_text("".join(f"newmtl m{i}\nmap_Kd atlas.png\n" for i in range(materials)))
    atlas = np.array(COLORS, np.uint8).reshape(2, 3, 3)[::-1]  # v counts from the bottom
    Image.fromarray(atlas.repeat(8, 0).repeat(8, 1)).save(folder / "atlas.png")


@pytest.mark.parametrize("materials", [1, 2])
def test_each_side_of_a_box_shows_its_own_part_of_the_texture(tmp_path, materials):
    write_box(tmp_path, materials)
    mesh = read_mesh(tmp_path / "box.obj").mesh
    assert mesh.texture.tolist() == [0] * 12
    corners, places = mesh.vertices[mesh.faces.long()], mesh.uv[mesh.faces.long()].mean(1)
    for points, (u, v) in zip(corners.tolist(), places.tolist()):
        found = {int(x * 4 + y * 2 + z) for x, y, z in points}
        side = next(k for k, side in enumerate(SIDES) if found <= set(side))
        assert mesh.textures[0][int(v * 16), int(u * 24), :3].tolist() == COLORS[side]


@pytest.mark.parametrize("place", ["1e30", "-2e6", "nan", "inf"])
def test_texture_coordinates_without_sense_are_refused(tmp_path, place):
    write_textured(tmp_path)
    text = (tmp_path / "stage.obj").read_text()
    (tmp_path / "stage.obj").write_text(text.replace("vt 1 0", f"vt {place} 0"))
    with pytest.raises(InputError, match=r"texture coordinates: expected at most 1e\+06 in size, got .* 0 at vertex 1"):
        read_mesh(tmp_path / "stage.obj")


def test_a_ply_keeps_its_colours(tmp_path):
    write_ply(tmp_path / "scan.ply", "0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 51\n", more=RGB)
    mesh = read_mesh(tmp_path / "scan.ply").mesh
    torch.testing.assert_close(mesh.colors, torch.tensor([[1.0, 0, 0], [0, 1, 0], [0, 0, 0.2]]))
    assert not mesh.shaded.any()


@pytest.mark.parametrize(
    ("kind", "row", "color"),
    [
        ("ushort", "65535 32768 0", [1, 128 / 255, 0]),
        ("float", "1 .5 0", [1, 128 / 255, 0]),
        ("int", "255 128 0", [1, 128 / 255, 0]),
    ],
)
def test_colours_of_a_ply_are_shares_of_what_their_type_holds(tmp_path, kind, row, color):
    columns = RGB.replace("uchar", kind)
    for more in (columns, PLACES + columns):
        rows = "".join(f"{place} {'0 0 ' * (more != columns)}{row}\n" for place in ("0 0 0", "1 0 0", "0 1 0"))
        write_ply(tmp_path / "scan.ply", rows, more=more)
        torch.testing.assert_close(read_mesh(tmp_path / "scan.ply").mesh.colors, torch.tensor([color] * 3))


def test_colours_of_a_ply_beyond_what_their_type_means_are_refused(tmp_path):
    for wrong in ("256", "-1"):
        rows = f"0 0 0 255 0 0\n1 0 0 0 {wrong} 0\n0 1 0 0 0 51\n"
        write_ply(tmp_path / "scan.ply", rows, more=RGB.replace("uchar", "int"))
        with pytest.raises(InputError, match=rf"scan.ply: element vertex: .* got {wrong} in a column of int32"):
            read_mesh(tmp_path / "scan.ply")


def test_a_face_of_a_ply_has_its_own_colour_to_its_edge(tmp_path):
    header = f"ply\nformat ascii 1.0\nelement vertex 4\n{XYZ}element face 2\nproperty list uchar int vertex_indices\n"
    rows = f"{RGB}end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
    (tmp_path / "scan.ply").write_text(f"{header}{rows}3 0 1 2 255 0 0\n3 0 2 3 0 51 0\n")
    mesh = read_mesh(tmp_path / "scan.ply").mesh
    torch.testing.assert_close(mesh.colors[mesh.faces.long()].amax(1), torch.tensor([[1.0, 0, 0], [0, 0.2, 0]]))
    torch.testing.assert_close(mesh.colors[mesh.faces.long()].amin(1), torch.tensor([[1.0, 0, 0], [0, 0.2, 0]]))
    assert mesh.vertices[mesh.faces[1].long()].tolist() == [[0, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert not mesh.shaded.any()
    (tmp_path / "scan.ply").write_text(f"{header}{rows}4 0 1 2 3 255 0 0\n3 0 2 3 0 51 0\n")
    mesh = read_mesh(tmp_path / "scan.ply").mesh
    torch.testing.assert_close(mesh.colors[mesh.faces.long()].amax(1)[:, 0], torch.tensor([1.0, 1.0, 0.0]))


@pytest.mark.parametrize("material", ["", "usemtl wood\n"])
def test_places_in_a_texture_that_is_not_there_change_nothing(tmp_path, material):
    text = OBJ.replace("f 1 2 3", f"vt 0 0\nvt 1 1\n{material}f 1/1 2/2 3/1").replace("f 1 2 4", "f 1/2 2/2 4/1")
    (tmp_path / "stage.obj").write_text(text)
    write_ply(tmp_path / "scan.ply", "0 0 0 0 0\n1 0 0 1 0\n0 1 0 1 1\n", more=PLACES)
    for name in ("stage.obj", "scan.ply"):
        mesh = read_mesh(tmp_path / name).mesh
        assert (mesh.textures, bool(mesh.shaded.all())) == ((), True)
        assert mesh.colors.unique().tolist() == [pytest.approx(GREY)]


def test_colours_beside_places_in_a_texture_that_is_not_there_are_kept(tmp_path):
    rows = "0 0 0 .5 .5 255 0 0\n1 0 0 0 0 0 255 0\n0 1 0 .5 .5 0 0 255\n"
    write_ply(tmp_path / "scan.ply", rows, more=PLACES + RGB)
    (tmp_path / "scan.obj").write_text(
        "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvt 1 0\nvt 0 0\nf 1/1 2/2 3/1\nf 1/2 2/1 3/1\n"
    )
    for name in ("scan.ply", "scan.obj"):
        mesh = read_mesh(tmp_path / name).mesh
        assert not mesh.shaded.any()
        for corners, colors in zip(mesh.vertices[mesh.faces.long()], mesh.colors[mesh.faces.long()]):
            assert corners.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
            assert colors.tolist() == np.eye(3).tolist()


def test_a_ply_shows_the_texture_that_it_names(tmp_path):
    write_textured(tmp_path)
    write_ply(tmp_path / "scan.ply", "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n", more=PLACES)
    text = (tmp_path / "scan.ply").read_text().replace("element vertex", "comment TextureFile wood.png\nelement vertex")
    (tmp_path / "scan.ply").write_text(text)
    assert read_mesh(tmp_path / "scan.ply").mesh.textures[0][0, 0].tolist() == [255, 0, 0, 255]
    (tmp_path / "wood.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match="images: a texture cannot be decoded"):
        read_mesh(tmp_path / "scan.ply")


def test_node_transforms_are_applied_and_the_skin_posed(bar, write_glb, write_gltf, tmp_path):
    for name, write in (("bar.glb", write_glb), ("bar.gltf", write_gltf)):
        mesh = read_mesh(write(tmp_path / name, *bar()), Moment(1.0)).mesh
        assert len(mesh) == 2
        torch.testing.assert_close(mesh.vertices.mean(0), torch.tensor([9.5, 0.5, 0.0]), atol=1e-5, rtol=0)
        assert not mesh.label.any()  # two joints are no person


@pytest.mark.parametrize("node", [0, 2])
def test_a_mesh_on_or_below_the_node_of_a_camera_is_there(bar, write_glb, tmp_path, node):
    tree, blob = bar()
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.5}}]
    tree["nodes"][2]["mesh"] = 0
    tree["nodes"][node]["camera"] = 0
    del tree["nodes"][3]["mesh"]
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    torch.testing.assert_close(mesh.vertices.mean(0), torch.tensor([10.0, 2, 0]))


def test_a_gltf_reads_its_buffer_from_a_file_beside_it(bar, write_gltf, tmp_path):
    tree, blob = bar()
    (tmp_path / "bar.bin").write_bytes(blob)
    found = read_mesh(write_gltf(tmp_path / "bar.gltf", tree, blob, "bar.bin"))
    assert [file.name for file in found.files] == ["bar.gltf", "bar.bin"]


def test_base_colours_are_shown_as_a_screen_does(bar, write_glb, tmp_path):
    tree, blob = bar()
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [0.6, 1, 0, 1]}}]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    for unlit in (False, True):
        if unlit:
            tree["materials"][0]["extensions"] = {"KHR_materials_unlit": {}}
        mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
        torch.testing.assert_close(mesh.colors[0], torch.tensor([0.7977, 1, 0]), atol=1e-4, rtol=0)
        assert bool(mesh.shaded.any()) is not unlit


@pytest.mark.parametrize(
    "uri", ["../secret.bin", "/etc/hostname", "file:///etc/hostname", "https://a.b/c", "a\\..\\..\\b"]
)
def test_files_outside_the_folder_are_not_opened(bar, write_gltf, tmp_path, uri):
    (tmp_path / "secret.bin").write_bytes(b"\0" * 4096)
    (tmp_path / "in").mkdir()
    path = write_gltf(tmp_path / "in" / "bar.gltf", *bar(), uri)
    with pytest.raises(InputError, match=r"bar.gltf: uri: names .* \(expected a file in this folder or below\)"):
        read_mesh(path)
    tree, blob = bar()
    tree["images"] = [{"uri": uri}]
    with pytest.raises(InputError, match="expected a file in this folder"):
        read_mesh(write_gltf(tmp_path / "in" / "bar.gltf", tree, blob))


def test_a_link_out_of_the_folder_is_not_followed(bar, write_gltf, tmp_path):
    tree, blob = bar()
    (tmp_path / "secret.bin").write_bytes(blob)
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "bar.bin").symlink_to(tmp_path / "secret.bin")
    with pytest.raises(InputError, match="is a link out of the folder"):
        read_mesh(write_gltf(tmp_path / "in" / "bar.gltf", tree, blob, "bar.bin"))


@pytest.mark.parametrize("texture", ["../wood.png", "/etc/hostname", "gone.png"])
def test_an_obj_whose_texture_is_elsewhere_is_refused(tmp_path, texture):
    (tmp_path / "in").mkdir()
    write_textured(tmp_path / "in", texture)
    write_textured(tmp_path)
    with pytest.raises(InputError, match=r"uri: (names|no such file)"):
        read_mesh(tmp_path / "in" / "stage.obj")


def test_a_few_broken_vertices_cost_their_faces_and_many_the_file(tmp_path, caplog):
    rows = [f"{i % 20} {i // 20} 0" for i in range(200)]
    rows[7] = "nan 0 0"
    faces = "".join(f"3 {i} {i + 1} {i + 20}\n" for i in range(100))
    write_ply(tmp_path / "scan.ply", "\n".join(rows) + "\n", faces, 100, 200)
    mesh = read_mesh(tmp_path / "scan.ply").mesh
    assert len(mesh) == 98
    told = "1 of 200 vertices are not finite: 2 faces of theirs are left out"
    assert caplog.messages == [f"{tmp_path / 'scan.ply'}: {told}"]
    assert bool(mesh.vertices.isfinite().all())
    rows[8:12] = ["nan nan nan"] * 4
    write_ply(tmp_path / "scan.ply", "\n".join(rows) + "\n", faces, 100, 200)
    with pytest.raises(InputError, match=r"vertices: [23]% are not finite"):
        read_mesh(tmp_path / "scan.ply")


def test_bad_files_are_one_line(bar, write_glb, tmp_path):
    whole = write_glb(tmp_path / "whole.glb", *bar()).read_bytes()
    text = json.dumps({"asset": {"version": "2.0"}})
    cases = {
        "gone.glb": (None, "no such file"),
        "empty.glb": (b"", "file is empty"),
        "cut.glb": (whole[:900], "cut off: expected"),
        "head.glb": (whole[:10], "cut off"),
        "text.glb": (b"hello there, this is no mesh at all", "expected glTF"),
        "none.gltf": (text.encode(), "meshes: holds no mesh"),
        "old.gltf": (text.replace("2.0", "1.0").encode(), "version 2"),
        "draco.gltf": (
            json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco"]}).encode(),
            "KHR_draco",
        ),
        "points.obj": (b"v 0 0 0\nv 1 1 1\n", "holds no faces|cannot be read as obj"),
        "flat.obj": (b"v 0 0\nv 1 0\nv 1 1\nf 1 2 3\n", "vertices: expected three numbers of each, got 2"),
        "short.obj": (b"v 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", "vertices: expected three numbers of each, got 2"),
        "noise.obj": (bytes(range(256)) * 4, "holds no faces|cannot be read as obj"),
        "vast.ply": (b"ply\nformat ascii 1.0\nelement vertex 9999999999\nend_header\n", "asks for more than the file"),
        "cut.ply": (b"ply\nformat ascii 1.0\nelement ver", "expected a PLY header"),
        "mesh.stl": (b"solid", "no mesh has the suffix '.stl'"),
    }
    for name, (data, reason) in cases.items():
        if data is not None:
            (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=reason) as error:
            read_mesh(tmp_path / name)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("kind", "entry", "reason"),
    [
        ("accessors", {"count": 10**12}, "expected 1 to 20000000 rows"),
        ("accessors", {"count": 5000}, "rows do not fit|cannot be read"),
        ("accessors", {"bufferView": 77}, "has no entry 77"),
        ("buffers", {"byteLength": 10**12}, "expected 1 to"),
        ("buffers", {"byteLength": 10**6}, "cut off: expected 1000000 bytes"),
    ],
)
def test_absurd_counts_are_refused_before_memory_is_taken(bar, write_glb, tmp_path, kind, entry, reason):
    tree, blob = bar()
    tree[kind][0].update(entry)
    with pytest.raises(InputError, match=reason):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


@pytest.mark.parametrize(("kind", "numbers"), [("SCALAR", 1), ("VEC2", 2), ("VEC4", 4)])
def test_vertices_of_another_number_of_axes_are_refused(builder, write_glb, tmp_path, kind, numbers):
    made = builder()
    position = made.add(np.zeros((6, numbers)), kind=kind)
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": position}}]}],
        "accessors": made.accessors,
        "bufferViews": made.views,
        "buffers": [{"byteLength": len(made.blob)}],
    }
    with pytest.raises(InputError, match=f"vertices: expected three numbers of each, got {numbers} .*VEC3"):
        read_mesh(write_glb(tmp_path / "flat.glb", tree, made.blob))


def mutated(tree, random):
    """The same JSON with one value replaced or removed."""
    copy = json.loads(json.dumps(tree))
    at = copy
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        key = keys[random.integers(len(keys))]
        below = at[key]
        if isinstance(below, (dict, list)) and below and random.random() < 0.85:
            at = below
            continue
        junk = [None, -1, 10**9, 3.5, "x", [], {}, [[]], True, float("nan")]
        choice = random.integers(len(junk) + 1)
        if choice == len(junk):
            del at[key]
        else:
            at[key] = junk[choice]
        return copy


def test_whatever_stands_in_the_json_is_read_or_refused_in_one_line(bar, write_glb, tmp_path):
    tree, blob = bar()
    random = np.random.default_rng(0)
    refused: list[str] = []
    for _ in range(300):
        path = write_glb(tmp_path / "bar.glb", mutated(tree, random), blob)
        try:
            assert len(read_mesh(path, Moment(0.7)).mesh) > 0
        except InputError as error:
            refused.append(str(error))
    assert 100 < len(refused) < 300
    assert not any("\n" in line for line in refused)


def test_holes_are_where_the_material_masks(bar, with_texture, image_file, write_glb, tmp_path):
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[0, 0, 3] = 60
    picture = image_file(pixels)
    tree, blob = with_texture(bar(), picture)
    for mode, cutoff, alpha in (("OPAQUE", 0.5, 255), ("MASK", 0.5, 0), ("MASK", 0.1, 255), ("BLEND", 0.5, 0)):
        tree["materials"][0].update({"alphaMode": mode, "alphaCutoff": cutoff})
        texture = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh.textures[0]
        assert int(texture[0, 0, 3]) == alpha
        assert int(texture[1, 1, 3]) == 255
    damaged = blob[: -len(picture)] + b"no picture".ljust(len(picture))
    with pytest.raises(InputError, match="images: a texture cannot be decoded"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, damaged))


POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 4 4\n%%EndComments\nshowpage\n%%EOF\n"


@pytest.fixture
def ghostscript(tmp_path, monkeypatch):
    """A folder that has a file in it once Ghostscript was started."""
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "gs"
    program.write_text(f"#!/bin/sh\ntouch '{tmp_path}/bin/started'\necho 10.03.1\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")
    monkeypatch.setattr(EpsImagePlugin, "gs_binary", None)
    return program.parent


@pytest.mark.parametrize("kind", ["EPS", "TIFF"])
def test_only_usual_image_formats_are_decoded(bar, with_texture, image_file, write_glb, tmp_path, ghostscript, kind):
    write_textured(tmp_path)
    data = POSTSCRIPT if kind == "EPS" else image_file(np.zeros((2, 2, 3), np.uint8), kind)
    (tmp_path / "wood.png").write_bytes(data)
    with pytest.raises(InputError, match=rf"texture: {kind} is not read \(expected PNG, JPEG, WEBP\)"):
        read_mesh(tmp_path / "stage.obj")
    glossy = {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {"index": 0}}}}
    for material in ({}, glossy):
        with pytest.raises(InputError, match=r"images: a texture cannot be decoded \(expected PNG, JPEG, WEBP\)"):
            read_mesh(write_glb(tmp_path / "bar.glb", *with_texture(bar(), data, **material)))
    assert [file.name for file in ghostscript.iterdir()] == ["gs"]


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_the_usual_image_formats_are_read_and_what_no_material_shows_is_not(
    bar, with_texture, image_file, write_glb, tmp_path, kind
):
    pixels = np.full((16, 16, 3), (250, 100, 0), np.uint8)
    tree, blob = with_texture(bar(), image_file(pixels, kind))
    tree["images"].append({"bufferView": 0})  # a map of normals, say, in a format that is not read
    texture = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh.textures[0]
    assert (texture[8, 8, :3].int() - torch.tensor([250, 100, 0])).abs().max() < 8


def test_real_files_have_their_known_sizes(data):
    for name, faces, height in (("pc_vr-gallery.glb", 1930, 5.05), ("makehuman_male_body.obj", 26756, 1.748)):
        mesh = read_mesh(data / name).mesh
        assert len(mesh) == faces
        size = mesh.vertices.amax(0) - mesh.vertices.amin(0)
        assert float(size[1]) == pytest.approx(height, abs=0.01)
    assert any((image[..., 3] == 0).any() for image in read_mesh(data / "pc_house.glb").mesh.textures)
