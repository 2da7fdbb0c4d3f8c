"""Projected joints: where they are, and when they count as seen."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.extractors.scene_joints import SceneJoints, project_joints
from cltransfer.features import Features
from cltransfer.testing import sample_cameras, sample_features, sample_subject

HEAD_TOP = 12


def frame(camera: Camera) -> Features:
    """Frames in which nothing is before the person and the person is not drawn either."""
    size = camera.size
    depth, label = torch.full((len(camera), size[1], size[0]), 50.0), torch.zeros(len(camera), size[1], size[0])
    return Features(size, depth=depth, label=label, camera=camera, person=sample_subject())


def confidence(features: Features, **options: float) -> torch.Tensor:
    return SceneJoints(**options)(features, None).keypoints[..., 2]


def test_joints_are_where_the_camera_projects_them() -> None:
    features = frame(sample_cameras(1, 3))
    got = SceneJoints()(features, None).keypoints
    torch.testing.assert_close(got[..., :2], features.camera.project(sample_subject().joints)[0])
    torch.testing.assert_close(got[..., 2], torch.full((3, 14), 0.9).double())


def test_nearer_surface_hides_a_joint_row_20() -> None:
    features = frame(sample_cameras(1, 1))
    pixel = features.camera.project(sample_subject().joints)[0][0, HEAD_TOP].long()
    features.depth[:, pixel[1], pixel[0]] = 1.0
    hidden = confidence(features) == 0
    assert hidden[0].nonzero().flatten().tolist() == [HEAD_TOP]


def test_own_body_hides_nothing_row_20() -> None:
    features = frame(sample_cameras(1, 1))
    features.depth[:], features.label[:] = 1.0, 1.0
    assert (confidence(features) > 0).all()


def test_surface_nearer_by_less_than_the_tolerance_hides_nothing_row_20() -> None:
    features = frame(sample_cameras(1, 1))
    features.depth[:] = features.camera.project(sample_subject().joints)[1].min() - 0.2 * 1.7
    assert (confidence(features, tolerance=0.3) > 0).all()
    assert (confidence(features, tolerance=0.1) == 0).all()


def test_pixel_without_a_depth_hides_nothing() -> None:
    features = frame(sample_cameras(1, 1))
    features.depth[:] = torch.nan
    assert (confidence(features) > 0).all()


def test_joint_out_of_the_frame_keeps_its_place_unseen_row_20() -> None:
    features = frame(sample_cameras(1, 1))
    K = features.camera.K.clone()
    K[:, 1, 2] -= features.size[1]  # shift the picture up by a whole frame
    moved = replace(features, camera=replace(features.camera, K=K))
    got = SceneJoints()(moved, None).keypoints
    assert (got[..., 2] == 0).all()
    expected = features.camera.project(sample_subject().joints)[0] - torch.tensor([0, features.size[1]])
    torch.testing.assert_close(got[..., :2], expected)


def test_unknown_joint_is_undefined_and_unseen() -> None:
    person = sample_subject()
    person.joints[HEAD_TOP], person.confidence[HEAD_TOP] = torch.nan, 0
    got = SceneJoints()(replace(frame(sample_cameras(1, 2)), person=person), None).keypoints
    assert got[:, HEAD_TOP, :2].isnan().all()
    assert (got[:, HEAD_TOP, 2] == 0).all()
    assert got[:, :HEAD_TOP].isfinite().all()


def test_nobody_before_the_camera_is_nobody_row_4() -> None:
    away = Camera.look_at(
        torch.tensor([[0.0, 4, 1]]), torch.tensor([[0.0, 9, 1]]), torch.tensor([0.0, 0, 1]), 0.7, (64, 36)
    )
    got = SceneJoints()(frame(away), None).keypoints
    assert got[..., :2].isnan().all()
    assert (got[..., 2] == 0).all()


def test_joint_that_passes_the_camera_stays_on_its_side_row_4() -> None:
    """A camera at the height of the knees that moves through the legs never sees the head below."""
    heads = []
    for y in torch.linspace(0.4, -1.4, 10):
        eye = torch.tensor([[0.0, float(y), 0.5]])
        camera = Camera.look_at(eye, eye + torch.tensor([0.0, -1, 0]), torch.tensor([0.0, 0, 1]), 0.7, (64, 36))
        point_beyond = torch.tensor([[0.0, -3.0, 0.5]])
        pixels, _ = project_joints(camera, torch.cat([sample_subject().joints, point_beyond.double()]), 0.05 * 1.7)
        heads.append(float(pixels[0, HEAD_TOP, 1]))
    assert all(b <= a for a, b in pairwise(heads))
    assert max(heads) < 0


@pytest.mark.parametrize(("away", "seen"), [(0.04, False), (0.06, True)])
def test_a_joint_right_before_the_lens_is_unseen_and_stays_as_far_aside(away: float, seen: bool) -> None:
    """Nearer than a twentieth of the person's height, whatever else of them is farther."""
    person = sample_subject()
    eye = person.joints[HEAD_TOP] + away * person.height * person.facing
    person.joints[:] = eye - person.height * person.facing
    person.joints[HEAD_TOP] = eye - away * person.height * person.facing
    person.joints[0] = person.joints[HEAD_TOP] - 0.01 * person.height * person.up
    camera = Camera.look_at(eye[None], eye - person.facing, person.up, 0.7, (64, 36))
    got = SceneJoints()(replace(frame(camera), person=person), None).require("keypoints")[0]
    assert [bool(got[joint, 2] > 0) for joint in (HEAD_TOP, 0, 1)] == [seen, seen, True]
    below = float(got[0, 1] - got[HEAD_TOP, 1]) / float(camera.focal)
    assert below == pytest.approx(0.01 / max(away, 0.05))


def test_a_pixel_that_is_mostly_the_body_hides_nothing_and_one_that_is_mostly_not_does_row_20() -> None:
    features = frame(sample_cameras(1, 1))
    at = features.require("camera").project(sample_subject().joints)[0][0].long()
    features.require("depth")[:] = 1.0
    others = [joint for joint in range(14) if not torch.equal(at[joint], at[HEAD_TOP])]
    for share, hidden in ((0.6, False), (0.4, True)):
        features.require("label")[:, at[HEAD_TOP, 1], at[HEAD_TOP, 0]] = share
        found = confidence(features)[0]
        assert bool(found[HEAD_TOP] == 0) == hidden
        assert len(others) > 8
        assert bool((found[others] == 0).all())


def test_maps_may_have_fewer_pixels_than_the_size() -> None:
    features = sample_features(1, 2)
    half = replace(features, depth=features.depth[:, ::2, ::2], label=features.label[:, ::2, ::2])
    full, coarse = (SceneJoints()(f, None).keypoints for f in (features, half))
    torch.testing.assert_close(full[..., :2], coarse[..., :2])
    assert (coarse[..., 2] > 0).double().mean() > 0.8


def test_option_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"tolerance must be >= 0, got -0\.1"):
        SceneJoints(tolerance=-0.1)
