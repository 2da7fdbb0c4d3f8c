"""Values between two keys; what they do to a figure is in test_gltf_skin.py."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.gltf_animation import channels
from cltransfer.scenes.meshes.gltf_file import Gltf


@pytest.fixture
def animated(builder):
    """A document of one node whose ``path`` takes ``values`` at ``times``; its mesh has two targets."""

    def made(path, times, values, interpolation):
        b = builder()
        kind = {"translation": "VEC3", "rotation": "VEC4", "weights": "SCALAR"}[path]
        at = b.add(np.asarray(times)[:, None], kind="SCALAR")
        sampler = {"input": at, "output": b.add(values, kind=kind), "interpolation": interpolation}
        animation = {"channels": [{"sampler": 0, "target": {"node": 0, "path": path}}], "samplers": [sampler]}
        shown = {"nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"targets": [{}, {}]}]}]}
        tree = {"accessors": b.accessors, "bufferViews": b.views, "animations": [animation], **shown}
        return Gltf(Path("a.glb"), tree, (b.blob,))

    return made


def cubic(t):
    return np.array([2 * t**3 - t, 5.0, t])


def slope(t):
    return np.array([6 * t**2 - 1, 0.0, 1.0])


@pytest.mark.parametrize("time", [1.0, 1.5, 2.25, 3.0])
def test_a_cubic_between_two_keys_is_found_again_from_its_values_and_slopes(animated, time):
    keys = [row for t in (1.0, 3.0) for row in (slope(t), cubic(t), slope(t))]
    gltf = animated("translation", [1.0, 3.0], keys, "CUBICSPLINE")
    np.testing.assert_allclose(channels(gltf, time, None)[0, "translation"], cubic(time), atol=1e-5)


@pytest.mark.parametrize(("time", "held"), [(0.0, 1.0), (9.0, 3.0)])
def test_before_and_after_all_keys_a_cubic_stands(animated, time, held):
    keys = [row for t in (1.0, 3.0) for row in (slope(t), cubic(t), slope(t))]
    gltf = animated("translation", [1.0, 3.0], keys, "CUBICSPLINE")
    np.testing.assert_allclose(channels(gltf, time, None)[0, "translation"], cubic(held), atol=1e-5)


def test_a_key_may_leave_by_another_slope_than_it_is_reached_by(animated):
    still, rising = np.zeros(3), np.full(3, 8.0)
    keys = [still, still, rising, still, still, still]  # leaves the first at 8 a second, reaches the second at rest
    found = channels(animated("translation", [0.0, 2.0], keys, "CUBICSPLINE"), 1.0, None)[0, "translation"]
    np.testing.assert_allclose(found, np.full(3, 8.0 * 2 * (0.5**3 - 2 * 0.5**2 + 0.5)), atol=1e-6)


def test_a_rotation_on_a_cubic_is_one(animated):
    none, quarter = [0, 0, 0, 1], [0, 0, math.sqrt(0.5), math.sqrt(0.5)]
    flat = [0, 0, 0, 0]
    gltf = animated("rotation", [0.0, 1.0], [flat, none, flat, flat, quarter, flat], "CUBICSPLINE")
    found = channels(gltf, 0.5, None)[0, "rotation"]
    eighth = math.radians(45) / 2
    np.testing.assert_allclose(found, [0, 0, math.sin(eighth), math.cos(eighth)], atol=1e-6)


def test_of_weights_a_key_has_all_slopes_then_all_values_then_all_slopes(animated):
    values = [[v] for v in (0, 0, 0.25, 0.5, 0, 0, 0, 0, 0.75, 1.0, 0, 0)]
    found = channels(animated("weights", [0.0, 1.0], values, "CUBICSPLINE"), 0.5, None)[0, "weights"]
    np.testing.assert_allclose(found, [0.5, 0.75], atol=1e-6)


@pytest.mark.parametrize("values", [[[v] for v in range(6)], [[0.5]]])
def test_a_key_has_as_many_weights_as_the_mesh_has_targets(animated, values):
    gltf = animated("weights", [0.0, 1.0], values, "STEP")
    with pytest.raises(InputError, match=r"a.glb: animations: weights: expected 2 rows of 2 for its 2 keys, got \("):
        channels(gltf, 0.5, None)
    for holder, name in ((gltf.tree["meshes"][0]["primitives"][0], "targets"), (gltf.tree["nodes"][0], "mesh")):
        del holder[name]
        assert channels(gltf, 0.5, None) == {}  # nothing is there to be moved


def test_weights_that_no_byte_of_the_file_holds_are_not_even_made(animated):
    gltf = animated("weights", [0.0, 1.0], np.ones((16, 1)), "STEP")
    few = {"count": 1, "indices": {"bufferView": 0, "componentType": 5121}, "values": {"bufferView": 1}}
    gltf.tree["accessors"][1] = {"componentType": 5126, "count": 1_000_000, "type": "MAT4", "sparse": few}
    with pytest.raises(InputError, match=r"expected 2 rows of 2 for its 2 keys, got \(1000000, 16\)"):
        channels(gltf, 0.5, None)
