"""The bent bar of conftest has positions that can be worked out by hand."""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path
from time import process_time
from types import SimpleNamespace

import numpy as np
import pytest

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.asset_files import Beside
from cltransfer.scenes.meshes.gltf_animation import channels
from cltransfer.scenes.meshes.gltf_file import Gltf, read_gltf
from cltransfer.scenes.meshes.gltf_skin import POSED, _local, _skinned, posed
from cltransfer.scenes.meshes.read_mesh import read_mesh


@pytest.fixture
def pose(bar, write_glb, tmp_path):
    def at(time, animation=None, interpolation="LINEAR"):
        path = write_glb(tmp_path / "bar.glb", *bar(interpolation))
        return posed(read_gltf(path, Beside(path)), time, animation)

    return at


@pytest.mark.parametrize(
    ("time", "turn"), [(-1.0, 0.0), (0.0, 0.0), (0.5, 45.0), (1.0, 90.0), (1.25, 112.5), (2.0, 180.0), (9.0, 180.0)]
)
def test_the_upper_half_turns_about_its_joint_on_a_great_circle(pose, time, turn):
    _, rig = pose(time)
    angle = math.radians(turn)
    end = [10 - math.sin(angle), 1 + math.cos(angle), 0]
    np.testing.assert_allclose(rig.vertices[2:].mean(0), end, atol=1e-6)
    np.testing.assert_allclose(rig.vertices[:2].mean(0), [10, 0, 0], atol=1e-6)  # the strip's own node does not count


def test_steps_hold_the_key_before(pose):
    for time, turn in ((0.9, 0.0), (1.0, 90.0), (1.9, 90.0)):
        _, rig = pose(time, interpolation="STEP")
        np.testing.assert_allclose(rig.vertices[2:].mean(0)[0], 10 - math.sin(math.radians(turn)), atol=1e-6)


def test_the_shorter_way_round_is_taken(bar, write_glb, tmp_path):
    tree, blob = bar()
    at = tree["bufferViews"][tree["accessors"][6]["bufferView"]]["byteOffset"]
    turned = blob[: at + 16] + (-np.frombuffer(blob[at + 16 : at + 32], "<f4")).tobytes() + blob[at + 32 :]
    path = write_glb(tmp_path / "bar.glb", tree, turned)
    _, rig = posed(read_gltf(path, Beside(path)), 0.5)
    np.testing.assert_allclose(rig.vertices[2:].mean(0)[0], 10 - math.sin(math.radians(45)), atol=1e-6)


@pytest.mark.parametrize("time", [-1.0, 1.0, 1.5, 1e9])
def test_of_a_long_animation_only_the_keys_of_the_moment_are_kept(builder, time):
    keys, b = 200_000, builder()
    times = b.add(np.arange(keys)[:, None], kind="SCALAR")
    turns = b.add(np.tile([0, 0, 0, 1], (keys, 1)), kind="VEC4")
    sampled = [{"sampler": 0, "target": {"node": node, "path": "rotation"}} for node in range(8)]
    animation = {"channels": sampled, "samplers": [{"input": times, "output": turns}]}
    tree = {"accessors": b.accessors, "bufferViews": b.views, "animations": [animation]}
    gltf = Gltf(Path("long.glb"), tree, (b.blob,))
    tracemalloc.start()
    values = channels(gltf, time, None)
    kept, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert [value.tolist() for value in values.values()] == [[0, 0, 0, 1]] * 8
    assert kept < 2**20
    assert most < 2 * len(b.blob)


def test_an_animation_is_chosen_by_name(pose):
    _, rig = pose(1.0, "rest")
    np.testing.assert_allclose(rig.vertices[2:].mean(0), [10, 2, 0], atol=1e-6)
    with pytest.raises(InputError, match=r"no animation 'run' \(known: bend, rest\)"):
        pose(0.0, "run")


