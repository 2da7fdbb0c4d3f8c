"""The bar of conftest, made longer and wider by targets before its joint bends it."""

from __future__ import annotations

import numpy as np
import pytest

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.moment import Moment
from cltransfer.scenes.meshes.read_mesh import read_mesh

TALLER = [[0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 1, 0]]
WIDER = [[-1, 0, 0], [1, 0, 0], [-1, 0, 0], [1, 0, 0]]


def add(tree, blob, rows, kind="VEC3", dtype="<f4"):
    """The index of an accessor of ``rows``, and the buffer with them."""
    data = np.asarray(rows, dtype)
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": data.nbytes})
    component = {"<f4": 5126, "<u2": 5123}[dtype]
    about = {"bufferView": len(tree["bufferViews"]) - 1, "componentType": component, "count": len(data), "type": kind}
    tree["accessors"].append(about)
    blob += data.tobytes() + b"\0" * (-data.nbytes % 4)
    tree["buffers"][0]["byteLength"] = len(blob)
    return len(tree["accessors"]) - 1, blob


@pytest.fixture
def shaped(bar):
    """The bar with two targets; its first animation says how much of each at 0 and at 2 s."""
    tree, blob = bar()
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["targets"] = []
    for rows in (TALLER, WIDER):
        index, blob = add(tree, blob, rows)
        primitive["targets"].append({"POSITION": index})
    return tree, blob


@pytest.fixture
def size(write_glb, tmp_path):
    """Width and height of the bar as it is read, not bent."""

    def read(tree, blob, time=0.0, animation="rest"):
        mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob), Moment(time, animation)).mesh
        spans = mesh.vertices.amax(0) - mesh.vertices.amin(0)
        return [round(float(value), 5) for value in spans[:2]]

    return read


def test_weights_of_the_mesh_shape_it_and_those_of_the_node_come_before_them(shaped, size):
    tree, blob = shaped
    assert size(tree, blob) == [0.2, 2.0]
    tree["meshes"][0]["weights"] = [0.5, 0]
    assert size(tree, blob) == [0.2, 2.5]
    tree["nodes"][3]["weights"] = [0, 1]
    assert size(tree, blob) == [2.2, 2.0]


@pytest.mark.parametrize(("time", "seen"), [(0.0, [0.2, 2.0]), (0.5, [0.2, 2.5]), (1.0, [0.2, 3.0]), (2.0, [1.2, 2.0])])
def test_weights_are_animated(shaped, size, time, seen):
    tree, blob = shaped
    times, blob = add(tree, blob, [[0.0], [1.0], [2.0]], "SCALAR")
    weights, blob = add(tree, blob, [[0], [0], [1], [0], [0], [0.5]], "SCALAR")
    tree["animations"].append(
        {
            "name": "grow",
            "channels": [{"sampler": 0, "target": {"node": 3, "path": "weights"}}],
            "samplers": [{"input": times, "output": weights}],
        }
    )
    assert size(tree, blob, time, "grow") == seen


def test_a_joint_bends_what_the_target_has_made(shaped, size):
    tree, blob = shaped
    tree["meshes"][0]["weights"] = [1, 0]
    assert size(tree, blob, 1.0, "bend") == [2.1, 1.1]  # the end is 2 above the joint, and lies to its side now


def test_a_mesh_without_a_skin_is_shaped_wherever_it_is_shown(shaped, size):
    tree, blob = shaped
    del tree["nodes"][3]["skin"], tree["skins"]
    tree["nodes"][0]["children"].append(4)
    tree["nodes"].append({"mesh": 0, "translation": [7, 17, 7], "weights": [1, 0]})
    assert size(tree, blob) == [0.2, 13.0]  # from the foot of the one to the top of the other, which is taller


def test_a_target_may_name_the_few_vertices_it_moves(shaped, size):
    tree, blob = shaped
    indices, blob = add(tree, blob, [[2], [3]], "SCALAR", "<u2")
    values, blob = add(tree, blob, TALLER[2:])
    stored = [tree["accessors"][index]["bufferView"] for index in (indices, values)]
    sparse = {"indices": {"bufferView": stored[0], "componentType": 5123}, "values": {"bufferView": stored[1]}}
    target = tree["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    tree["accessors"][target] = {"componentType": 5126, "count": 4, "type": "VEC3", "sparse": {"count": 2, **sparse}}
    tree["meshes"][0]["weights"] = [1, 0]
    assert size(tree, blob) == [0.2, 3.0]
    tree["accessors"][target]["count"] = 3
    with pytest.raises(InputError, match=r"accessors\[\d+\].indices: name row 3 of 3"):
        size(tree, blob)


def test_a_target_without_a_buffer_view_moves_nothing(shaped, size):
    tree, blob = shaped
    target = tree["meshes"][0]["primitives"][0]["targets"][1]["POSITION"]
    del tree["accessors"][target]["bufferView"]
    tree["meshes"][0]["weights"] = [1, 1]
    assert size(tree, blob) == [0.2, 3.0]


@pytest.mark.parametrize(
    ("weights", "reason"), [([1], "has 2 targets and 1 weights"), ([1, 0, 0], "has 2 targets and 3 weights")]
)
def test_as_many_weights_as_targets(shaped, size, weights, reason):
    tree, blob = shaped
    tree["meshes"][0]["weights"] = weights
    with pytest.raises(InputError, match=rf"meshes\[0\]: {reason}"):
        size(tree, blob)


def test_a_target_moves_every_vertex(shaped, size):
    tree, blob = shaped
    target = tree["meshes"][0]["primitives"][0]["targets"][0]
    target["POSITION"], blob = add(tree, blob, TALLER[:3])
    tree["meshes"][0]["weights"] = [1, 0]
    with pytest.raises(InputError, match=r"meshes\[0\]: a target moves 3 of 4 vertices"):
        size(tree, blob)


def test_targets_that_move_more_than_anybody_draws_are_refused(shaped, size, monkeypatch):
    tree, blob = shaped
    tree["meshes"][0]["weights"] = [1, 1]
    monkeypatch.setattr("cltransfer.scenes.meshes.gltf_morph.MOST_MOVED", 7)
    with pytest.raises(InputError, match="targets: move more than 7 vertices"):
        size(tree, blob)
