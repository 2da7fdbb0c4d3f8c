"""What a material says of its texture's place is what is shown; (0, 0) is the top left of the image here."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.gltf_places import GLOSSY, TRANSFORM, transform_of
from cltransfer.scenes.meshes.read_mesh import read_mesh

CORNERS = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]


def places(made, write_glb, folder, about, key="TEXCOORD_0", glossy=False, most=1, **accessor):
    """Of the four corners, where the material says ``about`` of its texture and they are stored as ``key``."""
    tree, blob = made
    attributes = tree["meshes"][0]["primitives"][0]["attributes"]
    attributes[key] = len(tree["accessors"])
    tree["accessors"].append(
        {"bufferView": len(tree["bufferViews"]), "componentType": 5126, "count": 4, "type": "VEC2"} | accessor
    )
    start = len(blob) + -len(blob) % 4
    tree["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": 32})
    tree["buffers"][0]["byteLength"] = start + 32
    shown = {"index": 0, **about}
    plain, shiny = (
        {"pbrMetallicRoughness": {"baseColorTexture": shown}},
        {"extensions": {GLOSSY: {"diffuseTexture": shown}}},
    )
    tree["materials"] = [shiny if glossy else plain]
    stored = (np.array(CORNERS) * most).astype(TYPES[most]).tobytes()
    blob = blob.ljust(start, b"\0") + stored.ljust(32, b"\0")
    return read_mesh(write_glb(folder / "bar.glb", tree, blob)).mesh.uv


TYPES = {1: "<f4", 255: "u1", 65535: "<u2"}  # by what is stored for 1


@pytest.fixture
def shown(bar, with_texture, image_file, write_glb, tmp_path):
    picture = image_file(np.full((4, 4, 3), 200, np.uint8))
    return lambda about, **more: places(with_texture(bar(), picture), write_glb, tmp_path, about, **more)


@pytest.mark.parametrize("glossy", [False, True])
def test_a_part_of_the_texture_is_shown_where_scale_and_offset_put_it(shown, glossy):
    about = {"extensions": {TRANSFORM: {"offset": [0.5, 0.25], "scale": [0.5, 0.25]}}}
    expected = [[0.5, 0.25], [1, 0.25], [0.5, 0.5], [1, 0.5]]
    np.testing.assert_allclose(shown(about, glossy=glossy), expected, atol=1e-6)


def test_a_quarter_turn_shows_the_lower_left_quarter(shown):
    about = {"extensions": {TRANSFORM: {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]}}}
    expected = [[0, 1], [0, 0.5], [0.5, 1], [0.5, 0.5]]  # the extension's own example
    np.testing.assert_allclose(shown(about), expected, atol=1e-6)


def test_what_is_stretched_is_so_before_it_turns():
    about = {"extensions": {TRANSFORM: {"rotation": math.pi / 2, "scale": [2, 3]}}}
    found = transform_of(None, {"pbrMetallicRoughness": {"baseColorTexture": about}})
    np.testing.assert_allclose(found, [[0, 3, 0], [-2, 0, 0]], atol=1e-12)


def test_the_texture_coordinates_that_a_material_names_are_shown(shown):
    np.testing.assert_allclose(shown({"texCoord": 1}, key="TEXCOORD_1"), CORNERS, atol=1e-6)
    both = {"texCoord": 0, "extensions": {TRANSFORM: {"texCoord": 2, "offset": [1, 0]}}}
    np.testing.assert_allclose(shown(both, key="TEXCOORD_2"), np.add(CORNERS, [1, 0]), atol=1e-6)


@pytest.mark.parametrize(
    ("about", "says"),
    [
        ({"texCoord": 3}, "TEXCOORD_3: is shown by a material of a mesh that has none"),
        ({"extensions": {TRANSFORM: {"offset": ["a", 0]}}}, "KHR_texture_transform: expected five finite numbers"),
        ({"extensions": {TRANSFORM: {"scale": [1]}}}, "KHR_texture_transform: expected five finite numbers"),
        ({"extensions": {TRANSFORM: {"offset": [10**400, 0]}}}, "KHR_texture_transform: expected five finite numbers"),
        ({"extensions": {TRANSFORM: {"rotation": True}}}, "KHR_texture_transform: expected five finite numbers"),
        ({"extensions": {TRANSFORM: {"scale": [1e9, 1]}}}, "texture coordinates: expected at most"),
    ],
)
def test_a_place_without_sense_is_refused(shown, about, says):
    with pytest.raises(InputError, match=rf"bar.glb: {says}"):
        shown(about)


@pytest.mark.parametrize(("component", "most"), [(5121, 255), (5123, 65535)])
def test_places_that_are_stored_as_shares_are_shown(shown, component, most):
    stored = {"componentType": component, "most": most}
    np.testing.assert_allclose(shown({}, **stored, normalized=True), CORNERS, atol=1e-6)
    with pytest.raises(InputError, match="TEXCOORD_0: expected float32, or integers that are marked as normalized"):
        shown({}, **stored)


def test_places_of_only_some_vertices_are_refused(shown):
    with pytest.raises(InputError, match="TEXCOORD_0: expected 4, one of each vertex, got 3"):
        shown({}, count=3)


@pytest.mark.parametrize("kind", ["SCALAR", "VEC3", "VEC4", "MAT2"])
def test_a_place_is_two_numbers(shown, kind):
    with pytest.raises(InputError, match=f"TEXCOORD_0: expected two numbers of each vertex, a VEC2, got '{kind}'"):
        shown({}, componentType=5121, most=255, normalized=True, type=kind)


def test_places_that_are_shares_are_counted_before_they_are_written_out(shown):
    with pytest.raises(InputError, match="TEXCOORD_0: expected 4, one of each vertex, got 5000"):
        shown({}, componentType=5121, normalized=True, count=5000)  # more than there are in its buffer view


@pytest.mark.parametrize("glossy", [False, True])
@pytest.mark.parametrize(
    ("sampler", "wraps"),
    [
        ({}, ("repeat", "repeat")),
        ({"wrapS": 33071}, ("clamp", "repeat")),
        ({"wrapS": 10497, "wrapT": 33648}, ("repeat", "mirror")),
        ({"wrapS": 33648, "wrapT": 33071, "magFilter": 9728}, ("mirror", "clamp")),
    ],
)
def test_a_texture_is_wrapped_as_its_sampler_says(
    bar, with_texture, image_file, write_glb, tmp_path, glossy, sampler, wraps
):
    picture = image_file(np.full((4, 4, 3), 200, np.uint8))
    shiny = {"extensions": {GLOSSY: {"diffuseTexture": {"index": 0}}}} if glossy else {}
    tree, blob = with_texture(bar(), picture, **shiny)
    tree["samplers"], tree["textures"][0]["sampler"] = [{"wrapS": 33071, "wrapT": 33071}, sampler], 1
    assert read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh.wraps == (wraps,)


@pytest.mark.parametrize(
    ("sampler", "index", "says"),
    [
        ({"wrapT": 9}, 0, r"samplers\[0\]: expected a wrapT of 10497 \(repeat\), 33071 \(clamp\), 33648 .* got 9"),
        ({}, 1, "samplers: has no entry 1"),
    ],
)
def test_a_sampler_without_sense_is_refused(bar, with_texture, image_file, write_glb, tmp_path, sampler, index, says):
    tree, blob = with_texture(bar(), image_file(np.full((4, 4, 3), 200, np.uint8)))
    tree["samplers"], tree["textures"][0]["sampler"] = [sampler], index
    with pytest.raises(InputError, match=rf"bar.glb: {says}"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))