def test_the_skeleton_says_where_its_joints_are_and_what_they_move(pose):
    _, rig = pose(1.0)
    assert rig.names == ("low", "high")
    assert rig.parents == (-1, 0)
    np.testing.assert_allclose(rig.points, [[10, 0, 0], [10, 1, 0]], atol=1e-9)
    assert rig.strongest.tolist() == [0, 0, 1, 1]


def test_a_vertex_that_no_joint_weighs_goes_with_its_first_one(bar, write_glb, tmp_path):
    tree, blob = bar()
    weights = tree["accessors"][tree["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"]]
    view = tree["bufferViews"][weights["bufferView"]]
    start = view.get("byteOffset", 0)
    none = blob[:start] + bytes(view["byteLength"]) + blob[start + view["byteLength"] :]
    found = [
        posed(read_gltf(write_glb(tmp_path / "bar.glb", tree, data), Beside(tmp_path)), 0.0)[1] for data in (blob, none)
    ]
    np.testing.assert_allclose(found[1].vertices[:2], found[0].vertices[:2])  # those of the lower joint
    assert np.abs(found[1].vertices).max(1).min() > 1  # and none at the origin


@pytest.mark.parametrize("scale", [1.0, -1.0])
def test_a_figure_that_hangs_from_a_mirror_is_mirrored(bar, write_glb, tmp_path, scale):
    tree, blob = bar()
    joint = tree["skins"][0]["joints"][0]
    tree["nodes"].append({"scale": [scale, 1, 1], "children": [joint]})
    tree["scenes"][0]["nodes"] = [n for n in tree["scenes"][0]["nodes"] if n != joint] + [len(tree["nodes"]) - 1]
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    assert posed(read_gltf(path, Beside(path)), 0.0)[1].mirrored == (scale < 0)


def test_what_comes_out_has_no_skin_and_reads_back_the_same(pose, tmp_path):
    document, rig = pose(0.5)
    (tmp_path / "frozen.glb").write_bytes(document.to_glb())
    again = read_gltf(tmp_path / "frozen.glb", Beside(tmp_path / "frozen.glb"))
    assert "skins" not in again.tree
    assert not any("skin" in node for node in again.tree["nodes"])
    mesh = again.tree["meshes"][again.tree["nodes"][-1]["mesh"]]
    stored = again.array(mesh["primitives"][0]["attributes"]["POSITION"])
    np.testing.assert_allclose(stored, rig.vertices, atol=1e-6)


@pytest.mark.parametrize("scene", [0, 1])
def test_a_figure_of_another_scene_than_the_one_shown_is_not_drawn(bar, write_glb, tmp_path, scene):
    tree, blob = bar()
    tree["nodes"] += [{"mesh": 1}, {"mesh": 0, "skin": 0}]
    primitive = {"attributes": {"POSITION": 0}, "indices": 3}
    tree["meshes"].append({"primitives": [primitive, primitive]})
    tree.update(scene=scene, scenes=[{"nodes": [0, 4]}, {"nodes": [4]}])
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    document, rig = posed(read_gltf(path, Beside(path)), 0.0)
    assert not any("skin" in node for node in document.tree["nodes"])
    assert (rig is None) == (scene == 1)
    assert len(read_mesh(path).mesh) == (6 if scene == 0 else 4)


def test_without_a_skin_nodes_still_move(bar, write_glb, tmp_path):
    tree, blob = bar()
    tree["nodes"][2]["mesh"] = 0
    del tree["nodes"][3]["skin"]
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    document, rig = posed(read_gltf(path, Beside(path)), 1.0)
    assert rig is None
    np.testing.assert_allclose(
        np.reshape(document.tree["nodes"][2]["matrix"], (4, 4)).T[:2, :2], [[0, -1], [1, 0]], atol=1e-6
    )


