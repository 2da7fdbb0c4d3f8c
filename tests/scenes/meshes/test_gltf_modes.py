from __future__ import annotations

import pytest

from cltransfer.scenes.meshes.read_mesh import read_mesh

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
FAN = [[SQUARE[1], SQUARE[2], SQUARE[0]], [SQUARE[2], SQUARE[3], SQUARE[0]]]


def corners(path):
    mesh = read_mesh(path).mesh
    return mesh.vertices[mesh.faces.long()].tolist()


@pytest.fixture
def square(builder):
    """JSON and buffer of a fan, of vertices in turn or by indices, that is placed by one node."""

    def make(indexed: bool):
        b = builder()
        primitive = {"attributes": {"POSITION": b.add(SQUARE[::-1] if indexed else SQUARE)}, "mode": 6}
        if indexed:
            primitive["indices"] = b.add([[3], [2], [1], [0]], "<u2", "SCALAR")
        tree = {"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
        about = {"bufferViews": b.views, "accessors": b.accessors, "buffers": [{"byteLength": len(b.blob)}]}
        return {"asset": {"version": "2.0"}, **tree, **about}, b.blob

    return make


@pytest.mark.parametrize("indexed", [False, True])
def test_a_fan_is_read_as_triangles(square, write_glb, tmp_path, indexed):
    assert corners(write_glb(tmp_path / "fan.glb", *square(indexed))) == FAN


def test_a_fan_of_two_vertices_beside_another_has_no_face(square, write_glb, tmp_path):
    tree, blob = square(False)
    tree["accessors"].append({**tree["accessors"][0], "count": 2})
    tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": 1}, "mode": 6})
    assert corners(write_glb(tmp_path / "fan.glb", tree, blob)) == FAN


def test_a_fan_that_bends_with_a_skeleton_is_read(bar, write_glb, tmp_path):
    tree, blob = bar()
    (primitive,) = tree["meshes"][0]["primitives"]
    primitive["mode"] = 6
    assert len(read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh) == 4
