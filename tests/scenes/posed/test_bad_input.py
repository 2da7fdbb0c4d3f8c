"""What is wrong with a posed image set is said in one line, and nothing outside its folder is opened."""

from __future__ import annotations

import json
import struct
import time
import tracemalloc
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cltransfer.clips.frame import Frame
from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.posed import colmap_text, read_posed
from cltransfer.scenes.posed.assemble import find_image
from cltransfer.scenes.posed.llff import ROW
from cltransfer.scenes.posed.opencv_yaml import read_opencv_yaml

POSE = [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]
FRAME = {"file_path": "a.png", "transform_matrix": POSE}
SET = {"w": 8, "h": 6, "fl_x": 5.0, "frames": [FRAME]}


def write(root: Path, **changes: Any) -> Path:
    (root / "transforms.json").write_text(json.dumps({**SET, **changes}))
    return root


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"frames": []}, "images: expected 1 to"),
        ({"frames": 3}, "frames: expected a list"),
        ({"frames": [{"transform_matrix": POSE}]}, r"frames\[0\].file_path: expected the name"),
        ({"frames": [{"file_path": "a.png"}]}, r"frames\[0\].transform_matrix: expected 4 x 4"),
        ({"frames": [{**FRAME, "transform_matrix": [[2.0, 0, 0, 0], *POSE[1:]]}]}, "expected a rotation"),
        ({"frames": [{**FRAME, "file_path": "../a.png"}]}, r"../a.png: leads out of the folder"),
        ({"frames": [{**FRAME, "file_path": "/etc/a.png"}]}, "leads out of the folder"),
        ({"frames": [{**FRAME, "file_path": "a\0.png"}]}, r"'a\\x00.png': is no name of a file"),
        ({"frames": [{**FRAME, "file_path": "\ud800.png"}]}, "is no name of a file"),
        ({"frames": [{**FRAME, "file_path": "/"}]}, "'/': is no name of a file"),
        ({"camera_model": "OPENCV_FISHEYE"}, "OPENCV_FISHEYE cannot be straightened"),
        ({"k4": 0.1}, "fisheye cannot be straightened"),
        ({"fl_x": -1.0}, "expected finite intrinsics"),
        ({"p1": 5.0, "p2": 5.0}, r"frames\[0\]: a lens with the distortion 0, 0, 5, 5, 0 cannot be straightened"),
        ({"k1": 1e300}, r"the distortion 1e\+300, 0, 0, 0, 0 cannot be straightened .its image would fold or vanish"),
        ({"fl_x": "five"}, r"frames\[0\].fl_x: expected a number, got 'five'"),
        ({"w": 10**9}, "expected a width and a height"),
        ({"ply_file_path": "../points.ply"}, "leads out of the folder"),
        ({"fl_x": 10**400}, r"frames\[0\].fl_x: expected a finite number"),
        ({"w": float("inf")}, r"frames\[0\].w: expected a finite number"),
        ({"frames": [{**FRAME, "transform_matrix": [[10**400, 0, 0, 0], *POSE[1:]]}]}, "expected 4 x 4 finite numbers"),
    ],
)
def test_a_wrong_field_of_transforms_json_is_named(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=f"transforms.json: .*{says}"):
        read_posed(write(tmp_path, **changes))


@pytest.mark.parametrize(
    ("angle", "says"),
    [
        (0, "an angle above 0 and below pi, got 0"),
        (5e-324, "got 4.94066e-324"),
        (60, "got 60"),
        (float("inf"), "finite"),
    ],
)
def test_an_angle_that_no_lens_has_is_named(tmp_path: Path, angle: float, says: str) -> None:
    (tmp_path / "transforms.json").write_text(json.dumps({"w": 8, "h": 6, "camera_angle_x": angle, "frames": [FRAME]}))
    with pytest.raises(InputError, match=rf"transforms.json: frames\[0\].camera_angle_x: expected .*{says}"):
        read_posed(tmp_path)


@pytest.mark.parametrize(
    ("key", "value"),
    [("width", 10**400), ("rotation", [[10**400] * 3] * 3), ("position", None)],
    ids=["width", "rotation", "position"],
)
def test_a_wrong_field_of_cameras_json_is_named(tmp_path: Path, key: str, value: Any) -> None:
    camera = {"img_name": "a", "width": 8, "height": 6, "fx": 5, "fy": 5, "position": [0, 0, 0]}
    (tmp_path / "cameras.json").write_text(json.dumps([{**camera, "rotation": np.eye(3).tolist(), key: value}]))
    with pytest.raises(InputError, match=rf"cameras.json: \[0\].{key}: expected (a|3|3 x 3) finite number"):
        read_posed(tmp_path)


