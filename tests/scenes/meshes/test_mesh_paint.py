"""Colours of vertices, of materials and of textures are multiplied, as glTF says."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from kornia.color import linear_rgb_to_rgb

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.mesh import GREY
from cltransfer.scenes.meshes.read_mesh import read_mesh

LINEAR = [[1.0, 0.2, 0.0, 1], [0.0, 1, 0.2, 1], [0.2, 0.2, 0.2, 1], [1, 1, 1, 1]]
SHOWN = linear_rgb_to_rgb(torch.tensor(LINEAR)[:, :3].T[..., None])[..., 0].T


def colored(made, values, component=5126, **accessor):
    """The bar with colours of its vertices."""
    tree, blob = made
    data = np.asarray(values).tobytes()
    tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = len(tree["accessors"])
    view = {"bufferView": len(tree["bufferViews"]), "componentType": component, "count": 4, "type": "VEC4"}
    tree["accessors"].append({**view, **accessor})
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
    tree["buffers"][0]["byteLength"] = len(blob) + len(data)
    return tree, blob + data


def painted_with(tree, **material):
    tree["materials"] = [material]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    return tree


@pytest.mark.parametrize(("dtype", "component", "most"), [("<f4", 5126, 1), ("u1", 5121, 255), ("<u2", 5123, 65535)])
def test_colours_of_vertices_are_linear_in_whatever_type(bar, write_glb, tmp_path, dtype, component, most):
    values = (np.array(LINEAR) * most + (0.5 if most > 1 else 0)).astype(dtype)
    tree, blob = colored(bar(), values, component, normalized=most > 1)
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    torch.testing.assert_close(mesh.colors, SHOWN, atol=2e-3, rtol=0)
    assert not mesh.shaded.any()  # they hold their light


def test_colours_of_vertices_multiply_the_base_colour(bar, write_glb, tmp_path):
    tree, blob = colored(bar(), np.array(LINEAR, "<f4"))
    factor = {"pbrMetallicRoughness": {"baseColorFactor": [0.2, 1, 1, 1]}}
    product = SHOWN.clone()
    product[:, 0] = torch.tensor([SHOWN[0, 1], 0, 0.2204, SHOWN[0, 1]])  # of 0.2, 0, 0.04 and 0.2
    for material, expected in ((factor, product), ({"name": "bare"}, SHOWN)):
        mesh = read_mesh(write_glb(tmp_path / "bar.glb", painted_with(tree, **material), blob)).mesh
        torch.testing.assert_close(mesh.colors, expected, atol=2e-3, rtol=0)
        assert bool(mesh.shaded.all())


def test_colours_of_vertices_multiply_the_texture(bar, with_texture, image_file, write_glb, tmp_path):
    picture = image_file(np.full((2, 2, 3), 200, np.uint8))
    tree, blob = colored(with_texture(bar(), picture + bytes(-len(picture) % 4)), np.array(LINEAR, "<f4"))
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    torch.testing.assert_close(mesh.colors, SHOWN, atol=1e-5, rtol=0)
    assert mesh.texture.tolist() == [0, 0]


def test_a_mesh_without_any_colour_beside_a_coloured_one_is_grey(bar, write_glb, tmp_path):
    tree, blob = colored(bar(), np.array(LINEAR, "<f4"))
    first = tree["meshes"][0]["primitives"][0]
    bare = {name: index for name, index in first["attributes"].items() if name != "COLOR_0"}
    tree["meshes"][0]["primitives"].append({**first, "attributes": bare})
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    assert sorted(mesh.shaded.tolist()) == [False, False, True, True]
    assert mesh.colors[mesh.faces[mesh.shaded].long()].unique().tolist() == [pytest.approx(GREY)]


@pytest.mark.parametrize(
    "material",
    [
        {},
        {"pbrMetallicRoughness": {"metallicFactor": 0}},
        {"extensions": {"KHR_materials_unlit": {}}},
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": {}}},
    ],
)
def test_a_material_without_a_base_colour_is_white(bar, write_glb, tmp_path, material):
    tree, blob = bar()
    first = tree["meshes"][0]["primitives"][0]
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", painted_with(tree, **material), blob)).mesh
    assert mesh.colors.unique().tolist() == [1]
    del first["material"]
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    assert mesh.colors.unique().tolist() == [pytest.approx(GREY)]  # without a material no colour is said


@pytest.mark.parametrize(
    ("values", "component", "accessor", "says"),
    [
        (np.full((4, 4), np.nan, "<f4"), 5126, {}, "expected finite numbers"),
        (np.zeros((4, 4), "i1"), 5120, {}, r"expected three or four columns of float32, uint8 or uint16, got int8"),
        (np.zeros(4, "<f4"), 5126, {"type": "SCALAR"}, "expected three or four columns"),
        (np.zeros((3, 4), "<f4"), 5126, {"count": 3}, "expected 4, one of each vertex, got 3"),
    ],
)
def test_colours_without_sense_are_refused(bar, write_glb, tmp_path, values, component, accessor, says):
    tree, blob = colored(bar(), values, component, **accessor)
    with pytest.raises(InputError, match=rf"bar.glb: COLOR_0: {says}"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


@pytest.mark.parametrize(
    ("mode", "opacity", "drawn"), [("OPAQUE", 0.1, 2), ("BLEND", 0.1, 0), ("BLEND", 0.5, 2), ("MASK", 0.2, 0)]
)
def test_the_opacity_of_a_material_decides_whether_it_is_drawn(bar, write_glb, tmp_path, mode, opacity, drawn):
    tree, blob = bar()
    (solid,) = tree["meshes"][0]["primitives"]
    tree["meshes"][0]["primitives"] = [solid, {**solid, "material": 0}]
    tree["materials"] = [{"alphaMode": mode, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, opacity]}}]
    if mode == "MASK":
        tree["materials"][0]["alphaCutoff"] = 0.3
    assert len(read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh) == 2 + drawn


@pytest.mark.parametrize(("cutoff", "drawn"), [(1, 2), (1.5, 0), (1e300, 0)])
def test_what_is_masked_above_1_is_not_drawn(bar, write_glb, tmp_path, cutoff, drawn):
    tree, blob = bar()
    (solid,) = tree["meshes"][0]["primitives"]
    tree["meshes"][0]["primitives"] = [solid, {**solid, "material": 0}]
    tree["materials"] = [{"alphaMode": "MASK", "alphaCutoff": cutoff}]
    assert len(read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh) == 2 + drawn


def test_the_opacity_of_a_material_multiplies_that_of_its_texture(bar, with_texture, image_file, write_glb, tmp_path):
    pixels = np.full((1, 3, 4), 255, np.uint8)
    pixels[0, :, 3] = 255, 180, 100
    tree, blob = with_texture(bar(), image_file(pixels))
    look = tree["materials"][0]["pbrMetallicRoughness"]
    for opacity, holes in ((1.0, [255, 255, 0]), (0.8, [255, 255, 0]), (0.6, [255, 0, 0]), (0.5, [255, 0, 0])):
        tree["materials"][0].update(
            alphaMode="BLEND", pbrMetallicRoughness={**look, "baseColorFactor": [1, 1, 1, opacity]}
        )
        mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
        assert mesh.textures[0][0, :, 3].tolist() == holes
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, 0]
    with pytest.raises(InputError, match=r"bar.glb: holds no faces \(is it a point cloud, or all transparent\?\)"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


@pytest.mark.parametrize("opacity", [0.0, 0.3])
def test_what_is_opaque_by_its_mode_has_no_holes(bar, with_texture, image_file, write_glb, tmp_path, opacity):
    tree, blob = with_texture(bar(), image_file(np.full((1, 1, 4), 9, np.uint8)))
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, opacity]
    assert read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh.textures[0].tolist() == [[[9, 9, 9, 255]]]


@pytest.mark.parametrize(("mode", "faces"), [("OPAQUE", 2), ("BLEND", 1)])
def test_a_face_whose_vertices_are_transparent_is_not_drawn(bar, write_glb, tmp_path, mode, faces):
    colors = np.ones((4, 4), "<f4")
    colors[:2, 3] = 0.1  # two corners of one face, and one of the other
    tree, blob = colored(bar(), colors)
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", painted_with(tree, alphaMode=mode), blob)).mesh
    assert len(mesh) == faces


def test_a_base_colour_of_no_four_numbers_is_refused(bar, write_glb, tmp_path):
    tree, blob = bar()
    tree = painted_with(tree, pbrMetallicRoughness={"baseColorFactor": [1, 1, 1]})
    with pytest.raises(InputError, match=r"bar.glb: materials: expected a baseColorFactor of four finite numbers, got"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


@pytest.mark.parametrize(("linear", "shown"), [(0.0018, 0.0018 * 12.92), (0.00518, 0.0627), (0.5, 0.7354)])
def test_a_dark_base_colour_is_shown_as_dark_as_it_is(bar, write_glb, tmp_path, linear, shown):
    tree, blob = bar()
    tree = painted_with(tree, pbrMetallicRoughness={"baseColorFactor": [linear] * 3 + [1]})
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    torch.testing.assert_close(mesh.colors, torch.full((len(mesh.vertices), 3), shown), atol=1e-4, rtol=0)
