"""Each way to fail, alone."""

from dataclasses import replace

import pytest
import torch

from cltransfer.bench.failure import REASONS, Shown, failed_clip, failed_frames, pinned_frames
from cltransfer.features import Features
from cltransfer.search.paper_box import PaperBox
from cltransfer.search.se3_jaws import Se3Jaws
from cltransfer.search.subject_orbit import SubjectOrbit

SIZE = (32, 18)
YES, NO = torch.tensor([True]), torch.tensor([False])


def _frame() -> tuple[Features, Shown]:
    keypoints = torch.cat(
        [torch.rand(1, 14, 2, generator=torch.Generator().manual_seed(0)) * 18, torch.ones(1, 14, 1)], 2
    )
    mask = torch.zeros(1, 18, 32, dtype=torch.bool)
    mask[:, 4:12, 10:16] = True
    features = Features(SIZE, keypoints=keypoints, subject=mask)
    return features, Shown(features, torch.ones(1, 18, 32), mask.float(), torch.full((1, 18, 32), 4.0), 1.7)


def _reasons(
    reference: Features,
    shown: Shown,
    finite: torch.Tensor = YES,
    pinned: torch.Tensor = NO,
    true_cover: float = 1.0,
) -> set[str]:
    found = failed_frames(reference, shown, torch.tensor([true_cover]).double(), finite, pinned)
    assert tuple(found) == REASONS
    return {reason for reason, where in found.items() if bool(where)}


def test_a_sound_frame_has_not_failed():
    assert _reasons(*_frame()) == set()


def test_half_of_the_reference_s_joints_must_be_found():
    reference, shown = _frame()
    lost = reference.keypoints.clone()
    lost[:, :7, 2] = 0
    assert _reasons(reference, replace(shown, features=replace(reference, keypoints=lost))) == set()
    lost[:, 7, 2] = 0
    assert _reasons(reference, replace(shown, features=replace(reference, keypoints=lost))) == {"joints"}


def test_a_tenth_of_the_frame_may_be_empty():
    reference, shown = _frame()
    assert _reasons(reference, replace(shown, alpha=0.91 * shown.alpha)) == set()
    assert _reasons(reference, replace(shown, alpha=0.89 * shown.alpha)) == {"coverage"}


@pytest.mark.parametrize(("true_cover", "least"), [(1.0, 0.9), (0.95, 0.9), (0.8, 0.72), (0.0, 0.0)])
def test_where_the_scene_ends_the_true_cameras_tell_how_much_may_be_empty(true_cover: float, least: float) -> None:
    reference, shown = _frame()
    for covered in (least - 0.01, least + 0.01):
        seen = replace(shown, alpha=max(0.0, covered) * shown.alpha)
        assert _reasons(reference, seen, true_cover=true_cover) == ({"coverage"} if 0 < covered < least else set())


def test_the_subject_must_be_there_unless_the_reference_is_without_it():
    reference, shown = _frame()
    gone = replace(shown, label=torch.zeros_like(shown.label))
    assert _reasons(reference, gone) == {"subject"}
    assert _reasons(replace(reference, subject=torch.zeros_like(reference.subject)), gone) == set()


def test_a_surface_before_the_lens_fails_a_frame():
    reference, shown = _frame()
    depth = shown.depth.clone()
    depth[:, :2] = 0.1
    assert _reasons(reference, replace(shown, depth=depth)) == {"near"}


def test_what_is_not_finite_or_pinned_has_failed():
    assert _reasons(*_frame(), finite=NO) == {"not_finite"}
    assert _reasons(*_frame(), pinned=YES) == {"bound"}


def test_a_free_azimuth_and_an_axis_at_its_bound_are_not_pinned():
    x = torch.zeros(3, 7, dtype=torch.float64)
    x[0, 0] = 1e6
    x[1, 3] = SubjectOrbit().bounds()[1][3]
    assert pinned_frames(x, SubjectOrbit()).tolist() == [False, True, False]
    box = torch.zeros(2, 8, dtype=torch.float64)
    box[0, 4] = 1.0
    box[1, 7] = 1.0
    assert pinned_frames(box, PaperBox()).tolist() == [False, True]


@pytest.mark.parametrize(("failed", "expected"), [(2, False), (3, True)])
def test_a_clip_fails_with_more_than_a_tenth_of_its_frames(failed, expected):
    frames = torch.arange(24) < failed
    assert failed_clip(frames, 1.0, 10.0) is expected


def test_a_clip_without_a_finite_total_has_failed():
    assert failed_clip(torch.zeros(4, dtype=torch.bool), float("nan"), 10.0)


def test_of_jaws_parameters_only_the_lens_has_a_bound() -> None:
    """A path that has gone far from the first view is no failure of its own."""
    x = torch.tensor([[1.0e6, 0, 0, 0, 0, 1, 3.0, 1.0], [0, 0, 0, 0, 0, 1, 0, 6.0]], dtype=torch.float64)
    assert pinned_frames(x, Se3Jaws()).tolist() == [False, True]


@pytest.mark.parametrize(("pixels", "failed"), [(1, True), (2, False)])
def test_a_subject_of_a_five_hundredth_of_the_frame_is_one(pixels: int, failed: bool) -> None:
    reference, shown = _frame()  # of 576 pixels
    label = torch.zeros_like(shown.label)
    label.view(-1)[:pixels] = 1.0
    assert _reasons(reference, replace(shown, label=label)) == ({"subject"} if failed else set())


@pytest.mark.parametrize("height", [1.7, 17.0])
@pytest.mark.parametrize(("share", "area", "failed"), [(0.099, 0.06, True), (0.099, 0.04, False), (0.101, 0.06, False)])
def test_a_twentieth_of_the_frame_may_be_nearer_than_a_tenth_of_the_person(
    height: float, share: float, area: float, failed: bool
) -> None:
    reference, shown = _frame()
    depth = torch.full_like(shown.depth, 40.0)
    depth.view(-1)[: round(area * depth.numel())] = share * height
    assert _reasons(reference, replace(shown, depth=depth, height=height)) == ({"near"} if failed else set())


@pytest.mark.parametrize(("inside", "pinned"), [(0.0019, True), (0.0021, False)])
def test_a_parameter_is_pinned_within_a_thousandth_of_its_range(inside: float, pinned: bool) -> None:
    low, high = PaperBox().bounds()
    x = ((low + high) / 2)[None].clone()
    x[0, 0] = high[0] - inside / 2 * (high[0] - low[0])
    assert bool(pinned_frames(x, PaperBox())) == pinned


def test_a_clip_may_lose_a_tenth_of_its_frames_and_reach_half_of_what_random_views_have() -> None:
    lost = torch.arange(30) < 3
    assert not failed_clip(lost, 4.99, 10.0)
    assert failed_clip(torch.arange(30) < 4, 4.99, 10.0)
    assert failed_clip(lost, 5.01, 10.0)
