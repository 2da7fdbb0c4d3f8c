from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.meshes import textures
from cltransfer.scenes.meshes.asset_files import Beside
from cltransfer.scenes.meshes.gltf_file import read_gltf
from cltransfer.scenes.meshes.gltf_images import shown_images
from cltransfer.scenes.meshes.read_mesh import read_mesh
from cltransfer.scenes.meshes.textures import PIXEL_BYTES

GLOSSY = {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {"index": 0}}}}


@pytest.fixture
def decoded(monkeypatch):
    """Sizes of the images that were decoded."""
    sizes: list[tuple[int, int]] = []
    convert = Image.Image.convert
    monkeypatch.setattr(Image.Image, "convert", lambda image, mode: sizes.append(image.size) or convert(image, mode))
    return sizes


@pytest.fixture
def picture(image_file):
    return lambda size=(4, 4): image_file(np.full((*size[::-1], 3), (200, 100, 0), np.uint8))


@pytest.fixture
def write_obj():
    """Writes a.obj, a face of each of its materials, which all show wood.png."""

    def write(folder: Path, materials: int = 1) -> Path:
        (folder / "a.mtl").write_text("".join(f"newmtl m{i}\nmap_Kd wood.png\n" for i in range(materials)))
        corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
        faces = "".join(f"usemtl m{i}\nf 1/1 2/2 3/3\n" for i in range(materials))
        (folder / "a.obj").write_text(f"mtllib a.mtl\n{corners}{faces}")
        return folder / "a.obj"

    return write


def test_an_image_of_many_nodes_and_materials_is_decoded_once(bar, with_texture, picture, write_glb, tmp_path, decoded):
    tree, blob = with_texture(bar(), picture())
    primitive = tree["meshes"][0]["primitives"][0]
    tree["meshes"][0]["primitives"].append({**primitive, "material": 1})
    tree["materials"].append({**tree["materials"][0], "alphaMode": "OPAQUE"})
    tree["nodes"] += [{"mesh": 0}, {"mesh": 0}]
    tree["scenes"][0]["nodes"] += [4, 5]
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    assert len(mesh) == 12
    assert mesh.texture.tolist() == [0] * 12
    assert len(mesh.textures) == 1
    assert decoded == [(4, 4)]


def test_an_image_under_many_samplers_is_decoded_and_packed_once(
    bar, with_texture, picture, write_glb, tmp_path, decoded
):
    tree, blob = with_texture(bar(), picture())
    (primitive,) = tree["meshes"][0]["primitives"]
    tree["samplers"] = [{"wrapS": s, "wrapT": t} for s in (10497, 33071, 33648) for t in (10497, 33071, 33648)]
    tree["textures"] = [{"source": 0, "sampler": i} for i in range(9)]
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(9)]
    tree["meshes"][0]["primitives"] = [{**primitive, "material": i} for i in range(9)]
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    assert (len(set(mesh.wraps)), len(mesh.packed.images), len(mesh.packed.texels)) == (9, 9, 16)
    assert decoded == [(4, 4)]


def test_an_image_of_many_materials_of_an_obj_is_decoded_once(picture, write_obj, tmp_path, decoded):
    (tmp_path / "wood.png").write_bytes(picture())
    mesh = read_mesh(write_obj(tmp_path, materials=3)).mesh
    assert (mesh.texture.tolist(), len(mesh.textures)) == ([0, 0, 0], 1)
    assert decoded == [(4, 4)]


def test_too_many_pixels_are_refused_before_any_is_decoded(
    bar, with_texture, picture, write_glb, tmp_path, monkeypatch, decoded
):
    path = write_glb(tmp_path / "bar.glb", *with_texture(bar(), picture((400, 300))))
    for name, said in (("IMAGE_LIMIT", "texture: .* got 400x300"), ("TOTAL_LIMIT", "textures: .* in all, got 120000")):
        with monkeypatch.context() as patch:
            patch.setattr(textures, name, 119_999)
            with pytest.raises(InputError, match=said):
                read_mesh(path)
    monkeypatch.setattr(memory, "free_bytes", lambda: PIXEL_BYTES * 120_000 - 1)
    with pytest.raises(ResourceError, match=r"memory: textures of 120000 pixels need .* make the textures smaller"):
        read_mesh(path)
    assert decoded == []


