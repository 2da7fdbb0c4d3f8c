"""Text that would take a thousand times its size is refused before trimesh reads it."""

from __future__ import annotations

import tracemalloc

import pytest

from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.meshes.mesh_need import check_obj, check_ply
from cltransfer.scenes.meshes.read_mesh import read_mesh

XYZ = b"property float x\nproperty float y\nproperty float z\n"
FACE = b"property list uchar int vertex_indices\n"


def ply(rows=b"0 0 0\n1 0 0\n0 1 0\n", faces=b"3 0 1 2\n", vertices=3, count=1, more=b"", kind=b"ascii 1.0") -> bytes:
    head = b"ply\nformat %s\nelement vertex %d\n%s%s" % (kind, vertices, XYZ, more)
    return head + b"element face %d\n%send_header\n%s%s" % (count, FACE, rows, faces)


@pytest.fixture
def free(monkeypatch):
    """Sets how many MB are free."""
    return lambda megabytes: monkeypatch.setattr(memory, "free_bytes", lambda: int(megabytes * 2**20))


@pytest.mark.parametrize(
    ("data", "need"),
    [
        (ply(faces=b"3 0 1 2\n" + b"\n" * 50_000), 12),
        (ply(faces=b"50000" + b" 1" * 50_000 + b"\n"), 8),
        (ply(faces=b"3 0 1 2\n" * 20_000, count=20_000), 9),
        (ply(bytes(36), b"\x03" + bytes(12) + bytes(400_000), kind=b"binary_little_endian 1.0"), 15),
        (ply(rows=b"0 0 0\n" * 20_000, vertices=20_000, more=b"element edge 20000\nproperty int a\n"), 10),
    ],
    ids=["lines", "corners", "faces", "binary", "edges"],
)
def test_a_ply_is_held_against_the_memory(tmp_path, free, data, need):
    (tmp_path / "scan.ply").write_bytes(data)
    free(need / 2)
    with pytest.raises(ResourceError, match=r"scan.ply: memory: its vertices and faces need .* thin the file"):
        read_mesh(tmp_path / "scan.ply")
    free(2 * need)
    check_ply(tmp_path, data)


def test_rows_of_unlike_width_and_columns_that_are_not_there_are_refused(tmp_path):
    wide = b"".join(b"property float p%d\n" % i for i in range(200))
    bad = {
        r"element vertex: expected 3 numbers in each row, got 2 in row 1": ply(rows=b"0 0 0\n1 0\n0 1 0\n"),
        r"header: its rows ask for more than the file holds": ply(more=wide, rows=b"1\n" * 90, vertices=90),
        r"body: expected ASCII text, got byte 28 at": ply(rows=b"0 0 0\n1 0 0\n0 1 0\x1c0 0 0\n"),
        r"header: 'xelement face 99999999' asks for": ply().replace(b"element face 1", b"xelement face 99999999"),
        r"header: 'element vertex 1{45}' asks for": ply().replace(b"vertex 3", b"vertex " + b"1" * 5000),
        r"body: lines follow the last element": ply(faces=b"3 0 1 2\n\n1 1\n"),
        r"header: expected a PLY header": ply().replace(b"end_header", b"comment xend_header"),
    }
    for reason, data in bad.items():
        (tmp_path / "scan.ply").write_bytes(data)
        with pytest.raises(InputError, match=reason):
            read_mesh(tmp_path / "scan.ply")


def test_an_obj_is_held_against_the_memory(tmp_path, free):
    vertices = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" * 100
    parts = b"".join(b"usemtl m%d\nf 1 2 3\n" % i for i in range(300))
    cases = {
        "lines": (b"f 1 2 3\n" * 30_000, 5),
        "corners": (b"f" + b" 1" * 50_000 + b"\n", 7),
        "parts": (parts, 5),
    }
    for name, (faces, need) in cases.items():
        (tmp_path / f"{name}.obj").write_bytes(vertices + faces)
        free(need / 2)
        with pytest.raises(ResourceError, match="memory: its vertices and faces need"):
            read_mesh(tmp_path / f"{name}.obj")
        free(2 * need)
        check_obj(tmp_path, vertices + faces)
    free(20)
    check_obj(tmp_path, vertices * 100 + parts)  # a part has its own vertices only


@pytest.mark.parametrize("check", [check_obj, check_ply])
def test_words_of_a_long_line_are_counted_without_making_them(tmp_path, free, check):
    words = b"99999" + b" 11" * 100_000
    data = b"f " + words if check is check_obj else ply(faces=words)
    tracemalloc.start()
    try:
        free(100)
        check(tmp_path, data)
        assert tracemalloc.get_traced_memory()[1] < 4 * len(data)  # 14 times as many for a list of them
        free(10)
        with pytest.raises(ResourceError, match=r"its vertices and faces need 1[67] MB"):
            check(tmp_path, data)
    finally:
        tracemalloc.stop()


def test_text_with_triangles_and_quads_is_still_read(tmp_path):
    rows = b"".join(b"%d %d 0\n" % (i % 3, i // 3) for i in range(9))
    (tmp_path / "scan.ply").write_bytes(ply(rows, b"3 0 1 3\n4 1 2 5 4\n", 9, 2))
    assert len(read_mesh(tmp_path / "scan.ply").mesh) == 3
