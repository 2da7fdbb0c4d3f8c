"""What is black but for its light is drawn in the colour of that; of other light a line tells."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from kornia.color import linear_rgb_to_rgb
from PIL import Image

from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.meshes import mtl, textures
from cltransfer.scenes.meshes.read_mesh import read_mesh
from cltransfer.scenes.meshes.textures import decodes

BLACK = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}}
LIGHT = [1, 0.5, 0.2]
TOLD = "light is not read, what shines is drawn in its other colours alone"


def shown(linear):
    return linear_rgb_to_rgb(torch.tensor(linear)[:, None, None].float())[:, 0, 0]


def painted_with(made, **material):
    tree, blob = made
    tree["materials"] = [material]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    return tree, blob


@pytest.mark.parametrize(
    ("strength", "light"), [(None, LIGHT), (0.5, [0.5, 0.25, 0.1]), (8, LIGHT), (1e9, LIGHT), (0, [0, 0, 0])]
)
def test_a_black_material_is_as_bright_as_its_light(bar, write_glb, tmp_path, caplog, strength, light):
    extensions = {} if strength is None else {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    made = painted_with(bar(), **BLACK, emissiveFactor=LIGHT, extensions=extensions)
    made[0]["extensionsRequired"] = [*extensions]
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", *made), person=False).mesh
    torch.testing.assert_close(mesh.colors[0], shown(light), atol=1e-4, rtol=0)
    assert bool(mesh.shaded.any()) == (strength == 0)
    assert caplog.messages == []


@pytest.mark.parametrize("mode", ["OPAQUE", "MASK"])
def test_a_black_material_shows_the_image_of_its_light(bar, with_texture, image_file, write_glb, tmp_path, mode):
    pixels = np.full((2, 2, 3), (250, 120, 0), np.uint8)
    lamp = {**BLACK, "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}, "alphaMode": mode}
    tree, blob = with_texture(bar(), image_file(pixels), **lamp)
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    assert mesh.textures[0][0, 0].tolist() == [250, 120, 0, 255]
    assert mesh.colors.unique().tolist() == [1]
    assert not mesh.shaded.any()


@pytest.mark.parametrize("mode", ["OPAQUE", "MASK", "BLEND"])
def test_the_alpha_of_a_light_makes_no_holes(bar, with_texture, image_file, write_glb, tmp_path, caplog, mode):
    pixels = np.full((2, 2, 4), (250, 120, 0, 0), np.uint8)
    lamp = {**BLACK, "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}, "alphaMode": mode}
    made = with_texture(bar(), image_file(pixels), **lamp)
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", *made), person=False).mesh
    assert mesh.textures[0].reshape(-1, 4).unique(dim=0).tolist() == [[250, 120, 0, 255]]
    assert caplog.messages == []


def test_the_alpha_of_an_image_that_is_colour_and_light_makes_its_holes(
    bar, with_texture, image_file, write_glb, tmp_path
):
    pixels = np.full((1, 2, 4), 250, np.uint8)
    pixels[0, 1, 3] = 0
    lamp = {"baseColorFactor": [0, 0, 0, 1], "baseColorTexture": {"index": 0}}
    tree, blob = with_texture(bar(), image_file(pixels), pbrMetallicRoughness=lamp, emissiveFactor=[1, 1, 1])
    tree["materials"][0].update({"alphaMode": "MASK", "emissiveTexture": {"index": 0}})
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    assert mesh.textures[0][0, :, 3].tolist() == [255, 0]
    assert not mesh.shaded.any()


@pytest.mark.parametrize(("mode", "faces"), [("OPAQUE", 2), ("MASK", 0), ("BLEND", 0)])
def test_a_light_is_as_opaque_as_its_material(bar, with_texture, image_file, write_glb, tmp_path, mode, faces):
    lamp = {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}, "alphaMode": mode}
    base = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 0]}}
    made = with_texture(bar(), image_file(np.full((2, 2, 3), 250, np.uint8)), **base, **lamp)
    path = write_glb(tmp_path / "bar.glb", *made)
    if faces:
        mesh = read_mesh(path).mesh
        assert (len(mesh), mesh.textures[0].min()) == (faces, 250)
    else:
        with pytest.raises(InputError, match="holds no faces"):
            read_mesh(path)


def test_colours_of_vertices_do_not_change_a_light(bar, write_glb, tmp_path):
    tree, blob = painted_with(bar(), **BLACK, emissiveFactor=LIGHT)
    tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 0  # the positions are as good
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    torch.testing.assert_close(mesh.colors, shown(LIGHT).expand(4, 3), atol=1e-4, rtol=0)


@pytest.mark.parametrize(
    "base",
    [
        {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}},
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 0, 0, 1]}}},
    ],
)
def test_light_that_is_not_added_to_a_colour_is_told(bar, write_glb, tmp_path, caplog, base):
    path = write_glb(tmp_path / "bar.glb", *painted_with(bar(), **base, name="lamp", emissiveFactor=LIGHT))
    assert bool(read_mesh(path, person=False).mesh.shaded.all())
    assert caplog.messages == [f"{path}: emission of material 'lamp': {TOLD}"]
    caplog.clear()
    tree, blob = painted_with(bar(), **base, emissiveFactor=LIGHT)
    tree["materials"] += [{"emissiveFactor": LIGHT}]  # nothing shows it
    for more in ({"emissiveFactor": [0, 0, 0]}, {"extensions": {"KHR_materials_unlit": {}}}):
        tree["materials"][0].update(more)
        read_mesh(write_glb(path, tree, blob), person=False)
    assert caplog.messages == []


def test_holes_of_a_black_material_are_kept(bar, with_texture, image_file, write_glb, tmp_path, caplog):
    pixels = np.zeros((1, 2, 4), np.uint8)
    pixels[0, 0, 3] = 255
    lamp = {"baseColorFactor": [0, 0, 0, 1], "baseColorTexture": {"index": 0}}
    tree, blob = with_texture(bar(), image_file(pixels), pbrMetallicRoughness=lamp, emissiveFactor=LIGHT)
    tree["materials"][0]["alphaMode"] = "MASK"
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob), person=False).mesh
    assert mesh.textures[0][0, :, 3].tolist() == [255, 0]
    assert caplog.messages == [f"{tmp_path / 'bar.glb'}: emission of material '0': {TOLD}"]


@pytest.mark.parametrize("factor", [[1, 1], [1, 1, float("inf")], [1, 1, 1, 1]])
def test_a_light_of_no_three_numbers_is_refused(bar, write_glb, tmp_path, factor):
    made = painted_with(bar(), **BLACK, emissiveFactor=factor)
    with pytest.raises(InputError, match=r"bar.glb: materials: expected emission of three finite numbers, got"):
        read_mesh(write_glb(tmp_path / "bar.glb", *made))


FACE = "mtllib stage.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl lamp\nf 1/1 2/2 3/3\n"


@pytest.fixture
def stage(tmp_path, image_file):
    def write(library, face=FACE):
        (tmp_path / "wood.png").write_bytes(image_file(np.full((4, 2, 3), 90, np.uint8)))
        (tmp_path / "none.png").write_bytes(b"no picture")
        (tmp_path / "stage.mtl").write_text(library)
        (tmp_path / "stage.obj").write_text(face)
        return tmp_path / "stage.obj"

    return write


@pytest.mark.parametrize(
    ("said", "color"),
    [
        ("Kd 0 0 0\nKe 1 0.5 0.2", [1, 0.5, 0.2]),
        ("KE 4 2 0\nKD 0", [1, 0.5, 0]),
        ("Kd 1 1 1\nKe .5\nKd 0 0 0", [0.5] * 3),
    ],
)
def test_a_black_material_of_a_library_has_the_colour_of_its_light(stage, caplog, said, color):
    mesh = read_mesh(stage(f"newmtl other\nKd 1 0 0\nnewmtl lamp\n{said}\n")).mesh
    torch.testing.assert_close(mesh.colors, torch.tensor([color] * 3), atol=3e-3, rtol=0)
    assert not mesh.shaded.any()
    assert caplog.messages == []


def test_a_black_material_of_a_library_shows_the_image_of_its_light(stage):
    file = read_mesh(stage("newmtl lamp\nKd 0 0 0\nmap_Ke -s 2 2 wood.png\n"))
    assert file.mesh.textures[0].shape == (4, 2, 4)
    assert file.mesh.uv.max() == 2
    assert [one.name for one in file.files] == ["stage.obj", "stage.mtl", "wood.png"]


@pytest.mark.parametrize("image", ["none.png", "gone.png", "sky.exr", "../wood.png", "wood.tga", "maps", "cut.png"])
@pytest.mark.parametrize("library", ["stage.mtl", "stage.mtl more.mtl"])
def test_a_light_whose_image_cannot_be_read_is_told_and_not_shown(stage, tmp_path, caplog, image, library):
    path = stage(f"newmtl lamp\nKd 0 0 0\nKe 1 1 1\nmap_Ke -s 2 2 {image}\n", FACE.replace("stage.mtl", library))
    (tmp_path / "more.mtl").write_text("newmtl other\nKd 1 0 0\n")
    (tmp_path / "sky.exr").write_bytes(b"v/1\x01")
    (tmp_path / "maps").mkdir()
    (tmp_path / "cut.png").write_bytes((tmp_path / "wood.png").read_bytes()[:-30])
    Image.new("RGB", (2, 2)).save(tmp_path / "wood.tga")
    file = read_mesh(path)
    assert (file.mesh.colors.unique().tolist(), file.mesh.textures) == ([0], ())
    assert bool(file.mesh.shaded.all())
    assert [one.name for one in file.files] == ["stage.obj", *library.split()]
    assert caplog.messages == [f"{tmp_path / 'stage.mtl'}: Ke of material 'lamp': {TOLD}"]


def test_the_image_of_a_light_is_looked_for_beside_the_mesh(stage, tmp_path):
    path = stage("", FACE.replace("stage.mtl", "maps/stage.mtl"))
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "stage.mtl").write_text("newmtl lamp\nKd 0 0 0\nmap_Ke wood.png\n")
    assert read_mesh(path).mesh.textures[0].shape == (4, 2, 4)


def test_an_image_that_many_materials_shine_by_is_tried_once(stage, monkeypatch):
    tried = []
    monkeypatch.setattr(mtl, "decodes", lambda path: tried.append(path.name) or decodes(path))
    lamp = "newmtl lamp{}\nKd 0 0 0\nmap_Ke {}\n"
    spellings = ["wood.png", "./wood.png", "-s 2 2 wood.png", ".\\wood.png", "none.png", "./none.png"]
    read_mesh(stage("".join(lamp.format(i, name) for i, name in enumerate(spellings))))
    assert tried == ["wood.png", "none.png"]


def test_an_image_that_a_material_shines_by_is_held_against_the_memory(stage, monkeypatch):
    path = stage("newmtl lamp\nKd 0 0 0\nmap_Ke wood.png\n")
    monkeypatch.setattr(textures, "PIXEL_BYTES", 2**20)
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**22)
    with pytest.raises(ResourceError, match=r"wood\.png: memory: a texture's 2x4 pixels need 8 MB, 4 MB are free"):
        read_mesh(path)


@pytest.mark.parametrize("said", ["Kd 0 0 0", "Kd 0 0 0\nKe 0 0 0\nmap_Ke wood.png", "Kd 0 0 0\nKe bright"])
def test_a_black_material_of_a_library_without_light_is_black(stage, caplog, said):
    mesh = read_mesh(stage(f"newmtl lamp\n{said}\n")).mesh
    assert mesh.colors.unique().tolist() == [0]
    assert bool(mesh.shaded.all())
    assert caplog.messages == []


def test_light_of_a_library_that_is_not_added_is_told(stage, caplog):
    path = stage("newmtl lamp\nKd 0 0 0\nmap_Kd wood.png\nKe 1 1 1\nnewmtl spare\nKd 1 0 0\nKe 1 1 1\n")
    assert read_mesh(path).mesh.textures[0].shape == (4, 2, 4)
    assert caplog.messages == [f"{path.with_suffix('.mtl')}: Ke of material 'lamp': {TOLD}"]


def test_two_libraries_shine_as_one_does(stage, tmp_path):
    path = stage("newmtl lamp\nKd 0 0 0\nKe 0 1 0\n", FACE.replace("stage.mtl", "stage.mtl more.mtl"))
    (tmp_path / "more.mtl").write_text("newmtl other\nKd 1 0 0\n")
    mesh = read_mesh(path).mesh
    assert mesh.colors.tolist() == [[0, 1, 0]] * 3
    assert not mesh.shaded.any()


def test_a_material_of_a_library_begins_with_a_name(stage, caplog):
    mesh = read_mesh(stage("newmtl lamp\nKe 0 1 0\nnewmtl\nKd 0 0 0\n")).mesh
    assert mesh.colors.tolist() == [[0, 1, 0]] * 3
    assert caplog.messages == []
    path = stage("newmtl lamp\nKd 1 0 0\nnewmtl\nKe 1 1 1\n")
    read_mesh(path)
    assert caplog.messages == [f"{path.with_suffix('.mtl')}: Ke of material 'lamp': {TOLD}"]