def damage(tree, what):
    if what == "circle":
        tree["nodes"][2]["children"] = [1]
    if what == "spline":
        tree["animations"][0]["samplers"][0]["interpolation"] = "CUBICSPLINE"
    if what == "bezier":
        tree["animations"][0]["samplers"][0]["interpolation"] = "BEZIER"
    if what == "joint":
        tree["skins"][0]["joints"] = [1]
        del tree["skins"][0]["inverseBindMatrices"]
    if what == "weights":
        del tree["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"]
    if what == "binds":
        tree["skins"][0]["inverseBindMatrices"] = 0
    if what == "few binds":
        tree["accessors"][tree["skins"][0]["inverseBindMatrices"]]["count"] = 1
    if what == "node":
        tree["skins"][0]["joints"] = [1, 99]
    if what == "twelve":
        tree["meshes"][0]["primitives"][0]["attributes"]["JOINTS_2"] = 0
    if what in ("view", "array"):
        tree["bufferViews" if what == "view" else "accessors"][0]["byteOffset"] = -12


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ("circle", "is its own parent"),
        ("spline", "expected 9 rows of 4 for its 3 keys, got .3, 4."),
        ("bezier", "'BEZIER' is not read .known: LINEAR, STEP, CUBICSPLINE."),
        ("joint", "joint 1 of 1"),
        ("weights", "WEIGHTS_0"),
        ("binds", "expected 2 inverse bind matrices or more, got 4 of 3 numbers"),
        ("few binds", "expected 2 inverse bind matrices or more, got 1 of 16 numbers"),
        ("node", "has no entry 99"),
        ("twelve", "at most 8 joints a vertex"),
        ("view", r"bufferViews\[0\]: expected a byteOffset of 0 or more, got -12"),
        ("array", r"accessors\[0\]: expected a byteOffset of 0 or more, got -12"),
    ],
)
def test_a_damaged_skin_is_one_line(bar, write_glb, tmp_path, what, reason):
    tree, blob = bar()
    damage(tree, what)
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    with pytest.raises(InputError, match=reason) as error:
        posed(read_gltf(path, Beside(path)), 0.5)
    assert "\n" not in str(error.value)


def test_no_joint_counts_back_from_the_last(bar, write_glb, tmp_path):
    tree, blob = bar()
    joints = tree["accessors"][1]
    joints["componentType"] = 5122
    first = tree["bufferViews"][joints["bufferView"]]["byteOffset"]
    blob = blob[:first] + np.full(1, -1, "<i2").tobytes() + blob[first + 2 :]
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    with pytest.raises(InputError, match="skins: joint -1 of 2"):
        posed(read_gltf(path, Beside(path)), 0.5)


def test_matrices_beyond_those_of_the_joints_count_for_nothing(bar, write_glb, tmp_path):
    tree, blob = bar()
    whole = posed(read_gltf(write_glb(tmp_path / "bar.glb", tree, blob), Beside(tmp_path)), 1.0)[1]
    binds = tree["accessors"][tree["skins"][0]["inverseBindMatrices"]]
    rows = np.frombuffer(blob, "<f4", 32, tree["bufferViews"][binds["bufferView"]]["byteOffset"])
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": 192})
    binds.update(bufferView=len(tree["bufferViews"]) - 1, count=3)
    blob += rows.tobytes() + np.full(16, np.nan, "<f4").tobytes()
    tree["buffers"][0]["byteLength"] = len(blob)
    rig = posed(read_gltf(write_glb(tmp_path / "bar.glb", tree, blob), Beside(tmp_path)), 1.0)[1]
    np.testing.assert_array_equal(rig.vertices, whole.vertices)


