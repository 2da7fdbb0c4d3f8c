import json
import math
from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera, intrinsics
from cltransfer.errors import InputError
from cltransfer.export.nerfstudio import write_camera_path
from cltransfer.scenes.posed.transforms import OPENGL
from cltransfer.trajectory import Trajectory


def trajectory(frames: int = 5) -> Trajectory:
    generator = torch.Generator().manual_seed(3)
    eye = 3 * torch.randn(frames, 3, generator=generator, dtype=torch.float64) + torch.tensor([8.0, 0, 0]).double()
    target = torch.randn(frames, 3, generator=generator, dtype=torch.float64)
    fov = torch.linspace(0.3, 1.2, frames, dtype=torch.float64)
    camera = Camera.look_at(eye, target, torch.tensor([0.0, -1.0, 0.0]), fov, (1280, 720))
    return Trajectory(camera, torch.tensor([0.0, 0.04, 0.1, 0.13, 0.2][:frames], dtype=torch.float64))


def read_back(path: Path) -> Trajectory:
    """As nerfstudio reads it, with the times that it ignores."""
    data = json.loads(path.read_text())
    size, frames = (data["render_width"], data["render_height"]), data["camera_path"]
    poses = torch.tensor([frame["camera_to_world"] for frame in frames], dtype=torch.float64).reshape(-1, 4, 4)
    fov = torch.tensor([math.radians(frame["fov"]) for frame in frames], dtype=torch.float64)
    w2c = torch.linalg.inv(poses @ torch.from_numpy(OPENGL))
    camera = Camera(w2c, intrinsics(size[1] / (2 * torch.tan(fov / 2)), size), size)
    return Trajectory(camera, torch.tensor([frame["time"] for frame in frames], dtype=torch.float64))


def test_a_trajectory_comes_back_unchanged(tmp_path):
    before = trajectory()
    write_camera_path(tmp_path / "camera_path.json", before)
    after = read_back(tmp_path / "camera_path.json")
    assert (after.camera.w2c - before.camera.w2c).abs().max() < 1e-9
    assert (after.camera.K - before.camera.K).abs().max() < 1e-9
    assert torch.equal(after.times, before.times)
    assert after.camera.size == before.camera.size


def test_one_camera_worked_out_by_hand(tmp_path):
    # at (1, 2, 3) in a z-up world, looking along +y: right is +x, up is +z, so OpenGL's backward z is -y
    w2c = torch.tensor([[1.0, 0, 0, -1], [0, 0, -1, 3], [0, 1, 0, -2], [0, 0, 0, 1]]).double()[None]
    camera = Camera(w2c, intrinsics(torch.tensor([50.0]).double(), (200, 100)), (200, 100))
    write_camera_path(tmp_path / "path.json", Trajectory(camera, torch.zeros(1, dtype=torch.float64)))
    data = json.loads((tmp_path / "path.json").read_text())
    assert (data["camera_type"], data["render_width"], data["render_height"]) == ("perspective", 200, 100)
    frame = data["camera_path"][0]
    assert frame["camera_to_world"] == pytest.approx([1, 0, 0, 1, 0, 0, -1, 2, 0, 1, 0, 3, 0, 0, 0, 1])
    assert frame["fov"] == pytest.approx(90.0)  # 2 atan(100 / (2 * 50))
    assert frame["aspect"] == 2.0


def test_the_viewer_loads_what_is_rendered(tmp_path):
    before = trajectory()
    write_camera_path(tmp_path / "path.json", before)
    data = json.loads((tmp_path / "path.json").read_text())
    keys, frames = data["keyframes"], data["camera_path"]
    assert [key["matrix"] for key in keys] == [frame["camera_to_world"] for frame in frames]
    assert [(key["fov"], key["aspect"]) for key in keys] == [(frame["fov"], frame["aspect"]) for frame in frames]
    assert all(key["override_transition_enabled"] is True for key in keys)
    seconds = [key["override_transition_sec"] for key in keys]  # each since the keyframe before
    assert seconds == pytest.approx([0.05, 0.04, 0.06, 0.03, 0.07])
    assert data["default_transition_sec"] == pytest.approx(0.05)
    assert all(abs(key["fov"] - data.get("default_fov", 0.0)) > 1e-3 for key in keys)  # else it takes none of its own
    assert (data["is_cycle"], data["smoothness_value"]) == (False, 0)


def test_what_the_format_cannot_hold_is_refused(tmp_path):
    path = trajectory()
    path.camera.K[:, 0, 2] += 5
    with pytest.raises(InputError, match="principal point"):
        write_camera_path(tmp_path / "path.json", path)
    assert not (tmp_path / "path.json").exists()


def test_fov_is_vertical(tmp_path):
    write_camera_path(tmp_path / "path.json", trajectory())
    data = json.loads((tmp_path / "path.json").read_text())
    assert data["camera_path"][-1]["fov"] == pytest.approx(math.degrees(1.2))


def test_a_film_lasts_as_long_as_its_frames_are_shown(tmp_path):
    write_camera_path(tmp_path / "camera_path.json", trajectory())
    data = json.loads((tmp_path / "camera_path.json").read_text())
    assert data["seconds"] * data["fps"] == pytest.approx(len(data["camera_path"]))
