import math

import pytest
import torch
from kornia.metrics import angle_error_mat

from cltransfer.errors import UsageError
from cltransfer.registry import RENDERERS
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import SHOTS, Setup, builtin_reference, own_setup, shot
from cltransfer.subject import Subject

SIZE = (160, 90)


@pytest.fixture(scope="module", params=["courtyard", "plaza"])
def subject(request) -> Subject:
    person = builtin_scene(request.param).subject
    assert person is not None
    return person


def screen_height(subject: Subject, trajectory) -> torch.Tensor:
    keys = trajectory.camera.project(subject.key_joints[:, :3])[0]
    return (keys[:, 4] - keys[:, 0]).norm(dim=1) / SIZE[1]


def anchor_on_screen(subject: Subject, trajectory) -> torch.Tensor:
    return trajectory.camera.project(subject.anchor[None])[0][:, 0] / torch.tensor(SIZE)


@pytest.mark.parametrize("name", SHOTS)
def test_every_shot_is_rigid_finite_and_in_time(name, subject):
    trajectory = shot(name, subject, SIZE, frames=12, fps=24.0)
    R = trajectory.camera.w2c[:, :3, :3]
    torch.testing.assert_close(R @ R.transpose(1, 2), torch.eye(3).double().expand(12, 3, 3))
    assert torch.linalg.det(R).min() > 0.999
    assert (trajectory.camera.K[:, 0, 0] > 0).all()
    torch.testing.assert_close(trajectory.times, torch.arange(12).double() / 24)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (-0.15, 0.05)])
def test_dolly_zoom_keeps_the_subject_and_changes_the_background(subject, offset):
    trajectory = shot("dolly_zoom", subject, SIZE, setup=Setup(offset=offset))
    heights, places = screen_height(subject, trajectory), anchor_on_screen(subject, trajectory)
    assert (heights / heights[0] - 1).abs().max() < 0.005
    torch.testing.assert_close(places, places[:1].expand_as(places), atol=1e-9, rtol=0)
    behind = subject.anchor - 4 * subject.facing
    pair = torch.stack([behind, behind + subject.up])
    background = trajectory.camera.project(pair)[0].diff(dim=1).norm(dim=2)[:, 0]
    assert background[-1] / background[0] > 1.3  # 4 m behind: by 8.9 / 12.4 against 3.9 / 7.4
    reach = (trajectory.camera.center - subject.anchor).norm(dim=1) / subject.height
    assert reach[[0, -1]].tolist() == pytest.approx([2.2, 5.0], rel=0.02)


def test_push_in_halves_the_distance_and_keeps_the_lens(subject):
    trajectory = shot("push_in", subject, SIZE)
    reach = (trajectory.camera.center - subject.anchor).norm(dim=1) / subject.height
    assert reach[[0, -1]].tolist() == pytest.approx([4.0, 2.0])
    assert trajectory.camera.focal.unique().numel() == 1
    back = shot("pull_out", subject, SIZE)
    torch.testing.assert_close(back.camera.center.flip(0), trajectory.camera.center)


@pytest.mark.parametrize(("name", "degrees"), [("pan", 40.0), ("tilt", 24.0)])
def test_pan_and_tilt_turn_and_do_not_move(subject, name, degrees):
    camera = shot(name, subject, SIZE).camera
    assert (camera.center - camera.center[0]).norm(dim=1).max() < 1e-9
    assert camera.focal.unique().numel() == 1
    forward = camera.w2c[:, 2, :3]
    assert math.degrees(math.acos(float(forward[0] @ forward[-1]))) == pytest.approx(degrees, rel=0.02)


def test_pan_turns_right_and_tilt_turns_up(subject):
    pan, tilt = shot("pan", subject, SIZE), shot("tilt", subject, SIZE)
    assert anchor_on_screen(subject, pan)[:, 0].diff().max() < 0  # a still person slides to the left
    assert anchor_on_screen(subject, tilt)[:, 1].diff().min() > 0


@pytest.mark.parametrize(("name", "factor"), [("zoom", 2.0), ("crash_zoom", 3.0)])
def test_zooms_keep_the_pose(subject, name, factor):
    camera = shot(name, subject, SIZE, setup=Setup(offset=(0.1, 0.0))).camera
    assert (camera.w2c - camera.w2c[0]).abs().max() < 1e-9
    assert float(camera.focal[-1] / camera.focal[0]) == pytest.approx(factor)


def test_crash_zoom_happens_within_six_frames(subject):
    focal = shot("crash_zoom", subject, SIZE, frames=25).camera.focal
    assert int((focal.diff() > 1e-9).sum()) == 6


