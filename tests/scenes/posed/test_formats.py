"""One set of three cameras written in every format, by that format's own convention, must read back as itself."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from kornia.geometry.conversions import rotation_matrix_to_quaternion

from cltransfer.camera import Camera
from cltransfer.errors import ResourceError, UsageError
from cltransfer.scenes.posed import named_camera, read_posed

SIZE = (64, 48)
FOCAL = 60.0
NAMES = ("cam2.png", "cam9.png", "cam10.png")
POINT = torch.tensor([[0.3, -0.2, 0.5]], dtype=torch.float64)


def truth() -> Camera:
    eyes = torch.tensor([[3.0, 1, -4], [-2, 2, -3], [1, -1, 5]], dtype=torch.float64)
    up = torch.tensor([0.0, 0, 1])
    return Camera.look_at(eyes, POINT + 0.4, up, 2 * math.atan(SIZE[1] / (2 * FOCAL)), SIZE)


def write_images(folder: Path) -> None:
    """Each image has its own grey: 20, 40, 60."""
    folder.mkdir(parents=True)
    for index, name in enumerate(NAMES):
        cv2.imwrite(str(folder / name), np.full((SIZE[1], SIZE[0], 3), 20 * (index + 1), np.uint8))


def write_transforms(root: Path) -> None:
    write_images(root / "images")
    poses = truth().c2w.numpy().copy()
    poses[:, :3, 1:3] *= -1  # y up, z backward
    frames = [{"file_path": f"images/{name}", "transform_matrix": p.tolist()} for name, p in zip(NAMES, poses)]
    data = {"w": SIZE[0], "h": SIZE[1], "fl_x": FOCAL, "cx": SIZE[0] / 2, "cy": SIZE[1] / 2, "frames": frames}
    (root / "transforms.json").write_text(json.dumps(data))


def write_inria(root: Path) -> None:
    write_images(root / "images")
    c2w = truth().c2w.numpy()
    entries = [
        {"id": i, "img_name": name.removesuffix(".png"), "width": SIZE[0], "height": SIZE[1], "fx": FOCAL, "fy": FOCAL,
         "position": pose[:3, 3].tolist(), "rotation": pose[:3, :3].tolist()}
        for i, (name, pose) in enumerate(zip(NAMES, c2w))
    ]  # fmt: skip
    (root / "cameras.json").write_text(json.dumps(entries))


def write_llff(root: Path) -> None:
    """Rows stand as the letters of the names do: cam10, cam2, cam9."""
    write_images(root / "images")
    rows = []
    for _, pose in sorted(zip(NAMES, truth().c2w.numpy()), key=lambda pair: pair[0]):
        right, down, forward = pose[:3, :3].T
        matrix = np.stack([down, right, -forward, pose[:3, 3], [SIZE[1], SIZE[0], FOCAL]], axis=1)
        rows.append([*matrix.reshape(-1), 0.5, 9.0])
    np.save(root / "poses_bounds.npy", np.array(rows))


def matrix_text(name: str, values: np.ndarray) -> str:
    numbers = ",\n      ".join(f"{value:.17g}" for value in values.reshape(-1))
    rows, cols = values.shape
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {numbers} ]\n"


def write_easymocap(root: Path) -> None:
    write_images(root / "images")
    names = [name.removesuffix(".png") for name in NAMES]
    head = "%YAML:1.0\n---\nnames:\n" + "".join(f'   - "{name}"\n' for name in names)
    K = np.array([[FOCAL, 0, SIZE[0] / 2 - 0.5], [0, FOCAL, SIZE[1] / 2 - 0.5], [0, 0, 1]])  # first pixel's centre is 0
    (root / "intri.yml").write_text(
        head + "".join(matrix_text(f"K_{n}", K) + matrix_text(f"dist_{n}", np.zeros((1, 5))) for n in names)
    )
    poses = zip(names, truth().w2c.numpy())
    (root / "extri.yml").write_text(
        head + "".join(matrix_text(f"Rot_{n}", p[:3, :3]) + matrix_text(f"T_{n}", p[:3, 3:]) for n, p in poses)
    )


def colmap_rows() -> list[tuple[int, list[float], str]]:
    """Image id, quaternion and translation, name; ids in another order than the names."""
    w2c = truth().w2c
    quats = rotation_matrix_to_quaternion(w2c[:, :3, :3])
    return [(7 - i, [*quats[i].tolist(), *w2c[i, :3, 3].tolist()], name) for i, name in enumerate(NAMES)]


def write_colmap_text(root: Path) -> None:
    write_images(root / "images")
    model = root / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text(f"# a camera\n1 SIMPLE_PINHOLE {SIZE[0]} {SIZE[1]} {FOCAL} 32 24\n")
    lines = [f"{i} {' '.join(map(repr, pose))} 1 {name}\n12.5 3 -1\n" for i, pose, name in colmap_rows()]
    (model / "images.txt").write_text("# two lines each\n" + "".join(lines[:-1]) + lines[-1].splitlines()[0] + "\n\n")
    (model / "points3D.txt").write_text("# points\n5 0.3 -0.2 0.5 10 20 30 0.7 7 0 6 1\n")


def write_colmap_binary(root: Path) -> None:
    write_images(root / "images")
    model = root / "sparse" / "0"
    model.mkdir(parents=True)
    camera = struct.pack("<QIiQQ4d", 1, 1, 1, *SIZE, FOCAL, FOCAL, 32, 24)
    (model / "cameras.bin").write_bytes(camera)
    seen = struct.pack("<Qddq", 1, 12.5, 3, -1)
    images = [struct.pack("<I7dI", i, *pose, 1) + name.encode() + b"\0" + seen for i, pose, name in colmap_rows()]
    (model / "images.bin").write_bytes(struct.pack("<Q", len(images)) + b"".join(images))
    point = struct.pack("<QQ3d3BdQ4I", 1, 5, 0.3, -0.2, 0.5, 10, 20, 30, 0.7, 2, 7, 0, 6, 1)
    (model / "points3D.bin").write_bytes(point)


WRITERS = [write_transforms, write_inria, write_llff, write_easymocap, write_colmap_text, write_colmap_binary]


@pytest.mark.parametrize("write", WRITERS)
def test_a_known_point_falls_where_it_should(tmp_path: Path, write: Callable[[Path], None]) -> None:
    write(tmp_path)
    posed = read_posed(tmp_path)
    order = [[Path(name).stem for name in posed.names].index(Path(name).stem) for name in NAMES]
    pixels, depth = posed.camera[order].project(POINT)
    expected, distance = truth().project(POINT)
    torch.testing.assert_close(pixels, expected, rtol=0, atol=1e-6)
    torch.testing.assert_close(depth, distance, rtol=0, atol=1e-6)
    assert posed.camera.size == SIZE
    assert posed.missing == ()


@pytest.mark.parametrize("write", [write_inria, write_easymocap])
def test_a_name_without_a_suffix_finds_the_files_of_cameras_in_capitals(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    write(tmp_path)
    for name in NAMES:
        (tmp_path / "images" / name).rename(tmp_path / "images" / name.replace(".png", ".PNG"))
    assert read_posed(tmp_path).missing == ()


@pytest.mark.parametrize("write", [write_llff, write_easymocap])
def test_hidden_files_as_a_mac_leaves_them_are_no_images(tmp_path: Path, write: Callable[[Path], None]) -> None:
    write(tmp_path)
    images = [tmp_path / "images" / name for name in NAMES]
    if write is write_easymocap:  # a folder of frames for each camera
        for image in images:
            image.with_suffix("").mkdir()
            image.rename(image.with_suffix("") / "frame_0.png")
        images = [image.with_suffix("") / "frame_0.png" for image in images]
    for image in images:
        (image.parent / f"._{image.name}").write_bytes(b"\0\5\x16\7")
    posed = read_posed(tmp_path)
    assert sorted(file for file in posed.files if file is not None) == sorted(images)


def test_blank_lines_of_colmap_end_nothing(tmp_path: Path) -> None:
    write_colmap_text(tmp_path)
    file = tmp_path / "sparse" / "0" / "images.txt"
    head, *lines = file.read_text().splitlines()
    pairs = ["\n".join(lines[i : i + 2]) for i in range(0, len(lines), 2)]
    file.write_text("\n\n".join([head, *pairs, "", ""]))
    assert set(read_posed(tmp_path).names) == set(NAMES)


def write_blender(root: Path) -> None:
    """As the synthetic scenes of NeRF are: no size, names without suffixes, and other views to test on."""
    write_transforms(root)
    frames = json.loads((root / "transforms.json").read_text())["frames"]
    (root / "transforms.json").unlink()
    frames = [{**frame, "file_path": f"./{frame['file_path'].removesuffix('.png')}"} for frame in frames]
    for kind, some in (("train", frames), ("test", frames[1:])):
        data = {"camera_angle_x": 2 * math.atan(SIZE[0] / (2 * FOCAL)), "frames": some}
        (root / f"transforms_{kind}.json").write_text(json.dumps(data))


def test_of_a_blender_set_the_views_to_train_on_are_read(tmp_path: Path) -> None:
    write_blender(tmp_path)
    posed = read_posed(tmp_path)
    assert (posed.path, len(posed), posed.missing) == (tmp_path / "transforms_train.json", 3, ())
    torch.testing.assert_close(posed.camera.project(POINT)[0], truth().project(POINT)[0], rtol=0, atol=1e-6)
    write_colmap_text(tmp_path / "model")
    (tmp_path / "model" / "sparse").rename(tmp_path / "sparse")
    assert read_posed(tmp_path).points is not None


def test_of_a_model_and_what_llff_made_of_it_the_model_is_read(tmp_path: Path) -> None:
    write_llff(tmp_path)
    write_colmap_text(tmp_path / "model")
    (tmp_path / "model" / "sparse").rename(tmp_path / "sparse")
    cameras = tmp_path / "sparse" / "0" / "cameras.txt"
    cameras.write_text(f"1 OPENCV {SIZE[0]} {SIZE[1]} {FOCAL} {1.1 * FOCAL} 32 24 0.01 0 0 0\n")
    posed = read_posed(tmp_path)
    assert posed.points is not None
    assert posed.lenses[0].focal == (FOCAL, 1.1 * FOCAL)
    assert posed.lenses[0].bends
    assert posed.missing == ()
    named = read_posed(tmp_path / "poses_bounds.npy")
    assert (named.points, named.lenses[0].focal, named.lenses[0].bends) == (None, (FOCAL, FOCAL), False)


@pytest.mark.parametrize("write", WRITERS)
def test_each_image_belongs_to_its_camera(tmp_path: Path, write: Callable[[Path], None]) -> None:
    write(tmp_path)
    posed = read_posed(tmp_path)
    order = [[Path(name).stem for name in posed.names].index(Path(name).stem) for name in NAMES]
    camera, image = posed.images(order, 32)
    assert camera.size == (32, 24)
    assert image.shape == (3, 3, 24, 32)
    assert image.float().mean((1, 2, 3)).tolist() == pytest.approx([20, 40, 60], abs=1)
    pixels = camera.project(POINT)[0]
    torch.testing.assert_close(pixels, truth().project(POINT)[0] / 2, rtol=0, atol=1e-6)


@pytest.mark.parametrize("write", [write_transforms, write_inria, write_easymocap, write_colmap_text])
def test_an_image_that_is_not_there_is_named_and_keeps_its_camera(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    write(tmp_path)
    for file in tmp_path.rglob("cam9.png"):
        file.unlink()
    if write is write_easymocap:  # which has no other way to say how large its images are
        intri = tmp_path / "intri.yml"
        intri.write_text(intri.read_text() + "W_cam9: 64\nH_cam9: 48\n")
    posed = read_posed(tmp_path)
    assert [Path(name).stem for name in posed.missing] == ["cam9"]
    assert len(posed) == 3
    assert len(posed.present) == 2


@pytest.mark.parametrize("write", [write_colmap_text, write_colmap_binary])
def test_points_of_a_model_come_with_their_colors(tmp_path: Path, write: Callable[[Path], None]) -> None:
    write(tmp_path)
    posed = read_posed(tmp_path / "sparse" / "0")
    assert posed.points is not None
    assert posed.colors is not None
    assert posed.points.tolist() == [[0.3, -0.2, 0.5]]
    assert posed.colors.tolist() == [[10, 20, 30]]
    assert posed.missing == ()


def test_the_first_frame_of_a_video_stands_for_its_camera(tmp_path: Path) -> None:
    from cltransfer.clips.clip import write_video

    write_llff(tmp_path)
    for file in (tmp_path / "images").iterdir():
        file.unlink()
    (tmp_path / "images").rmdir()
    for index in range(3):
        frames = torch.full((2, 3, SIZE[1], SIZE[0]), 40 * (index + 1), dtype=torch.uint8)
        write_video(tmp_path / f"cam{index + 8}.mkv", frames, torch.tensor([0.0, 0.1]), lossless=True)
    posed = read_posed(tmp_path)
    assert posed.names == ("cam10.mkv", "cam8.mkv", "cam9.mkv")
    assert posed.images([0], 64)[1].unique().tolist() == [120]


def test_intrinsics_of_a_frame_go_before_those_of_the_set(tmp_path: Path) -> None:
    write_transforms(tmp_path)
    data = json.loads((tmp_path / "transforms.json").read_text())
    data["frames"][1]["fl_x"] = 90.0
    del data["fl_x"], data["w"]
    data["camera_angle_x"] = 2 * math.atan(32 / FOCAL)  # as the Blender sets have it; the size is the image's
    (tmp_path / "transforms.json").write_text(json.dumps(data))
    assert read_posed(tmp_path).camera.focal.tolist() == pytest.approx([FOCAL, 90.0, FOCAL])


def test_a_set_in_a_folder_called_colmap_has_its_images(tmp_path: Path) -> None:
    write_colmap_text(tmp_path / "colmap")
    assert read_posed(tmp_path / "colmap").missing == ()


def test_images_that_do_not_fit_in_memory_are_refused_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_transforms(tmp_path)
    posed = read_posed(tmp_path)
    for path in (tmp_path / "images").iterdir():
        path.unlink()
    monkeypatch.setattr("cltransfer.computer.memory.free_bytes", lambda: 1000)
    with pytest.raises(ResourceError, match=r"3 images of 64x48 .*take a smaller side"):
        posed.images(range(3), 64)


@pytest.mark.parametrize("index", ["-1", "first", ""])
def test_an_index_that_is_none_is_told_of_a_set_that_is_there(tmp_path: Path, index: str) -> None:
    with pytest.raises(UsageError, match=f"--init: expected a whole number from 0 behind the colon, got '{index}'$"):
        named_camera(f"{tmp_path}:{index}", "--init")
    assert named_camera(f"{tmp_path / 'gone'}:{index}", "--init") is None
    (tmp_path / f"a:{index}").mkdir()
    assert named_camera(f"{tmp_path / 'a'}:{index}", "--init") is None


def test_a_lens_of_a_frame_goes_before_that_of_the_set_that_is_there_too(tmp_path: Path) -> None:
    write_transforms(tmp_path)
    data = json.loads((tmp_path / "transforms.json").read_text())
    data["frames"][1]["fl_x"] = 90.0
    (tmp_path / "transforms.json").write_text(json.dumps(data))
    assert read_posed(tmp_path).camera.K[:, 0, 0].tolist() == pytest.approx([FOCAL, 90.0, FOCAL])