def test_a_link_that_leads_out_of_the_set_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "outside.png").write_bytes(b"")
    root = tmp_path / "set"
    root.mkdir()
    (root / "a.png").symlink_to(tmp_path / "outside.png")
    with pytest.raises(InputError, match=r"a.png: leads out of the folder"):
        read_posed(write(root))


def set_of(root: Path, kind: str) -> Path:
    """A set of no images that are there, in COLMAP's text, EasyMocap's or nerfstudio's files."""
    root.mkdir(parents=True)
    files = {
        "sparse/0/cameras.txt": "1 PINHOLE 8 6 5 5 4 3\n",
        "sparse/0/images.txt": "1 1 0 0 0 0 0 2 1 a.png\n\n",
        "sparse/0/points3D.txt": "1 0 0 0 9 9 9 0\n",
    }
    if kind != "colmap":
        files = {"transforms.json": json.dumps(SET)} if kind == "nerfstudio" else {"intri.yml": EASY, "extri.yml": EASY}
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


@pytest.mark.parametrize(
    ("kind", "linked"),
    [
        ("colmap", "sparse/0/cameras.txt"),
        ("colmap", "sparse/0/images.txt"),
        ("colmap", "sparse/0/points3D.txt"),
        ("colmap", "sparse/0"),
        ("colmap", "sparse"),
        ("nerfstudio", "transforms.json"),
        ("easymocap", "intri.yml"),
        ("easymocap", "extri.yml"),
    ],
)
def test_a_part_of_a_set_that_is_a_link_out_of_it_is_not_read(tmp_path: Path, kind: str, linked: str) -> None:
    root = set_of(tmp_path / "set", kind)
    (root / linked).rename(tmp_path / "outside")
    (root / linked).symlink_to(tmp_path / "outside")
    with pytest.raises(InputError, match=r"leads out of the folder of its set \(put the file itself there\)"):
        read_posed(root)


def test_a_set_that_is_named_by_a_link_or_links_to_what_it_holds_is_read(tmp_path: Path) -> None:
    root = set_of(tmp_path / "set", "colmap")
    (tmp_path / "mine").symlink_to(root)
    (root / "sparse" / "0").rename(root / "model")
    (root / "sparse" / "0").symlink_to(root / "model")
    for named in (root, tmp_path / "mine", root / "sparse" / "0", root / "model"):
        assert read_posed(named).names == ("a.png",)


def test_a_missing_image_is_named_when_it_is_asked_for(tmp_path: Path) -> None:
    posed = read_posed(write(tmp_path))
    assert posed.missing == ("a.png",)
    with pytest.raises(InputError, match=r"a.png: the image is missing"):
        posed.images([0], 8)


def test_a_name_that_no_file_can_have_for_its_length_is_one_that_is_missing(tmp_path: Path) -> None:
    posed = read_posed(write(tmp_path, frames=[{**FRAME, "file_path": "a" * 5000}]))
    with pytest.raises(InputError, match=r"aaa\.\.\.: the image is missing"):
        posed.images([0], 8)


def test_an_image_of_another_shape_is_refused(tmp_path: Path) -> None:
    import cv2

    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((6, 12, 3), np.uint8))
    with pytest.raises(InputError, match=r"a.png: size: expected the shape of 8x6, got \(12, 6\)"):
        read_posed(write(tmp_path)).images([0], 8)


def test_a_lens_of_any_size_does_not_enlarge_a_small_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import cv2

    made: list[tuple[int, int]] = []
    rgb = Frame.rgb

    def spied(frame: Frame, size: tuple[int, int], over_black: bool = False) -> np.ndarray:
        made.append(size)
        return rgb(frame, size, over_black)

    monkeypatch.setattr(Frame, "rgb", spied)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), np.full((6, 8, 3), 200, np.uint8))
    odd = {**FRAME, "file_path": "b.png", "w": 4096, "h": 3072}
    _, images = read_posed(write(tmp_path, frames=[FRAME, FRAME, odd])).images([0, 1, 2], 8)
    assert images.unique().tolist() == [200]
    assert made == [(8, 6)] * 3


