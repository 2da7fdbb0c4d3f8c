"""COLMAP's text model: worked out by hand, read back by us, and by COLMAP itself where it is installed."""

import pytest
import torch

from cltransfer.errors import UsageError
from cltransfer.export.colmap import check_model, write_colmap
from cltransfer.scenes.posed.colmap_text import read_tables
from cltransfer.trajectory import Trajectory


def test_one_camera_worked_out_by_hand(tmp_path, still):
    write_colmap(tmp_path, still)
    assert (tmp_path / "cameras.txt").read_text().splitlines()[1:] == ["1 PINHOLE 200 100 50.0 50.0 100.0 50.0"]
    number, *pose, camera, name = (tmp_path / "images.txt").read_text().splitlines()[1].split()
    assert (number, camera, name) == ("1", "1", "frame_00001.png")
    half = 0.5**0.5  # a quarter turn about x, from z up to y down
    assert [float(value) for value in pose] == pytest.approx([half, half, 0, 0, -1, 3, -2])
    assert (tmp_path / "images.txt").read_text().endswith("png\n\n")  # no points


def test_a_lens_that_stays_is_one_camera(tmp_path, path):
    path.camera.K[:] = path.camera.K[0].clone()
    write_colmap(tmp_path, path)
    assert len((tmp_path / "cameras.txt").read_text().splitlines()) == 2
    assert {line.split()[8] for line in (tmp_path / "images.txt").read_text().splitlines()[1::2]} == {"1"}


def test_we_read_what_we_write(tmp_path, path: Trajectory):
    write_colmap(tmp_path, path)
    model = read_tables(tmp_path)
    assert [shot.name for shot in model.images] == [f"frame_{number:05d}.png" for number in range(1, 6)]
    assert len(model.cameras) == 5
    assert len(model.points) == 0


@pytest.mark.parametrize("name", ["cameras.txt", "images.bin", "points3D.txt"])
def test_a_model_that_photographs_have_made_stays(tmp_path, name):
    (tmp_path / name).write_text("# mine\n")
    with pytest.raises(UsageError, match=f"has a model of its own, {name}"):
        check_model(tmp_path)


def test_our_own_model_is_written_anew(tmp_path, path):
    write_colmap(tmp_path, path)
    check_model(tmp_path)
    check_model(tmp_path / "new")


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_binary_model_beside_ours_would_be_read_in_its_place(tmp_path, path, name):
    write_colmap(tmp_path, path)
    (tmp_path / name).write_bytes(bytes(8))
    with pytest.raises(UsageError, match=f"has a model of its own, {name}"):
        check_model(tmp_path)


def test_colmap_sees_what_we_see(tmp_path, path: Trajectory, seen):
    pycolmap = pytest.importorskip("pycolmap", reason="COLMAP is not installed: pip install -e '.[sfm]'")
    write_colmap(tmp_path, path)
    model = pycolmap.Reconstruction(str(tmp_path))
    assert len(model.images) == len(model.cameras) == 5
    for number, points in enumerate(seen, 1):
        image = model.images[number]
        for point, pixel in points:
            assert image.project_point(torch.tensor(point).double().numpy()) == pytest.approx(pixel, abs=1e-4)
