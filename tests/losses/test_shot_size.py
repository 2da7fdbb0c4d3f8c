"""Shot size (Eq. 3-5): the pair, the axis and what happens where there is none."""

from dataclasses import replace

import pytest
import torch

from cltransfer.features import Features
from cltransfer.losses.framing import Framing
from cltransfer.losses.shot_size import ShotSize, degenerate, extent_difference, shot_size_loss
from cltransfer.placement import mask_extent
from cltransfer.testing import sample_features

# head top, chest, waist, knees, feet as x/W, y/H, confidence
STANDING = torch.tensor([[[0.5, 0.1, 1], [0.5, 0.3, 1], [0.5, 0.5, 1], [0.5, 0.7, 1], [0.5, 0.9, 1]]])


def hide(features: Features, *joints: int) -> Features:
    """``features`` with the confidence of some of the 14 joints set to 0."""
    keypoints = features.keypoints.clone()
    keypoints[:, list(joints), 2] = 0
    return replace(features, keypoints=keypoints)


def all_but(*kept: int) -> list[int]:
    return [j for j in range(14) if j not in kept]


def test_is_the_difference_of_the_spans() -> None:
    torch.testing.assert_close(shot_size_loss(STANDING, 0.5 * STANDING), torch.tensor([0.4]))


def test_pair_and_axis_come_from_the_reference_row_2() -> None:
    lying = STANDING[..., [1, 0, 2]]  # its own longest span is along x
    torch.testing.assert_close(shot_size_loss(STANDING, lying), torch.tensor([0.8]))  # yet y counts: 0.8 against 0
    seated = STANDING.clone()
    seated[:, 4, 2] = 0  # feet unseen: the pair is head top and knees
    closer = 2 * STANDING
    torch.testing.assert_close(shot_size_loss(seated, closer), torch.tensor([0.6]))


def test_visible_is_decided_on_the_reference_alone_row_20() -> None:
    unsure = STANDING.clone()
    unsure[..., 2] = 0.1
    torch.testing.assert_close(shot_size_loss(STANDING, unsure), torch.zeros(1))
    just_not = STANDING.clone()
    just_not[..., 2] = 0.5
    assert shot_size_loss(just_not, STANDING).isnan().all()


def test_span_is_relative_to_the_frame_whatever_its_aspect_row_5() -> None:
    features = sample_features(1, 2)
    wide = replace(
        features,
        size=(3 * features.size[0], features.size[1]),
        keypoints=features.keypoints * torch.tensor([3.0, 1, 1]),
    )
    torch.testing.assert_close(ShotSize()(features, wide), torch.zeros(2).double(), atol=1e-12, rtol=0)


@pytest.mark.parametrize("kept", [(), (12,)])
def test_fewer_than_two_joints_is_degenerate_row_3(kept: tuple[int, ...]) -> None:
    reference, rendered = hide(sample_features(1, 2), *all_but(*kept)), sample_features(2, 2)
    assert degenerate(reference).all()
    assert not degenerate(rendered).any()
    assert ShotSize(mode="faithful")(reference, rendered).isnan().all()
    assert ShotSize()(reference, reference).eq(0).all()


def test_too_few_joints_compare_the_masks_row_3() -> None:
    reference = hide(sample_features(1, 1), *all_but())
    masks = torch.zeros(2, 1, 36, 64, dtype=torch.bool)
    masks[0, :, 0:18, 10:14] = True  # half as high as the frame
    masks[1, :, 9:18, 0:64] = True  # a quarter as high, and as wide as the frame
    value = ShotSize()(replace(reference, subject=masks[0]), replace(reference, subject=masks[1]))
    torch.testing.assert_close(value, torch.tensor([0.25]).to(value))


def test_a_reference_without_a_person_is_undefined_though_a_mask_is_there() -> None:
    features = sample_features(0, 1)
    nobody = replace(features, keypoints=torch.full_like(features.keypoints, torch.nan))
    for rendered in (features, nobody):  # as a frame that does not score itself is
        assert ShotSize()(nobody, rendered).isnan().all()


