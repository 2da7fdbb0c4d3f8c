"""Shot scale: the class follows from the joints the frame holds (paper Sec. 8.1)."""

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.describe.shot_scale import BOUNDS, LEVELS, SCALES, body_in_frame, scale_class, shot_scale
from cltransfer.describe.sources import path_features
from cltransfer.features import Features
from cltransfer.testing import sample_subject
from cltransfer.trajectory import Trajectory

# head top, chest, waist, knees, feet: the 14 joints that make them
_PARTS = ((12,), (0, 1), (6, 7), (8, 9), (10, 11))


def standing(top: float, height: float, x: float = 0.5, size: tuple[int, int] = (160, 90)) -> Features:
    """One upright body: its head top at ``top`` and its ``height``, both in frame heights."""
    joints = torch.zeros(1, 14, 3)
    for parts, level in zip(_PARTS, LEVELS):
        y = top + level * height
        joints[:, list(parts)] = torch.tensor([x * size[0], y * size[1], float(0 <= y <= 1 and 0 <= x <= 1)])
    return Features(size, keypoints=joints)


def from_height(elevation: float, azimuth: float, distance: float) -> Features:
    """A camera that looks at a person from ``elevation``, ``azimuth`` [degrees] and ``distance`` [body heights]."""
    person, rise, turn = sample_subject(), math.radians(elevation), math.radians(azimuth)
    level = math.cos(turn) * person.facing + math.sin(turn) * person.left
    outward = math.cos(rise) * level + math.sin(rise) * person.up
    eye = (person.anchor + distance * person.height * outward)[None]
    top = person.facing if abs(elevation) > 85 else person.up
    camera = Camera.look_at(eye, person.anchor[None], top, math.radians(35), (640, 360))
    return path_features(Trajectory(camera, torch.zeros(1, dtype=torch.float64)), person)


def pitched(features: Features, pitch: float, apart: float, confidence: float = 1.0) -> Features:
    """``features`` seen from ``pitch`` [degrees], the shoulders ``apart`` [px]."""
    joints = features.keypoints.clone()
    joints[:, 0, 0] += apart
    joints[:, :2, 2] = confidence
    return replace(features, keypoints=joints, orientation=torch.deg2rad(torch.tensor([[0.0, pitch, 0.0]])))


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


@pytest.mark.parametrize("elevation", [-80, 0, 30, 60, 70, 80, 90])
@pytest.mark.parametrize("azimuth", [0, 90])
def test_one_who_is_seen_from_above_is_no_farther(elevation: float, azimuth: float) -> None:
    scales = [named(from_height(elevation, azimuth, distance)) for distance in (1.5, 3.0, 8.0)]
    assert scales == [["LS"], ["LS"], ["ELS"]]


def test_a_body_that_is_a_point_of_which_no_shoulders_tell_has_no_scale() -> None:
    assert named(replace(from_height(90, 0, 3.0), orientation=None)) == [""]


@pytest.mark.parametrize(("pitch", "scale"), [(0, "ELS"), (44, "ELS"), (46, "LS"), (-46, "LS"), (math.nan, "ELS")])
def test_the_shoulders_tell_the_length_of_a_body_seen_steeply_alone(pitch: float, scale: str) -> None:
    assert named(pitched(standing(0.6, 0.22), pitch, apart=6)) == [scale]


def test_shoulders_that_are_not_seen_tell_no_length() -> None:
    assert named(pitched(standing(0.6, 0.22), 80, apart=60, confidence=0.1)) == ["ELS"]


def test_one_who_lies_below_the_camera_is_as_long_as_the_picture_shows() -> None:
    lying = standing(0.1, 0.8, size=(90, 160)).keypoints[..., [1, 0, 2]]
    far = standing(0.6, 0.2, size=(90, 160)).keypoints[..., [1, 0, 2]]
    scales = [named(pitched(Features((160, 90), keypoints=joints), 90, apart=5)) for joints in (lying, far)]
    assert scales == [["LS"], ["ELS"]]


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