def test_a_texture_whose_header_is_huge_is_told_the_limit(bar, with_texture, picture, write_glb, tmp_path):
    data = bytearray(picture())
    data[16:24] = struct.pack(">II", 60000, 60000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    line = r"texture: expected at most 67108864 pixels, got more \(make the textures smaller\)"
    with pytest.raises(InputError, match=line):
        read_mesh(write_glb(tmp_path / "bar.glb", *with_texture(bar(), bytes(data))))


def test_materials_that_trimesh_turns_into_base_colours_are_held_against_the_memory(
    bar, with_texture, picture, write_glb, tmp_path, monkeypatch
):
    path = write_glb(tmp_path / "bar.glb", *with_texture(bar(), picture((64, 64)), **GLOSSY))
    assert [image.shape for image in read_mesh(path).mesh.textures] == [(64, 64, 4)]
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**20)
    with pytest.raises(ResourceError, match="memory: materials of KHR_materials_pbrSpecularGlossiness need 1 MB"):
        read_mesh(path)


def test_a_file_is_read_where_there_is_memory_for_it(picture, write_obj, tmp_path, monkeypatch):
    (tmp_path / "wood.png").write_bytes(picture() + bytes(2**20))
    path = write_obj(tmp_path)
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**19)
    with pytest.raises(ResourceError, match=r"wood.png: memory: its bytes need 1 MB, 0 MB are free"):
        read_mesh(path)


def test_sixteen_bits_of_grey_are_as_bright_as_eight(write_obj, tmp_path):
    Image.fromarray(np.array([[0, 30000], [257, 65535]], np.uint16)).save(tmp_path / "wood.png")
    (pixels,) = read_mesh(write_obj(tmp_path)).mesh.textures
    assert pixels[..., 0].tolist() == [[0, 117], [1, 255]]


def test_an_alpha_that_is_no_share_is_refused(bar, with_texture, picture, write_glb, tmp_path):
    tree, blob = with_texture(bar(), picture())
    for cutoff in (float("nan"), -0.1, "half"):
        tree["materials"][0].update({"alphaMode": "MASK", "alphaCutoff": cutoff})
        with pytest.raises(InputError, match=r"materials: expected an alphaCutoff of 0 or more, got"):
            read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


def with_images(made, views):
    """An image for each of ``views``, with a texture and a material that shows it, which no mesh has."""
    tree, blob = made
    tree["images"] = [{"bufferView": view, "mimeType": "image/png"} for view in views]
    tree["textures"] = [{"source": i} for i in range(len(views))]
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(len(views))]
    return tree, blob


def test_many_images_in_one_place_of_a_file_are_copied_once(bar, with_texture, picture, write_glb, tmp_path):
    tree, blob = with_texture(bar(), picture() + bytes(2**20))
    path = write_glb(tmp_path / "bar.glb", *with_images((tree, blob), [len(tree["bufferViews"]) - 1] * 64))
    _, images = shown_images(read_gltf(path, Beside(path)), Beside(path))
    assert len(images) == 64
    assert len({id(data) for data in images.values()}) == 1


def test_images_that_overlap_in_a_file_are_held_against_the_memory(
    bar, with_texture, picture, write_glb, tmp_path, monkeypatch
):
    tree, blob = with_texture(bar(), picture() + bytes(2**20))
    tree["bufferViews"] += [tree["bufferViews"][-1]] * 63
    path = write_glb(tmp_path / "bar.glb", *with_images((tree, blob), range(len(tree["bufferViews"]))[-64:]))
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**25)
    with pytest.raises(ResourceError, match="memory: 64 images in its buffers need 64 MB, 32 MB are free"):
        read_mesh(path)


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_a_texture_that_is_cut_short_is_refused_in_one_line(
    bar, with_texture, image_file, write_glb, write_obj, tmp_path, kind
):
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    cut = image_file(noise, kind)[:-2000]
    with pytest.raises(InputError, match=r"bar.glb: images: a texture cannot be decoded \(is it cut short\?\)"):
        read_mesh(write_glb(tmp_path / "bar.glb", *with_texture(bar(), cut)))
    with pytest.raises(InputError, match=r"bar.glb: images: a texture cannot be decoded"):
        read_mesh(write_glb(tmp_path / "bar.glb", *with_texture(bar(), cut, **GLOSSY)))
    (tmp_path / "wood.png").write_bytes(cut)
    with pytest.raises(InputError, match=r"a.obj: images: 'wood.png' cannot be decoded \(is it cut short\?\)"):
        read_mesh(write_obj(tmp_path))