def test_orbit_is_an_arc_of_sixty_degrees_to_the_left(subject):
    camera = shot("orbit", subject, SIZE, setup=Setup(azimuth=0.0)).camera
    away = camera.center - subject.anchor
    azimuth = torch.atan2(away @ subject.left, away @ subject.facing)
    assert torch.rad2deg(azimuth[[0, -1]]).tolist() == pytest.approx([0.0, 60.0], abs=1e-6)
    torch.testing.assert_close(away.norm(dim=1), away.norm(dim=1)[:1].expand(24))


def test_dutch_leans_the_body_right_by_twenty_degrees(subject):
    camera = shot("dutch", subject, SIZE).camera
    up = camera.w2c[:, :3, :3] @ subject.up
    lean = torch.rad2deg(torch.atan2(up[:, 0], -up[:, 1]))
    assert lean[[0, -1]].tolist() == pytest.approx([0.0, 20.0], abs=1e-6)


def test_boom_rises_and_truck_goes_right(subject):
    rise = shot("boom", subject, SIZE).camera.center @ subject.up
    assert float(rise[-1] - rise[0]) == pytest.approx(1.0 * subject.height)
    truck = shot("truck", subject, SIZE).camera
    step = truck.w2c[0, :3, :3] @ (truck.center[-1] - truck.center[0])
    assert step.tolist() == pytest.approx([0.8 * subject.height, 0, 0], abs=1e-9)


def test_static_stands_still_and_handheld_does_not(subject):
    still = shot("static", subject, SIZE).camera.w2c
    assert (still - still[0]).abs().max() == 0
    held = [shot("handheld", subject, SIZE, setup=Setup(seed=seed)).camera for seed in (0, 0, 1)]
    assert torch.equal(held[0].w2c, held[1].w2c)
    assert not torch.equal(held[0].w2c, held[2].w2c)
    assert 0.001 < float(held[0].center.diff(dim=0).norm(dim=1).max()) < 0.1 * subject.height


def test_the_setup_says_where_a_shot_starts(subject):
    setup = Setup(azimuth=0.4, elevation=0.0, distance=3.0, coverage=0.5, offset=(0.2, -0.1))
    trajectory = shot("static", subject, SIZE, frames=1, setup=setup)
    assert anchor_on_screen(subject, trajectory)[0].tolist() == pytest.approx([0.7, 0.4])
    depth = float(trajectory.camera.to_camera(subject.anchor[None])[0, 0, 2])
    assert depth == pytest.approx(3.0 * subject.height)
    assert float(trajectory.camera.focal[0]) * subject.height / depth == pytest.approx(0.5 * SIZE[1])


def test_wrong_names_and_numbers_are_refused(subject):
    with pytest.raises(UsageError, match="shot 'swoop': no such shot"):
        shot("swoop", subject, SIZE)
    with pytest.raises(ValueError, match="frames and fps must be positive"):
        shot("pan", subject, SIZE, frames=0)
    with pytest.raises(ValueError, match="distance must be positive"):
        Setup(distance=-1.0)
    with pytest.raises(ValueError, match="elevation must lie in"):
        Setup(elevation=2.0)


@pytest.mark.parametrize("name", SHOTS)
def test_every_frame_of_a_reference_has_foreground_person_and_background_from_free_space(name):
    scene, trajectory = builtin_reference(name, SIZE, frames=5)
    camera = trajectory.camera
    gap = torch.cdist(camera.center, scene.geometry.means.double()).amin()
    assert gap > 0.4
    assert ((camera.center @ scene.up) > 0.3).all()
    seen = RENDERERS.build("gaussian_splats").render(scene, camera, frozenset({"depth", "label"}))
    for label, depth in zip(seen.label, seen.depth):
        person = label > 0.5
        middle = depth[person].median()
        assert person.float().mean() > 0.01
        assert ((depth < 0.95 * middle) & ~person).float().mean() > 0.01
        assert (depth > 1.3 * middle).float().mean() > 0.15


def test_aiming_at_the_face_puts_it_in_the_middle_at_the_asked_size(subject):
    own = own_setup("static")
    assert own.coverage is not None
    setup = Setup(coverage=5 * own.coverage, aim=0.38)
    camera = shot("static", subject, SIZE, 1, setup=setup).camera
    face = subject.anchor + 0.38 * subject.height * subject.up
    pixels, _ = camera.project(torch.stack([face, face + 0.1 * subject.height * subject.up]))
    assert pixels[0, 0].tolist() == pytest.approx([SIZE[0] / 2, SIZE[1] / 2])
    assert float(pixels[0, 0, 1] - pixels[0, 1, 1]) == pytest.approx(0.1 * 5 * own.coverage * SIZE[1], rel=0.05)


def test_a_shorter_reach_pans_less(subject):
    whole, part = (shot("pan", subject, SIZE, 2, setup=Setup(reach=reach)).camera for reach in (1.0, 0.25))
    turned = [float(angle_error_mat(c.w2c[:1, :3, :3], c.w2c[1:, :3, :3])) for c in (whole, part)]
    assert turned == pytest.approx([40, 10], abs=1e-3)
