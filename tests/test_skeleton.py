"""What joints tell by themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.scenes.builtin.mannequin import Body
from cltransfer.skeleton import (
    HEAD_TOP_BEYOND_EARS,
    JOINTS,
    from_blazepose,
    from_coco,
    key_joints,
    standing_height,
    stature,
)


def joints(height: float) -> Tensor:
    return torch.from_numpy(Body(height=height).joints())


@pytest.mark.parametrize("height", [1.2, 1.78, 2.1])
def test_bones_tell_how_tall_a_person_stands_whatever_the_pose(height: float) -> None:
    standing = joints(height)
    assert stature(standing) == pytest.approx(height, rel=0.03)
    turn = torch.linalg.qr(torch.from_numpy(np.random.default_rng(1).normal(size=(3, 3))))[0]
    assert stature(standing @ turn) == pytest.approx(stature(standing))


def test_a_joint_that_is_wrong_tells_little_and_unknown_ones_nothing() -> None:
    body = joints(1.78)
    body[JOINTS.index("left_ankle")] += 5.0
    assert stature(body) == pytest.approx(1.78, rel=0.05)
    body[JOINTS.index("right_knee") :] = torch.nan
    assert stature(body) == pytest.approx(1.78, rel=0.1)  # one thigh is left
    assert math.isnan(stature(torch.full((14, 3), torch.nan)))


def test_who_lies_is_as_tall_as_who_stands() -> None:
    body = joints(1.78)
    assert standing_height(1.75, body) == 1.75
    for reach in (0.02, 1.34, math.nan):  # lying, seated, unknown
        assert standing_height(reach, body) == pytest.approx(1.78, rel=0.03)
    assert standing_height(0.4, torch.full((14, 3), torch.nan)) == 0.4


def test_key_joints_are_midpoints_of_crowdpose_joints() -> None:
    keypoints = torch.rand(3, 14, 3, generator=torch.Generator().manual_seed(0))
    at = {n: keypoints[:, i] for i, n in enumerate(JOINTS)}
    expected = (at["left_hip"] + at["right_hip"])[:, :2] / 2
    torch.testing.assert_close(key_joints(keypoints)[:, 2, :2], expected)
    torch.testing.assert_close(key_joints(keypoints)[:, 0], at["head_top"])


@pytest.mark.parametrize(
    ("convert", "count", "ears", "shoulders"), [(from_coco, 17, 3, 5), (from_blazepose, 33, 7, 11)]
)
def test_the_head_top_lies_beyond_the_ears_by_one_rule(convert, count: int, ears: int, shoulders: int) -> None:
    keypoints = torch.ones(1, count, 3)
    keypoints[0, ears : ears + 2, 1] = 10.0
    keypoints[0, shoulders : shoulders + 2, 1] = 20.0
    top = convert(keypoints)[0, JOINTS.index("head_top")]
    assert float(top[1]) == pytest.approx(10 - HEAD_TOP_BEYOND_EARS * 10)


@pytest.mark.parametrize("lost", [(float("nan"), 0.0), (float("nan"), float("nan")), (float("inf"), 0.9)])
def test_an_ear_that_was_not_found_does_not_count_to_the_head_top(lost: tuple[float, float]) -> None:
    keypoints = torch.rand(2, 17, 3, generator=torch.Generator().manual_seed(0))
    missing = torch.tensor([lost[0], lost[0], lost[1]])
    for i, ear in enumerate((3, 4)):
        keypoints[i, ear] = missing
    seen, top = keypoints[[0, 1], [4, 3]], JOINTS.index("head_top")
    shoulders = keypoints[:, 5:7]
    middle = shoulders[..., :2].mean(1)
    expected = seen[:, :2] + HEAD_TOP_BEYOND_EARS * (seen[:, :2] - middle)
    found = from_coco(keypoints)
    torch.testing.assert_close(found[:, top, :2], expected)
    torch.testing.assert_close(found[:, top, 2], torch.minimum(seen[:, 2], shoulders[..., 2].amin(1)))
    keypoints[:, 3:5] = missing
    neither = from_coco(keypoints)
    assert bool(neither[:, top, :2].isnan().all())
    torch.testing.assert_close(neither[:, :top], found[:, :top])


@pytest.mark.parametrize(("convert", "count", "shoulders"), [(from_coco, 17, 5), (from_blazepose, 33, 11)])
def test_the_neck_is_amid_the_shoulders_and_as_sure_as_the_less_sure_one(convert, count: int, shoulders: int) -> None:
    keypoints = torch.rand(2, count, 3, generator=torch.Generator().manual_seed(0))
    keypoints[0, shoulders] = torch.tensor([10.0, 20.0, 0.3])
    keypoints[0, shoulders + 1] = torch.tensor([16.0, 24.0, 0.8])
    keypoints[1] = keypoints[0]
    keypoints[1, shoulders : shoulders + 2, 2] = torch.tensor([0.8, 0.3])
    neck = convert(keypoints)[:, JOINTS.index("neck")]
    torch.testing.assert_close(neck, torch.tensor([[13.0, 22.0, 0.3]]).expand(2, 3))
