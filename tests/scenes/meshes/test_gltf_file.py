from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.meshes import asset_files
from cltransfer.scenes.meshes.asset_files import Beside
from cltransfer.scenes.meshes.gltf_file import read_gltf
from cltransfer.scenes.meshes.read_mesh import read_mesh


@pytest.fixture
def opened(monkeypatch):
    """Names of the files that were read."""
    names: list[str] = []
    read = asset_files.read_limited
    monkeypatch.setattr(asset_files, "read_limited", lambda path, *most: names.append(path.name) or read(path, *most))
    return names


def test_a_file_of_many_buffers_is_read_once_and_no_longer_than_it_is_to_be(bar, write_gltf, tmp_path, opened):
    tree, blob = bar()
    (tmp_path / "big.bin").write_bytes(blob + bytes(1000))
    path = write_gltf(tmp_path / "bar.gltf", tree, blob, "big.bin")
    text = path.read_text()
    buffer = text[text.index('"buffers": [') + 12 : -2]
    more = "".join(f", {buffer.replace('big.bin', name)}" for name in ("big.bin", "./big.bin", "%62ig.bin"))
    path.write_text(text.replace(buffer, buffer + more))
    gltf = read_gltf(path, Beside(path))
    assert [len(data) for data in gltf.buffers] == [len(blob)] * 4
    assert opened == ["big.bin"]
    assert len(gltf.to_glb()) < 4 * len(blob) + 5000


def test_an_image_that_is_named_is_looked_for_but_not_read(bar, write_gltf, tmp_path, opened):
    tree, blob = bar()
    tree["images"] = [{"uri": "normals.png"}]
    (tmp_path / "normals.png").write_bytes(b"not looked at")
    path = write_gltf(tmp_path / "bar.gltf", tree, blob)
    files = Beside(path)
    read_gltf(path, files)
    assert (files.given, opened) == ([tmp_path / "normals.png"], [])


def test_without_a_scene_every_node_that_hangs_from_no_other_is_placed(bar, write_glb, tmp_path):
    tree, blob = bar()
    nodes = [{"children": [1], "translation": [5, 0, 0]}, {"mesh": 0, "translation": [1, 0, 0]}, {"mesh": 0}]
    tree = {**{key: tree[key] for key in tree.keys() - {"scene", "scenes", "skins", "animations"}}, "nodes": nodes}
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    assert sorted(mesh.means[:, 0].round().tolist()) == [0, 0, 6, 6]
    whole, blob = bar()
    del whole["scene"], whole["scenes"]
    assert read_mesh(write_glb(tmp_path / "bar.glb", whole, blob)).mesh.label.tolist() == [0, 0]


@pytest.mark.parametrize("name", ["EXT_texture_webp", "KHR_materials_pbrSpecularGlossiness"])
def test_extensions_that_are_read_may_be_required(bar, with_texture, image_file, write_glb, tmp_path, name):
    tree, blob = with_texture(bar(), image_file(np.full((2, 2, 3), (250, 0, 0), np.uint8), "WEBP"))
    tree["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
    tree["extensionsRequired"] = [name]
    texture = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh.textures[0]
    assert texture[0, 0, 0] > 240


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["KHR_draco_mesh_compression"], r"KHR_draco_mesh_compression is not read \(export it without compression\)"),
        (["KHR_mesh_quantization", "X"], r"KHR_mesh_quantization, X is not read \(export it without compression\)"),
        (["EXT_meshopt_compression"], r"EXT_meshopt_compression is not read \(export it without compression\)"),
        (["X"], "X is not read$"),
    ],
)
def test_a_file_that_needs_what_is_not_read_is_refused_with_what_to_do(bar, write_glb, tmp_path, names, says):
    tree, blob = bar()
    tree["extensionsRequired"] = names
    with pytest.raises(InputError, match=rf"bar.glb: extensionsRequired: {says}"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


def test_many_instances_of_a_node_are_not_taken_for_one(bar, write_glb, tmp_path):
    tree, blob = bar()
    tree["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}
    tree["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    with pytest.raises(InputError, match="nodes: EXT_mesh_gpu_instancing is not read"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


@pytest.mark.parametrize(
    ("joints", "reason"),
    [
        ([0, 1, 0], "expected each node once, 0 is there 2 times"),
        ([0] * 9, "expected a list of at most 4 nodes, as many as there are, got 9"),
        ({"0": 1}, "expected a list of at most 4 nodes, as many as there are, got dict"),
    ],
)
def test_a_skin_names_no_joint_twice(bar, write_glb, tmp_path, joints, reason):
    tree, blob = bar()
    tree["skins"].append({"joints": joints})
    with pytest.raises(InputError, match=rf"bar.glb: skins\[1\].joints: {reason}"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))


def test_a_name_that_is_too_long_for_a_file_is_refused_in_one_line(bar, write_gltf, tmp_path):
    path = write_gltf(tmp_path / "bar.gltf", *bar(), "a" * 5000)
    with pytest.raises(InputError, match=r"bar.gltf: uri: no such file 'a{80}'"):
        read_mesh(path)


def test_rows_that_a_sparse_array_does_not_store_are_held_against_the_memory(bar, write_glb, tmp_path, monkeypatch):
    tree, blob = bar()
    few = {"count": 1, "indices": {"bufferView": 3, "componentType": 5123}, "values": {"bufferView": 0}}
    tree["accessors"].append({"componentType": 5126, "count": 20_000_000, "type": "VEC3", "sparse": few})
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    gltf = read_gltf(path, Beside(path))
    monkeypatch.setattr(memory, "free_bytes", lambda: 20_000_000 * 3 * 8 - 1)
    reason = r"bar.glb: memory: 20000000 rows of accessors\[7\] need 458 MB"
    with pytest.raises(ResourceError, match=reason):
        gltf.array(7)
    monkeypatch.setattr(memory, "free_bytes", lambda: 4 * 3 * 8)
    tree["accessors"][7]["count"] = 4
    assert replace(gltf, tree=tree).array(7).tolist() == [[pytest.approx(-0.1), 0, 0], [0] * 3, [0] * 3, [0] * 3]


@pytest.mark.parametrize(("component", "kind"), [(5126, "<f4"), (5121, "u1")])
def test_an_array_without_a_buffer_view_is_0_where_there_is_memory(
    bar, write_glb, tmp_path, monkeypatch, component, kind
):
    tree, blob = bar()
    tree["accessors"].append({"componentType": component, "count": 4, "type": "VEC4"})
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    gltf = read_gltf(path, Beside(path))
    found = gltf.array(7)
    assert (found.tolist(), found.dtype) == ([[0] * 4] * 4, kind)
    tree["accessors"][7]["count"] = 20_000_000
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**20)
    with pytest.raises(ResourceError, match=r"bar.glb: memory: 20000000 rows of accessors\[7\] need"):
        replace(gltf, tree=tree).array(7)


@pytest.mark.parametrize("about", [{"type": "VEC5"}, {"componentType": 5124}])
def test_numbers_of_no_known_type_are_refused(bar, write_glb, tmp_path, about):
    tree, blob = bar()
    tree["accessors"].append({"componentType": 5126, "count": 4, "type": "VEC4", **about})
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    with pytest.raises(InputError, match=r"bar.glb: accessors\[7\]: expected plain numbers of a known type"):
        read_gltf(path, Beside(path)).array(7)
