import json
import math
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.camera import Camera, intrinsics
from cltransfer.errors import InputError
from cltransfer.export.nerfstudio import read_camera_path, write_camera_path
from cltransfer.trajectory import Trajectory


def trajectory(frames: int = 5) -> Trajectory:
    generator = torch.Generator().manual_seed(3)
    eye = 3 * torch.randn(frames, 3, generator=generator, dtype=torch.float64) + torch.tensor([8.0, 0, 0]).double()
    target = torch.randn(frames, 3, generator=generator, dtype=torch.float64)
    fov = torch.linspace(0.3, 1.2, frames, dtype=torch.float64)
    camera = Camera.look_at(eye, target, torch.tensor([0.0, -1.0, 0.0]), fov, (1280, 720))
    return Trajectory(camera, torch.tensor([0.0, 0.04, 0.1, 0.13, 0.2][:frames], dtype=torch.float64))


def written(path: Path, **changes: Any) -> Path:
    """A good file with fields replaced; ``first`` replaces fields of the first camera."""
    write_camera_path(path, trajectory())
    data = json.loads(path.read_text())
    data["camera_path"][0].update(changes.pop("first", {}))
    path.write_text(json.dumps({**data, **changes}))
    return path


def test_a_trajectory_comes_back_unchanged(tmp_path):
    before = trajectory()
    write_camera_path(tmp_path / "camera_path.json", before)
    after = read_camera_path(tmp_path / "camera_path.json")
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


def test_without_own_times_the_frame_rate_counts(tmp_path):
    path = written(tmp_path / "path.json", fps=10)
    data = json.loads(path.read_text())
    for frame in data["camera_path"]:
        del frame["time"]
    path.write_text(json.dumps(data))
    assert read_camera_path(path).times.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera_type": "fisheye"}, "camera_type: expected 'perspective', got 'fisheye'"),
        ({"camera_path": []}, "camera_path: expected a list of 1 to 2000 cameras"),
        ({"camera_path": [7]}, r"camera_path\[0\]: expected an object"),
        ({"render_height": "720"}, r"render_height: expected a number in \[1, 16384\], got '720'"),
        ({"first": {"fov": 180}}, r"camera_path\[0\]\.fov: expected a number"),
        ({"first": {"fov": float("nan")}}, r"camera_path\[0\]\.fov: expected a number"),
        ({"first": {"camera_to_world": [1, 2]}}, r"camera_path\[0\]\.camera_to_world: expected 16 numbers"),
        ({"first": {"camera_to_world": [10**400] * 16}}, r"camera_path\[0\]\.camera_to_world: expected 16 numbers"),
        (
            {"first": {"camera_to_world": [[1] * 3, 2]}},
            r"camera_path\[0\]\.camera_to_world: expected 16 numbers",
        ),
        (
            {"first": {"camera_to_world": [2.0] * 16}},
            r"camera_path\[0\]\.camera_to_world: expected a rotation",
        ),
        ({"first": {"time": 9.0}}, "camera_path: expected times that increase"),
    ],
)
def test_a_bad_field_is_named_in_one_line(tmp_path, changes, message):
    with pytest.raises(InputError, match=message) as error:
        read_camera_path(written(tmp_path / "path.json", **changes))
    assert "\n" not in str(error.value)


def test_a_mirrored_pose_is_refused(tmp_path):
    mirrored = torch.diag(torch.tensor([-1.0, 1, 1, 1])).flatten().tolist()
    with pytest.raises(InputError, match="expected a rotation"):
        read_camera_path(written(tmp_path / "path.json", first={"camera_to_world": mirrored}))


def test_another_json_is_not_a_camera_path(tmp_path):
    (tmp_path / "x.json").write_text("[1]")
    with pytest.raises(InputError, match="is it a nerfstudio camera path"):
        read_camera_path(tmp_path / "x.json")


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