@pytest.mark.parametrize("name", ["//host/share/a.png", r"\\host\share\a.png"])
def test_no_other_computer_is_asked_for_an_image(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.path.realpath", lambda path: pytest.fail("which Windows would follow"))
    with pytest.raises(InputError, match="leads out of the folder of the set"):
        find_image(tmp_path, name, tmp_path / "transforms.json")


def test_points_are_held_against_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    point = struct.pack("<Q3d3BdQ", 1, *[0.0] * 3, 1, 2, 3, 0.0, 0)
    posed = model(tmp_path, points3D=struct.pack("<Q", 10_000) + 10_000 * point)
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**19 + 2**14)
    with pytest.raises(ResourceError, match=r"points3D.bin: memory: 10000 points need 1 MB"):
        read_posed(posed)
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**18)
    with pytest.raises(ResourceError, match=r"points3D.bin: memory: its bytes need 0 MB"):
        read_posed(posed)


def test_what_is_no_set_says_what_would_be_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is no posed image set \(expected transforms.json"):
        read_posed(tmp_path)
    with pytest.raises(InputError, match="no such file or folder"):
        read_posed(tmp_path / "gone")
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(InputError, match=r"notes.txt: is no posed image set"):
        read_posed(tmp_path / "notes.txt")


def model(root: Path, **files: bytes) -> Path:
    folder = root / "sparse" / "0"
    folder.mkdir(parents=True)
    whole = {
        "cameras": struct.pack("<QIiQQ4d", 1, 1, 1, 8, 6, 5, 5, 4, 3),
        "images": struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0, 0, 2, 1) + b"a.png\0" + struct.pack("<Q", 0),
    }
    for name, data in (whole | files).items():
        (folder / f"{name}.bin").write_bytes(data)
    return root


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ({"cameras": b"\1\0\0"}, "cameras.bin: body: cut off"),
        ({"cameras": struct.pack("<Q", 2**60)}, "cameras.bin: cameras: expected at most"),
        ({"cameras": struct.pack("<QIiQQ4d", 1, 1, 99, 8, 6, 5, 5, 4, 3)}, "lens model 99 is not known here"),
        ({"cameras": struct.pack("<QIiQQ8d", 1, 1, 5, 8, 6, *[1.0] * 8)}, "lens OPENCV_FISHEYE cannot be straightened"),
        ({"cameras": struct.pack("<QIiQQ4d", 1, 2, 1, 8, 6, 5, 5, 4, 3)}, "camera 1, which is not in the model"),
        ({"images": struct.pack("<Q", 1)}, "images.bin: body: cut off"),
        ({"images": struct.pack("<QI7dI", 1, 1, 0, 0, 0, 0, 0, 0, 2, 1) + b"a\0" + bytes(8)}, "expected finite"),
        ({"images": struct.pack("<QI7dI", 1, 1, 1, *[0] * 6, 1) + b"a.png\0" + struct.pack("<Q", 9)}, "cut off"),
        ({"images": struct.pack("<QI7dI", 1, 1, 1, *[0] * 6, 1) + b"../a.png\0" + bytes(8)}, "leads out of the"),
        ({"points3D": struct.pack("<Q", 10**6)}, "points3D.bin: body: cut off"),
    ],
)
def test_a_damaged_binary_model_is_named(tmp_path: Path, files: dict[str, bytes], says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_posed(model(tmp_path, **files))


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("cameras", "1 EUCM 8 6 5 5 4 3 1 1", r"cameras.txt: line 1: lens model EUCM is not known here \(run: colmap"),
        ("cameras", "1 PINHOLE 8 6 5 5 4", r"cameras.txt: line 1: expected CAMERA_ID"),
        ("cameras", "1 PINHOLE 8 6 5 5 4 x", r"cameras.txt: line 1: expected numbers"),
        ("cameras", "1" * 5000 + " PINHOLE 8 6 5 5 4 3", r"cameras.txt: line 1: expected CAMERA_ID"),
        ("images", f"1 1 0 0 0 0 0 2 {'1' * 5000} a.png", r"images.txt: line 1: expected IMAGE_ID"),
        ("images", "1 1 0 0 0 0 0 2 1", r"images.txt: line 1: expected IMAGE_ID"),
        ("images", "1 1 0 0 0 0 0 2 1 a.png\n2 1 0 0 0 0 0 2 1 b.png", r"images.txt: line 2: expected X Y POINT3D_ID"),
        ("points3D", "1 0 0 0 1 1", r"points3D.txt: line 1: expected POINT3D_ID"),
        ("points3D", "1 0 0 0 9 9 9 0\n2 0 0 0 300 9 -1 0", r"points3D.txt: point 2: .* 0 to 255, got 300 9 -1"),
        ("points3D", "1 0 0 0 nan 9 9 0", r"points3D.txt: point 1: .* 0 to 255, got nan 9 9"),
    ],
)
def test_a_bad_line_of_a_text_model_is_named(tmp_path: Path, name: str, text: str, says: str) -> None:
    files = {"cameras": "1 PINHOLE 8 6 5 5 4 3\n", "images": "1 1 0 0 0 0 0 2 1 a.png\n\n", name: text + "\n"}
    for stem, content in files.items():
        (tmp_path / f"{stem}.txt").write_text(content)
    with pytest.raises(InputError, match=says):
        read_posed(tmp_path)


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_point_that_is_nowhere_is_named(tmp_path: Path, value: str) -> None:
    files = {"cameras": "1 PINHOLE 8 6 5 5 4 3\n", "images": "1 1 0 0 0 0 0 2 1 a.png\n\n"}
    for stem, content in {**files, "points3D": f"1 0 0 1 1 1 1 0.5\n2 {value} 0 0 1 1 1 0.5\n"}.items():
        (tmp_path / f"{stem}.txt").write_text(content)
    with pytest.raises(InputError, match="points: expected finite numbers, got NaN or infinity"):
        read_posed(tmp_path)


