"""Points beside the images: binary or text, and what is wrong with them in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.posed import read_posed
from cltransfer.scenes.posed.points_ply import read_points

POSITION = "".join(f"property float {name}\n" for name in "xyz")
COLOR = "".join(f"property uint8 {name}\n" for name in ("red", "green", "blue"))
ROWS = "0.5 -1 2e-1 1 2 3\n4 5 6 7 8 255\n"


def written(path: Path, rows: str = ROWS, count: int = 2, columns: str = POSITION + COLOR) -> Path:
    """Points as nerfstudio writes them."""
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex {count}\n{columns}end_header\n{rows}")
    return path


def test_faces_of_which_there_are_none_are_no_fault(tmp_path: Path) -> None:
    faces = "element face 0\nproperty list uchar int vertex_indices\n"
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex 2\n{POSITION}{faces}end_header\n"
    (tmp_path / "cloud.ply").write_bytes(header.encode() + np.arange(6, dtype="<f4").tobytes())
    assert read_points(tmp_path / "cloud.ply")[0].tolist() == [[0, 1, 2], [3, 4, 5]]


def test_text_is_read_as_the_same_points_in_binary_are(tmp_path: Path) -> None:
    points, colors = read_points(written(tmp_path / "text.ply"))
    assert points.tolist() == [[0.5, -1, np.float32(0.2)], [4, 5, 6]]
    assert colors is not None
    assert colors.tolist() == [[1, 2, 3], [7, 8, 255]]
    kinds = [(name, "<f4") for name in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")]
    table = np.array([(*p, *c) for p, c in zip(points, colors)], kinds)
    PlyData([PlyElement.describe(table, "vertex")], byte_order="<").write(str(tmp_path / "binary.ply"))
    for found, wanted in zip(read_points(tmp_path / "binary.ply"), (points, colors)):
        np.testing.assert_array_equal(found, wanted)
    assert read_points(written(tmp_path / "bare.ply", "1 2 3\n", 1, POSITION))[1] is None


def test_a_set_with_points_in_text_is_read_and_no_points_are_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
    data = {"w": 8, "h": 6, "fl_x": 5.0, "frames": [frame], "ply_file_path": "sparse_pc.ply"}
    (tmp_path / "transforms.json").write_text(json.dumps(data))
    assert read_posed(tmp_path).points is None
    assert [message.partition(": ")[2] for message in caplog.messages] == [
        "ply_file_path: no such file, the set has no points: sparse_pc.ply"
    ]
    written(tmp_path / "sparse_pc.ply")
    points = read_posed(tmp_path).points
    assert points is not None
    assert points.shape == (2, 3)
    written(tmp_path / "sparse_pc.ply", "", 0)
    assert read_posed(tmp_path).points is None


@pytest.mark.parametrize(
    ("rows", "count", "says"),
    [
        ("1 2 3 4 5 6\n", 2, "row 1: early end-of-file"),
        ("1 2 3 4 5 six\n", 1, "property 'blue': malformed input"),
        ("1 2 3 4 5 300\n", 1, "300 out of bounds"),
        ("1 2 3 4 5\n", 1, "early end-of-line"),
        ("1 2 nan 4 5 6\n", 1, "property x, y, z: expected finite numbers"),
        (ROWS, 1, "lines follow the last element"),
        (ROWS, 10**8, "asks for more than the file holds"),
    ],
)
def test_a_damaged_text_is_refused_in_one_line(tmp_path: Path, rows: str, count: int, says: str) -> None:
    with pytest.raises(InputError, match=f"points.ply: .*{says}") as caught:
        read_points(written(tmp_path / "points.ply", rows, count))
    assert "\n" not in str(caught.value)


def test_a_count_of_more_digits_than_python_reads_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "points.ply")
    path.write_text(path.read_text().replace("vertex 2", "vertex " + "1" * 5000))
    with pytest.raises(InputError, match=r"points.ply: header: 'element vertex 1+' asks for more"):
        read_points(path)


def test_columns_that_are_no_points_are_refused(tmp_path: Path) -> None:
    for rows, x in (("1 2 3\n", "float a"), ("1 1 2 3\n", "list uchar float x")):
        with pytest.raises(InputError, match="property x, y, z: is missing"):
            read_points(written(tmp_path / "points.ply", rows, 1, POSITION.replace("float x", x)))


def test_a_text_is_held_against_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "points.ply", ROWS * 5000, 10_000)
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**20)
    with pytest.raises(ResourceError, match=r"memory: .* need"):
        read_points(path)