def test_a_render_without_a_person_is_undefined_though_a_mask_is_there() -> None:
    """A reference that shows no joint is compared by masks; one of nobody is of something else."""
    reference = hide(sample_features(0, 1), *all_but())
    assert ShotSize()(reference, reference).isfinite().all()
    nobody = replace(reference, keypoints=torch.full_like(reference.keypoints, torch.nan))
    assert ShotSize()(reference, nobody).isnan().all()


def test_extent_of_a_mask_counts_its_first_and_last_pixel() -> None:
    mask = torch.zeros(1, 10, 20, dtype=torch.bool)
    mask[:, 2, 3], mask[:, 6, 12] = True, True
    torch.testing.assert_close(mask_extent(mask), torch.tensor([[10 / 20, 5 / 10]]))


def test_joint_without_a_place_is_not_visible_row_20() -> None:
    nowhere = STANDING.clone()
    nowhere[:, 0, :2] = torch.nan
    torch.testing.assert_close(shot_size_loss(nowhere, STANDING), torch.zeros(1))


def test_empty_mask_is_undefined_row_3() -> None:
    reference = hide(sample_features(1, 1), *all_but())
    empty = replace(reference, subject=torch.zeros_like(reference.subject))
    assert ShotSize()(reference, empty).isnan().all()
    assert ShotSize()(empty, reference).isnan().all()
    assert extent_difference(torch.tensor([[0.2, 0.5]]), torch.full((1, 2), torch.nan)).isnan().all()


@pytest.mark.parametrize("loss", [ShotSize, Framing])
@pytest.mark.parametrize(("pixels", "told"), [(11, False), (12, True)])  # 0.5 % of 64 x 36 are 11.5
def test_a_sliver_of_a_mask_tells_nothing_row_3(loss: type[ShotSize | Framing], pixels: int, told: bool) -> None:
    reference = hide(sample_features(1, 1), *all_but())
    sliver, whole = torch.zeros(1, 36, 64, dtype=torch.bool), torch.ones(1, 36, 64, dtype=torch.bool)
    sliver[0, 0, :pixels] = True
    seen, wanted = (replace(reference, subject=mask) for mask in (sliver, whole))
    assert bool(loss()(seen, wanted).isfinite().all()) == told
    assert bool(loss()(wanted, seen).isfinite().all())  # or a search would meet a step where the person comes in
    assert bool(loss(min_area=0.0)(seen, wanted).isfinite().all())


@pytest.mark.parametrize("loss", [ShotSize, Framing])
def test_a_least_area_that_is_no_part_of_the_frame_is_refused(loss: type[ShotSize | Framing]) -> None:
    with pytest.raises(ValueError, match=r"min_area must be in \[0, 1\], got 1.5"):
        loss(min_area=1.5)


def test_joint_the_scene_does_not_know_is_left_out_row_4() -> None:
    reference, rendered = sample_features(1, 2), sample_features(2, 2)
    rendered.keypoints[:, 10:12] = torch.nan  # no view ever showed the ankles
    assert ShotSize(mode="faithful")(reference, rendered).isnan().all()
    expected = ShotSize()(hide(reference, 10, 11), rendered)
    torch.testing.assert_close(ShotSize()(reference, rendered), expected)


def test_faithful_mode_asks_for_no_mask() -> None:
    assert ShotSize(mode="faithful").requires == ("keypoints",)
    assert ShotSize().requires == ("keypoints", "subject")


def test_a_raised_arm_makes_the_full_pose_larger_and_not_the_key_joints() -> None:
    before = sample_features(1, 1)
    raised = before.keypoints.clone()
    raised[:, 4, 1] -= 2 * before.size[1]  # left wrist, far above the head
    after = replace(before, keypoints=raised)
    assert float(ShotSize()(before, after)) == 0
    assert float(ShotSize(joints="all")(after, before)) > 1
