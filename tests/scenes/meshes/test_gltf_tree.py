"""A short glTF that asks for a lot is refused before any of it is made."""

from __future__ import annotations

import json

import pytest

from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.meshes import gltf_tree
from cltransfer.scenes.meshes.asset_files import LIMIT
from cltransfer.scenes.meshes.gltf_tree import check_need, check_text, lean
from cltransfer.scenes.meshes.read_mesh import read_mesh

MANY = 20_000_000


@pytest.mark.parametrize("change", [{"bufferView": None}, {"sparse": {"count": 1}}, {"componentType": 1}])
@pytest.mark.parametrize("which", ["POSITION", "indices"])
def test_arrays_that_no_buffer_holds_are_refused(bar, write_glb, tmp_path, change, which):
    tree, blob = bar()
    primitive = tree["meshes"][0]["primitives"][0]
    index = primitive["indices"] if which == "indices" else primitive["attributes"][which]
    about = {**tree["accessors"][index], **change, "count": MANY}
    tree["accessors"][index] = {name: value for name, value in about.items() if value is not None}
    with pytest.raises(InputError, match=rf"accessors\[{index}\]: expected plain numbers in a buffer view"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


def test_arrays_that_no_mesh_is_made_of_are_not_made(bar, write_glb, tmp_path):
    tree, blob = bar()
    primitive = tree["meshes"][0]["primitives"][0]
    sparse = {"componentType": 5126, "type": "VEC3", "count": MANY, "sparse": {"count": 1}}
    primitive["targets"] = [{"POSITION": len(tree["accessors"])}]
    primitive["attributes"]["_LIGHT"] = len(tree["accessors"])
    tree["accessors"].append(sparse)
    assert len(read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh) == 2
    left = lean(tree)
    assert left["meshes"][0]["primitives"] == [{"attributes": {"POSITION": 0}, "indices": 3}]
    assert sum(about["count"] for about in left["accessors"]) == 4 + 6 + len(left["accessors"]) - 2
    assert [view["byteLength"] for view in left["bufferViews"] if view["byteLength"]] == [48, 12]


def many(tree, nodes=1, primitives=1, accessors=1):
    """The document with more of each, that all share one array."""
    mesh = tree["meshes"][0]
    mesh["primitives"] *= primitives
    tree["nodes"] += [{"mesh": 0}] * (nodes - 1)
    tree["scenes"][0]["nodes"] += range(4, 3 + nodes)
    tree["accessors"] += [tree["accessors"][0]] * (accessors - 1)
    mesh["primitives"] += [{"attributes": {"POSITION": len(tree["accessors"]) - i - 1}} for i in range(accessors - 1)]
    return tree


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        ({"nodes": 30, "primitives": 10}, "nodes: expected at most 250 parts in all, got 300"),
        ({"nodes": 30, "primitives": 5}, "nodes: expected at most 500 vertices in all, got 600"),
        ({"accessors": 9}, r"accessors: expected at most 400 bytes in all, got 444"),
    ],
)
def test_what_many_share_is_counted_as_often_as_it_is_built(bar, write_glb, tmp_path, monkeypatch, counts, said):
    path = write_glb(tmp_path / "bar.glb", *bar())
    monkeypatch.setattr(gltf_tree, "PART_LIMIT", 250)
    monkeypatch.setattr(gltf_tree, "COUNT_LIMIT", 500)
    assert len(read_mesh(path).mesh) == 2
    tree, blob = bar()
    if "accessors" in counts:
        monkeypatch.setattr(gltf_tree, "LIMIT", 400)
    with pytest.raises(InputError, match=said):
        read_mesh(write_glb(path, many(tree, **counts), blob))


def test_joints_are_held_against_the_memory(bar, write_glb, tmp_path, monkeypatch):
    tree, blob = bar()
    tree["nodes"] += [{}] * 996
    tree["skins"] *= 10
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    monkeypatch.setattr(memory, "free_bytes", lambda: 3 * 2**20)
    assert len(read_mesh(path).mesh) == 2
    tree["skins"] += [{"joints": [*range(1000)]}]
    with pytest.raises(ResourceError, match="memory: meshes of 4 vertices need 5 MB"):
        read_mesh(write_glb(path, tree, blob))


def test_a_skinned_mesh_counts_for_each_of_its_nodes_even_where_none_is_placed(bar, monkeypatch, tmp_path):
    tree, _ = bar()
    tree["nodes"] += [tree["nodes"][3]] * 9
    monkeypatch.setattr(gltf_tree, "COUNT_LIMIT", 39)
    with pytest.raises(InputError, match="nodes: expected at most 39 vertices in all, got 40"):
        check_need(tmp_path, tree)


def test_buffers_are_bounded_in_all(bar, tmp_path):
    tree, _ = bar()
    tree["buffers"] = [{"byteLength": LIMIT // 3, "uri": "big.bin"}] * 4
    with pytest.raises(InputError, match=f"buffers: expected at most {LIMIT} bytes in all, got "):
        check_need(tmp_path, tree)
    for length in (0, -5, LIMIT + 1, 1.5, None):
        tree["buffers"][2:] = [{"byteLength": length}]
        with pytest.raises(InputError, match=rf"buffers\[2\]: expected 1 to {LIMIT} bytes, got {length}"):
            check_need(tmp_path, tree)


def test_what_does_not_fit_in_memory_is_refused(bar, monkeypatch, tmp_path):
    tree, _ = bar()
    many(tree, nodes=400)
    monkeypatch.setattr(memory, "free_bytes", lambda: 6 * 2**20)
    with pytest.raises(ResourceError, match=r"memory: meshes of 1600 vertices need 6 MB, 6 MB .* thin the file"):
        check_need(tmp_path, tree)
    monkeypatch.setattr(memory, "free_bytes", lambda: 8 * 2**20)
    check_need(tmp_path, tree)


def test_a_json_of_many_small_values_is_refused_before_it_is_parsed(monkeypatch, tmp_path):
    text = json.dumps([{}] * 100_000).encode()
    monkeypatch.setattr(memory, "free_bytes", lambda: 20 * len(text))
    check_text(tmp_path, b'"' + text.replace(b"{", b"a").replace(b",", b"b") + b'"')
    with pytest.raises(ResourceError, match="memory: entries of its JSON need 30 MB"):
        check_text(tmp_path, text)