def test_a_text_model_is_read_line_by_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images = "1 1 0 0 0 0 0 2 1 a.png\n" + "\n" * 400_000
    for stem, content in {"cameras": "1 PINHOLE 8 6 5 5 4 3\n", "images": images}.items():
        (tmp_path / f"{stem}.txt").write_text(content)
    (tmp_path / "points3D.txt").write_text("1 0 0 0 1 1 1 0\n" * 20_000)
    read_posed(tmp_path)
    tracemalloc.start()
    assert len(read_posed(tmp_path)) == 1
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 4 * 2**20  # the points take 1 MB as numbers and once more as an array
    monkeypatch.setattr(colmap_text, "LINE_LIMIT", 20)
    with pytest.raises(InputError, match=r"cameras.txt: line 1: expected at most 20 characters"):
        read_posed(tmp_path)


def test_a_text_model_of_too_many_cameras_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(colmap_text, "IMAGE_LIMIT", 2)
    (tmp_path / "cameras.txt").write_text("".join(f"{i} PINHOLE 8 6 5 5 4 3\n" for i in range(3)))
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 2 1 a.png\n\n")
    with pytest.raises(InputError, match=r"cameras.txt: cameras: expected at most 2"):
        read_posed(tmp_path)


def save(root: Path, array: Any) -> None:
    np.save(root / "poses_bounds.npy", array, allow_pickle=True)


def archive(root: Path) -> None:
    with (root / "poses_bounds.npy").open("wb") as stream:
        np.savez(stream, a=np.zeros((2, ROW)))


def nested(root: Path) -> None:
    """A header of more signs in a row than Python's parser takes."""
    header = b"-" * 9000 + b"1\n"
    (root / "poses_bounds.npy").write_bytes(b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header)


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': (), 'fortran_order': False, 'shape': (1, 17)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (True, 17)}",
        "{[]: 1}",
        "a\n  b\n c",
    ],
)
def test_a_poses_bounds_whose_header_is_no_table_is_named(tmp_path: Path, header: str) -> None:
    start = b"\x93NUMPY\1\0" + struct.pack("<H", len(header))
    (tmp_path / "poses_bounds.npy").write_bytes(start + header.encode() + bytes(17 * 8))
    with pytest.raises(InputError, match=r"poses_bounds.npy: not a NumPy file: \S"):
        read_posed(tmp_path)


def headed(root: Path, shape: tuple[int, int]) -> None:
    """A file whose header promises ``shape`` of what it does not hold."""
    with (root / "poses_bounds.npy").open("wb") as stream:
        np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})


