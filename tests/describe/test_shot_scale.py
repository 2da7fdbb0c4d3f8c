"""Shot scale: the class follows from the joints the frame holds (paper Sec. 8.1)."""

import pytest
import torch

from cltransfer.describe.shot_scale import BOUNDS, LEVELS, SCALES, body_in_frame, scale_class, shot_scale
from cltransfer.features import Features

# head top, chest, waist, knees, feet: the 14 joints that make them
_PARTS = ((12,), (0, 1), (6, 7), (8, 9), (10, 11))


def standing(top: float, height: float, x: float = 0.5, size: tuple[int, int] = (160, 90)) -> Features:
    """One upright body: its head top at ``top`` and its ``height``, both in frame heights."""
    joints = torch.zeros(1, 14, 3)
    for parts, level in zip(_PARTS, LEVELS):
        y = top + level * height
        joints[:, list(parts)] = torch.tensor([x * size[0], y * size[1], float(0 <= y <= 1 and 0 <= x <= 1)])
    return Features(size, keypoints=joints)


def named(features: Features) -> list[str]:
    return [SCALES[i] if i >= 0 else "" for i in shot_scale(features).tolist()]


@pytest.mark.parametrize(
    ("cut", "scale"),
    [(0.09, "ECU"), (0.17, "CU"), (0.21, "CU"), (0.30, "MCU"), (0.47, "MS"), (0.52, "MS"), (0.65, "MLS"), (0.74, "MLS"),
     (0.92, "LS")],
)  # fmt: skip
def test_the_class_is_where_the_lower_edge_cuts_the_body(cut: float, scale: str) -> None:
    headroom = 0.08
    assert named(standing(headroom, (1 - headroom) / cut)) == [scale]


def test_a_whole_body_is_long_or_extreme_long_by_its_height() -> None:
    assert named(standing(0.1, 0.8)) == ["LS"]
    assert named(standing(0.6, 0.28)) == ["LS"]
    assert named(standing(0.6, 0.22)) == ["ELS"]


def test_a_cropped_forehead_leaves_the_class() -> None:
    assert named(standing(-0.15, 5.0)) == ["CU"]
    assert named(standing(-1.0, 12.0)) == ["ECU"]


def test_hidden_legs_are_laid_out_by_the_body_that_is_seen() -> None:
    whole = standing(0.1, 0.8)
    hidden = whole.keypoints.clone()
    hidden[:, 8:12] = torch.tensor([3.0, 4.0, 0.1])  # a guess that is not to be trusted
    assert named(Features(whole.size, keypoints=hidden)) == ["LS"]


def test_one_who_leaves_at_the_side_or_below_is_no_close_up() -> None:
    assert named(standing(0.1, 0.8, x=1.02)) == ["LS"]
    assert named(standing(0.85, 0.5)) == ["LS"]


@pytest.mark.parametrize(("top", "x"), [(0.1, 1.3), (0.1, -0.3), (1.1, 0.5), (-2.0, 0.5), (1.1, 1.3)])
def test_one_who_stands_beside_the_frame_has_no_scale(top: float, x: float) -> None:
    placed = standing(top, 0.8, x)
    assert not bool((placed.keypoints[..., 2] > 0.5).any())
    assert named(placed) == [""]


def test_a_lying_body_has_the_class_of_the_same_body_upright() -> None:
    upright = standing(0.1, 0.8, size=(90, 160))
    lying = upright.keypoints[..., [1, 0, 2]]
    assert named(Features((160, 90), keypoints=lying)) == named(upright) == ["LS"]


def test_without_a_person_there_is_no_class() -> None:
    assert shot_scale(Features((160, 90), keypoints=torch.full((2, 14, 3), float("nan")))).tolist() == [-1, -1]


def test_frames_do_not_touch_each_other() -> None:
    frames = [standing(0.08, 0.92 / cut) for cut in (0.1, 0.3, 0.5, 0.7, 0.95)]
    together = Features.concatenate([*frames, Features((160, 90), keypoints=torch.full((1, 14, 3), float("nan")))])
    assert named(together) == ["ECU", "MCU", "MS", "MLS", "LS", ""]


def test_the_amount_is_the_part_of_the_body_in_the_frame() -> None:
    joints = torch.tensor([[[0.5, 0.1 + 2 * level, 1.0] for level in LEVELS]])
    torch.testing.assert_close(body_in_frame(joints, (160, 90)), torch.tensor([0.45]))


def test_classes_begin_at_their_bounds() -> None:
    bounds = torch.tensor(BOUNDS)
    assert scale_class(bounds).tolist() == [1, 2, 3, 4, 5, 6]
    assert scale_class(bounds - 1e-4).tolist() == [0, 1, 2, 3, 4, 5]
