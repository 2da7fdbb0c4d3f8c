"""A path between its frames, and as it is saved and read back, refused when damaged."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix

from cltransfer.camera import Camera
from cltransfer.errors import InputError
from cltransfer.trajectory import Trajectory

UP = torch.tensor([0.0, 0, 1], dtype=torch.float64)


def dolly_zoom_around(times: torch.Tensor) -> Trajectory:
    """An orbit that draws nearer while the lens widens: every quantity moves, none in a straight line."""
    turn, distance = 1.5 * times, 3 + torch.cos(times)
    eye = torch.stack([distance * torch.cos(turn), distance * torch.sin(turn), 1 + 0.2 * times], dim=1)
    camera = Camera.look_at(eye, torch.zeros(1, 3, dtype=torch.float64), UP, 0.7, (64, 36))
    K = camera.K.clone()
    K[:, [0, 1], [0, 1]] = (20 * distance)[:, None]
    return Trajectory(Camera(camera.w2c, K, camera.size), times)


def moments(count: int) -> torch.Tensor:
    return torch.linspace(0, 2, count, dtype=torch.float64)


def test_at_its_own_times_a_path_is_itself() -> None:
    path = dolly_zoom_around(moments(7))
    again = path.at(path.times)
    torch.testing.assert_close(again.camera.w2c, path.camera.w2c)
    torch.testing.assert_close(again.camera.K, path.camera.K)


def test_between_its_frames_a_path_goes_on_smoothly() -> None:
    errors = {}
    for count in (9, 17):
        found, true = dolly_zoom_around(moments(count)).at(moments(61)), dolly_zoom_around(moments(61))
        inner = slice(15, 46)  # a natural spline is straight at its ends
        errors[count] = [
            float((found.camera.center - true.camera.center)[inner].norm(dim=1).max()),
            float((found.camera.w2c - true.camera.w2c)[inner, :3, :3].abs().max()),
            float((found.camera.focal / true.camera.focal).log()[inner].abs().max()),
        ]
    assert max(errors[9]) < 0.01  # heights, and parts; the frames are 0.37 rad of orbit apart
    assert all(fine < coarse / 6 for fine, coarse in zip(errors[17], errors[9]))


def test_a_camera_that_holds_still_before_and_after_a_move_neither_winds_up_nor_swings_past_its_end() -> None:
    """A whip pan and a crash zoom within one step of frames that are far apart."""
    camera = Camera.look_at(
        torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]]), torch.tensor([0.0, -1.0, 0.0]), 0.7, (320, 180)
    )
    angle = torch.tensor([0.0] * 6 + [math.radians(40)] * 6, dtype=torch.float64)
    turn = axis_angle_to_rotation_matrix(torch.stack([0 * angle, angle, 0 * angle], dim=1))
    w2c = torch.eye(4, dtype=torch.float64).repeat(12, 1, 1)
    w2c[:, :3, :3] = turn
    w2c[:6, 0, 3] = 1.0
    K = camera.K.double().repeat(12, 1, 1)
    K[6:, [0, 1], [0, 1]] *= 3
    path = Trajectory(Camera(w2c, K, (320, 180)), torch.linspace(0, 10, 12, dtype=torch.float64))
    found = path.at(torch.linspace(0, 10, 241, dtype=torch.float64)).camera
    yaw = torch.rad2deg(torch.atan2(found.w2c[:, 0, 2], found.w2c[:, 0, 0]))
    assert (float(yaw.min()), float(yaw.max())) == (pytest.approx(0.0, abs=1e-6), pytest.approx(40.0, abs=1e-6))
    lens = found.focal / found.focal[0]
    assert (float(lens.min()), float(lens.max())) == (pytest.approx(1.0), pytest.approx(3.0))
    still = torch.linspace(0, 10, 241) < 5 * 10 / 11
    torch.testing.assert_close(found.w2c[still], w2c[:1].expand(int(still.sum()), 4, 4))


def test_a_camera_that_creeps_on_after_a_fast_move_never_goes_back() -> None:
    """A whip pan, a track and a crash zoom that end in slow ones."""
    yaw = torch.deg2rad(torch.tensor([0.0, 20.0, 40.0, 40.5, 41.0, 41.5, 42.0], dtype=torch.float64))
    along = torch.tensor([0.0, 1.0, 2.0, 2.05, 2.1, 2.15, 2.2], dtype=torch.float64)
    focal = torch.tensor([400.0, 600.0, 800.0, 801.0, 802.0, 803.0, 804.0], dtype=torch.float64)
    w2c = torch.eye(4, dtype=torch.float64).repeat(7, 1, 1)
    w2c[:, :3, :3] = axis_angle_to_rotation_matrix(torch.stack([0 * yaw, yaw, 0 * yaw], dim=1))
    center = torch.stack([along, 0 * along, 0 * along], dim=1)
    w2c[:, :3, 3] = -(w2c[:, :3, :3] @ center[..., None])[..., 0]
    K = torch.eye(3, dtype=torch.float64).repeat(7, 1, 1)
    K[:, 0, 0] = K[:, 1, 1] = focal
    K[:, :2, 2] = torch.tensor([160.0, 90.0], dtype=torch.float64)
    times = torch.arange(7, dtype=torch.float64) / 6
    found = Trajectory(Camera(w2c, K, (320, 180)), times).at(torch.linspace(0, 1, 241, dtype=torch.float64)).camera
    turned = torch.atan2(found.w2c[:, 0, 2], found.w2c[:, 0, 0])
    for path in (turned, found.center[:, 0], found.focal):
        assert float(path.diff().min()) > -1e-9


def test_times_are_kept_as_float64_and_no_gradient_goes_through_a_path_between() -> None:
    path = dolly_zoom_around(moments(5))
    w2c = path.camera.w2c.clone().requires_grad_()
    learned = Trajectory(Camera(w2c, path.camera.K, path.camera.size), path.times.float())
    assert learned.times.dtype == torch.float64
    between = learned.at(torch.tensor([0.3, 0.7], dtype=torch.float64))
    assert not between.camera.w2c.requires_grad


def test_between_two_frames_a_path_is_straight() -> None:
    path = dolly_zoom_around(torch.tensor([0.0, 1.0], dtype=torch.float64))
    middle = path.at(torch.tensor([0.5], dtype=torch.float64)).camera
    torch.testing.assert_close(middle.center[0], path.camera.center.mean(0))
    torch.testing.assert_close(middle.focal[0], path.camera.focal.log().mean().exp())
    R = middle.w2c[0, :3, :3]
    torch.testing.assert_close(R @ R.T, torch.eye(3, dtype=torch.float64))
    angle = (torch.einsum("nii->n", path.camera.w2c[:, :3, :3] @ R.T) - 1).div(2).clamp(-1, 1).acos()
    assert float(angle[0]) == pytest.approx(float(angle[1]))
    assert 0 < float(angle[0]) < math.pi / 2


def test_between_two_frames_a_camera_turns_evenly() -> None:
    path = dolly_zoom_around(torch.tensor([0.0, 1.0], dtype=torch.float64))
    R = path.at(torch.tensor([0.25], dtype=torch.float64)).camera.w2c[0, :3, :3]
    cosines = torch.einsum("nii->n", path.camera.w2c[:, :3, :3] @ R.T) - 1
    first, last = cosines.div(2).acos().tolist()
    assert last == pytest.approx(3 * first)


def test_a_principal_point_that_moves_does_so_between_frames_too() -> None:
    path, between = dolly_zoom_around(moments(5)), torch.tensor([0.3, 1.1], dtype=torch.float64)
    path.camera.K[:, 0, 2] += path.times
    torch.testing.assert_close(path.at(between).camera.K[:, :2, 2], torch.stack([32 + between, 18 + 0 * between], 1))


def test_a_frame_alone_stands() -> None:
    path = dolly_zoom_around(moments(1))
    assert len(path.at(path.times)) == 1


def test_outside_its_times_there_is_no_path() -> None:
    with pytest.raises(ValueError, match=r"times must be within 0 to 2 s, got -0\.1 to 1"):
        dolly_zoom_around(moments(3)).at(torch.tensor([-0.1, 1.0], dtype=torch.float64))
    with pytest.raises(ValueError, match=r"times must be within 0 to 2 s, got 1 to 2\.1"):
        dolly_zoom_around(moments(3)).at(torch.tensor([1.0, 2.1], dtype=torch.float64))


def trajectory() -> Trajectory:
    eye = torch.tensor([[3.0, 0, 1], [3, 0.5, 1], [3, 1, 1]])
    camera = Camera.look_at(eye, torch.zeros(1, 3), torch.tensor([0.0, 0, 1]), 0.7, (64, 36))
    return Trajectory(camera, torch.tensor([0.0, 0.1, 0.2], dtype=torch.float64))


def test_a_trajectory_comes_back_exactly(tmp_path: Path) -> None:
    trajectory().save(tmp_path / "t.json")
    again = Trajectory.load(tmp_path / "t.json")
    assert torch.equal(again.camera.w2c, trajectory().camera.w2c)
    assert torch.equal(again.camera.K, trajectory().camera.K)
    assert again.fps == pytest.approx(10)


def test_a_trajectory_may_be_named_by_a_text(tmp_path: Path) -> None:
    path = str(tmp_path / "t.json")
    trajectory().save(path)
    Trajectory.load(path)
    with pytest.raises(InputError, match="no such file"):
        Trajectory.load(f"{path}.lost")


def test_a_damaged_trajectory_is_refused_by_field(tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    good = trajectory().to_json()

    def refuse(message: str, **change: object) -> None:
        path.write_text(json.dumps({**good, **change}))
        with pytest.raises(InputError, match=message):
            Trajectory.load(path)

    mirrored = json.loads(json.dumps(good["frames"]))
    mirrored[1]["w2c"][0][0] *= -1
    upside = json.loads(json.dumps(good["frames"]))
    upside[1]["w2c"][1] = [-value for value in upside[1]["w2c"][1]]
    backwards = json.loads(json.dumps(good["frames"]))
    backwards[1]["time"] = 9.0
    refuse("expected rotations", frames=mirrored)
    refuse("w2c: expected rotations .a scaled or mirrored pose", frames=upside)
    refuse("times must increase", frames=backwards)
    refuse("expected a list of 1 to 2000", frames=[])
    refuse("expected a list of 1 to 2000", frames=good["frames"] * 667)
    for size in ("wide", [math.inf, 90], [160.5, 90], [10**400, 90], [0, 90], [16385, 90], [True, 90], [160], None):
        refuse("size: expected a width and a height, whole numbers in", size=size)

    def changed(number: int, **fields: object) -> list[dict[str, object]]:
        return [{**frame, **(fields if i == number else {})} for i, frame in enumerate(good["frames"])]

    refuse("time: expected finite numbers", frames=changed(2, time=math.inf))
    refuse("time: expected finite numbers within 1e[+]10 s of 0", frames=changed(2, time=1e300))
    soon = good["frames"][0]["time"] + 1e-7
    refuse("time: expected 1e-06 s and more between frames, frame 1 is shown 1e-07 s", frames=changed(1, time=soon))
    refuse("not a trajectory", frames=changed(2, time=10**400))
    refuse(
        "w2c: expected 0 0 0 1 as the last row", frames=changed(1, w2c=[*good["frames"][1]["w2c"][:3], [0, 0, 0, 2]])
    )
    K = good["frames"][1]["K"]
    refuse("K: expected no skew", frames=changed(1, K=[[K[0][0], 0.1, K[0][2]], *K[1:]]))
    refuse("K: expected no skew", frames=changed(1, K=[K[0], [0.1, *K[1][1:]], K[2]]))
    for focal in (0.0, 1e-300, 1e300):
        refuse("K: expected focal lengths of 1e-06 to 1e[+]09 px", frames=changed(1, K=[K[0], [0, focal, 18], K[2]]))
    refuse("K: expected a principal point within 1e[+]09 px", frames=changed(1, K=[[K[0][0], 0, -1e300], *K[1:]]))
    far = [[*row[:3], 1.7e308] for row in good["frames"][1]["w2c"][:3]]
    refuse("w2c: expected cameras within 1e[+]12 scene units", frames=changed(1, w2c=[*far, [0, 0, 0, 1]]))
    refuse("K: expected 0 0 1 as the last row", frames=changed(1, K=[*good["frames"][1]["K"][:2], [0, 0.1, 1]]))


def test_a_whole_orbit_between_its_frames_is_the_orbit() -> None:
    """A quaternion changes its sign on the way round."""

    def orbit(t: torch.Tensor) -> Trajectory:
        eye = torch.stack([3 * torch.cos(t), 3 * torch.sin(t), torch.ones_like(t)], dim=1)
        return Trajectory(Camera.look_at(eye, torch.zeros(1, 3), torch.tensor([0.0, 0, 1]), 0.7, (64, 36)), t)

    between = torch.linspace(0.3, 6, 60, dtype=torch.float64)
    found = orbit(torch.linspace(0, 2 * math.pi, 25, dtype=torch.float64)).at(between)
    torch.testing.assert_close(found.camera.w2c, orbit(between).camera.w2c, atol=0.01, rtol=0)
