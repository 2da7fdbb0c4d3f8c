"""Framing (Eq. 6-7): the same joints on both sides, and no way to gain by hiding."""

from dataclasses import replace

import torch

from cltransfer.losses.framing import Framing, framing_loss
from cltransfer.testing import sample_features

JOINTS = torch.tensor([[[0.5, 0.1, 1], [0.5, 0.3, 1], [0.5, 0.5, 1], [0.5, 0.7, 1], [0.5, 0.9, 1]]])


def test_is_the_distance_of_the_centroids() -> None:
    moved = JOINTS + torch.tensor([0.3, 0.4, 0])
    torch.testing.assert_close(framing_loss(JOINTS, moved), torch.tensor([0.5]))


def test_joints_of_a_frame_alone_and_of_several_clips_are_those_of_a_batch() -> None:
    random = torch.Generator().manual_seed(0)
    reference, rendered = (JOINTS + 0.1 * torch.rand(6, 5, 3, generator=random) for _ in range(2))
    value = framing_loss(reference, rendered)
    torch.testing.assert_close(framing_loss(reference[0], rendered[0]), value[0])
    clips = framing_loss(reference.unflatten(0, (2, 3)), rendered.unflatten(0, (2, 3)))
    torch.testing.assert_close(clips, value.unflatten(0, (2, 3)))


def test_joints_unseen_in_the_reference_do_not_count_row_4() -> None:
    reference = JOINTS.clone()
    reference[:, 4, 2] = 0.2
    rendered = JOINTS.clone()
    rendered[:, 4, :2] = 77
    torch.testing.assert_close(framing_loss(reference, rendered), torch.zeros(1))


def test_hiding_or_leaving_the_frame_does_not_pay_row_4() -> None:
    reference, rendered = sample_features(1, 1), sample_features(2, 1)
    away = rendered.keypoints.clone()
    away[:, 8:12, 1] += 3 * rendered.size[1]  # knees and feet far below the frame
    unseen = away.clone()
    unseen[:, 8:12, 2] = 0
    seen_loss, unseen_loss = (Framing()(reference, replace(rendered, keypoints=k)) for k in (away, unseen))
    assert (seen_loss > 1).all()
    assert torch.equal(seen_loss, unseen_loss)


def test_leaving_entirely_is_undefined_and_priced_above_any_place_in_the_frame_row_4() -> None:
    corner_to_corner = framing_loss(torch.zeros(1, 5, 3) + torch.tensor([0, 0, 1]), torch.ones(1, 5, 3))
    assert Framing.penalty >= float(corner_to_corner)


def test_coordinates_are_relative_to_each_frame_row_5() -> None:
    features = sample_features(1, 2)
    tall = replace(
        features,
        size=(features.size[0], 5 * features.size[1]),
        keypoints=features.keypoints * torch.tensor([1, 5.0, 1]),
    )
    torch.testing.assert_close(Framing()(features, tall), torch.zeros(2).double(), atol=1e-12, rtol=0)


def test_no_joint_compares_the_masks_row_3() -> None:
    reference = sample_features(1, 1)
    reference.keypoints[..., 2] = 0
    masks = torch.zeros(2, 1, 36, 64, dtype=torch.bool)
    masks[0, :, :18, :32] = True
    masks[1, :, 18:, 32:] = True
    first, second = (replace(reference, subject=mask) for mask in masks)
    assert Framing(mode="faithful")(first, second).isnan().all()
    torch.testing.assert_close(Framing()(first, second).double(), torch.tensor([0.5**0.5]).double())
    assert Framing()(first, replace(reference, subject=torch.zeros_like(masks[0]))).isnan().all()


def test_a_reference_without_a_person_is_undefined_though_a_mask_is_there() -> None:
    features = sample_features(0, 1)
    nobody = replace(features, keypoints=torch.full_like(features.keypoints, torch.nan))
    for rendered in (features, nobody):  # as a frame that does not score itself is
        assert Framing()(nobody, rendered).isnan().all()


def test_a_render_without_a_person_is_undefined_though_a_mask_is_there() -> None:
    """A reference that shows no joint is compared by masks; one of nobody is of something else."""
    reference = sample_features(0, 1)
    reference.keypoints[..., 2] = 0
    assert Framing()(reference, reference).isfinite().all()
    nobody = replace(reference, keypoints=torch.full_like(reference.keypoints, torch.nan))
    assert Framing()(reference, nobody).isnan().all()


def test_joint_the_scene_does_not_know_is_left_out_row_4() -> None:
    reference, rendered = sample_features(1, 2), sample_features(2, 2)
    rendered.keypoints[:, 12] = torch.nan
    assert Framing(mode="faithful")(reference, rendered).isnan().all()
    reference.keypoints[:, 12, 2] = 0
    torch.testing.assert_close(Framing()(reference, rendered), Framing(mode="faithful")(reference, rendered))


def test_a_raised_arm_moves_the_full_pose_and_not_the_key_joints() -> None:
    before = sample_features(1, 1)
    raised = before.keypoints.clone()
    raised[:, 4, 1] -= 0.4 * before.size[1]  # left wrist
    after = replace(before, keypoints=raised)
    assert float(Framing()(before, after)) == 0
    seen = int((before.keypoints[0, :, 2] > 0.5).sum())
    torch.testing.assert_close(Framing(joints="all")(before, after), torch.tensor([0.4 / seen]).double())