def test_of_two_figures_only_the_first_is_named_with_what_hangs_on_its_joints(bar, write_glb, tmp_path):
    tree, blob = bar()
    joints = {"body": [1, 2], "hair": [4], "other": [6, 7]}
    tree["nodes"] += [{"name": "lock"}, {"children": [6], "translation": [3, 0, 0]}, {"children": [7]}, {}]
    tree["nodes"][2]["children"] = [4]  # the lock hangs on the upper joint, which is no joint of its skin
    tree["scenes"][0]["nodes"].append(5)
    tree["skins"] = [{"joints": one} for one in joints.values()]
    primitive = tree["meshes"][0]["primitives"][0]
    tree["accessors"].append({**tree["accessors"][primitive["attributes"]["JOINTS_0"]]})
    tree["accessors"][-1]["bufferView"] = len(tree["bufferViews"])
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": 32})
    lock = {**primitive, "attributes": {**primitive["attributes"], "JOINTS_0": len(tree["accessors"]) - 1}}
    tree["meshes"].append({"primitives": [lock]})
    tree["nodes"] += [{"mesh": 1, "skin": 1}, {"mesh": 0, "skin": 2}]
    tree["scenes"][0]["nodes"] += [8, 9]
    frozen, rig = posed(read_gltf(write_glb(tmp_path / "two.glb", *grown(tree, blob)), Beside(tmp_path)), 0.0)
    names = [node["name"] for node in frozen.tree["nodes"] if "mesh" in node]
    assert names == [f"{POSED} 3", f"{POSED} 8", "another figure 9"]
    assert rig.names == ("low", "high", "lock")


def test_a_chain_of_many_joints_takes_no_more_than_as_many_short_ones(bar, write_glb, tmp_path, within):
    tree, blob = bar()
    first, more = len(tree["nodes"]), 10_000
    tree["nodes"] += [{"children": [first + i + 1]} for i in range(more - 1)] + [{}]
    tree["nodes"][2]["children"] = [first]
    middle = first + more // 2  # from there on each node is a joint
    tree["skins"] = [{"joints": [1, 2, *range(middle, first + more)]}]
    gltf = read_gltf(write_glb(tmp_path / "chain.glb", tree, blob), Beside(tmp_path))
    start = process_time()
    _, rig = posed(gltf, 0.0)
    assert within(process_time() - start, 3.0)
    assert rig.parents == (-1, *range(more // 2 + 1))


def test_a_skin_of_many_meshes_is_worked_out_once(bar, write_glb, tmp_path, within):
    tree, blob = bar()
    first, joints, meshes = len(tree["nodes"]), 2000, 2500
    tree["nodes"] += [{} for _ in range(joints)]
    tree["nodes"][2]["children"] = [*range(first, first + joints)]
    tree["skins"] = [{"joints": [1, 2, *range(first, first + joints)]}]
    tree["scenes"][0]["nodes"] += range(len(tree["nodes"]), len(tree["nodes"]) + meshes)
    tree["nodes"] += [{"mesh": 0, "skin": 0} for _ in range(meshes)]
    gltf = read_gltf(write_glb(tmp_path / "many.glb", tree, blob), Beside(tmp_path))
    start = process_time()
    _, rig = posed(gltf, 0.0)
    assert within(process_time() - start, 1.5)
    assert rig.vertices.shape == (4 * (meshes + 1), 3)


def grown(tree, blob):
    """With 32 more bytes of nothing."""
    tree["buffers"][0]["byteLength"] = len(blob) + 32
    return tree, blob + bytes(32)


def test_a_node_is_scaled_along_its_own_axes_before_it_is_turned() -> None:
    turned = {"rotation": [0, 0, math.sqrt(0.5), math.sqrt(0.5)], "scale": [2, 1, 1]}
    found = _local(SimpleNamespace(tree={"nodes": [turned]}), {})[0]
    np.testing.assert_allclose(found[:2, :2], [[0, -1], [2, 0]], atol=1e-9)


def test_weights_that_do_not_add_up_to_1_pull_nothing_to_the_origin() -> None:
    arrays = {0: np.array([[1.0, 2, 3]]), 1: np.array([[0, 1, 0, 0]]), 2: np.array([[0.25, 0.25, 0, 0]])}
    file = SimpleNamespace(path="man.glb", array=arrays.__getitem__)
    places, _ = _skinned(file, {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}, np.stack([np.eye(4)] * 2))
    np.testing.assert_allclose(places, [[1, 2, 3]])