@pytest.mark.parametrize(
    ("prepare", "says"),
    [
        (lambda root: save(root, np.zeros((2, 16))), r"shape: expected \(N, 17\)"),
        (lambda root: save(root, np.array([{}], dtype=object)), "not a NumPy file"),
        (lambda root: (root / "poses_bounds.npy").write_bytes(b"\x93NUMPY"), "not a NumPy file"),
        (lambda root: (root / "poses_bounds.npy").write_bytes(b"PK\x03\x04abc"), "not a NumPy file"),
        (lambda root: (root / "poses_bounds.npy").write_bytes(b""), "not a NumPy file"),
        (lambda root: (root / "poses_bounds.npy").write_bytes(b"\x93NUMPY\1\0\4\0{'(\n"), "not a NumPy file"),
        (archive, "not a NumPy file"),
        (nested, r"poses_bounds.npy: not a NumPy file: \S"),
        (lambda root: headed(root, (10**30, ROW)), "not a NumPy file"),
        (lambda root: headed(root, (-1, ROW)), "not a NumPy file|shape"),
        (lambda root: save(root, np.full((1, 17), np.nan)), "row 0: expected"),
    ],
)
def test_a_bad_poses_bounds_is_named(tmp_path: Path, prepare: Callable[[Path], None], says: str) -> None:
    prepare(tmp_path)
    with pytest.raises(InputError, match=says):
        read_posed(tmp_path)


def test_as_many_llff_images_as_rows_are_expected(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a.png").write_bytes(b"")
    save(tmp_path, np.zeros((3, 17)))
    with pytest.raises(InputError, match="rows: holds 3, there are 1 images"):
        read_posed(tmp_path)


EASY = '%YAML:1.0\n---\nnames:\n   - "1"\nK_1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {} ]\n'


@pytest.mark.parametrize(
    ("intri", "says"),
    [
        ("names: [1]", "intri.yml: header: expected %YAML"),
        ("%YAML:1.0\n---\n", "names: expected a list"),
        (EASY.format("1, 2, 3"), "K_1: expected 3 x 3 finite numbers, got 3"),
        (EASY.format("1, a"), "K_1: expected numbers in data"),
        (EASY.replace("3", "[3]", 1).format("1"), r"K_1: expected whole numbers in rows and cols, got \[3\] and 3"),
        (EASY.replace("3", "3" * 5000, 1).format("1"), "expected whole numbers in rows and cols, got 3{20} and 3"),
        (EASY.format("5, 0, 4, 0, 5, 3, 0, 0, 1"), "Rot_1: expected a 3 x 3 matrix, it is missing"),
        (EASY.format("5, 0, 4, 0, 5, 3, 0, 0, 1") + "dist_1: 3\n", "dist_1: expected a matrix"),
        ('%YAML:1.0\n---\nnames:\n   - "../../x"\n', "leads out of the folder"),
    ],
)
def test_a_bad_calibration_of_easymocap_is_named(tmp_path: Path, intri: str, says: str) -> None:
    (tmp_path / "intri.yml").write_text(intri + ("W_1: 8\nH_1: 6\n" if intri.startswith("%") else ""))
    (tmp_path / "extri.yml").write_text("%YAML:1.0\n---\n")
    with pytest.raises(InputError, match=says):
        read_posed(tmp_path)


@pytest.mark.parametrize(
    ("entry", "line"), [("names:", " "), ("K_1: !!opencv-matrix", " "), ("K_1: !!opencv-matrix", "  data: [")]
)
def test_many_odd_lines_of_a_calibration_take_no_longer_than_others(tmp_path: Path, entry: str, line: str) -> None:
    path = tmp_path / "intri.yml"
    path.write_text(f"%YAML:1.0\n---\n{entry}\n" + f"{line}\n" * 40_000 + " x\n")
    start = time.process_time()
    with pytest.raises(InputError) if "matrix" in entry else nullcontext():
        read_opencv_yaml(path)
    assert time.process_time() - start < 1


def test_a_pose_that_mirrors_is_none(tmp_path: Path) -> None:
    Image.new("RGB", (8, 6)).save(tmp_path / "a.png")
    pose = [[-1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]
    frame = {"file_path": "a.png", "transform_matrix": pose}
    (tmp_path / "transforms.json").write_text(json.dumps({"w": 8, "h": 6, "fl_x": 5.0, "frames": [frame]}))
    with pytest.raises(InputError, match="expected a rotation"):
        read_posed(tmp_path)
