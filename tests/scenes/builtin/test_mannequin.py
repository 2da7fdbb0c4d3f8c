import numpy as np
import pytest

from cltransfer.scenes.builtin.mannequin import Body
from cltransfer.scenes.builtin.surfaces import Cells
from cltransfer.skeleton import JOINTS


def surface(body: Body) -> np.ndarray:
    return Cells.concatenate([part.surface.cells(part.spacing) for part in body.parts()]).center


@pytest.mark.parametrize("body", [Body(), Body(height=1.6, girth=1.2, stride=0.3, swing=(-0.4, 0.4))])
def test_the_body_stands_on_the_ground_and_is_as_tall_as_it_says(body):
    points, joints = surface(body), body.joints()
    assert points[:, 2].min() == pytest.approx(0, abs=0.012)
    assert points[:, 2].max() == pytest.approx(joints[12, 2], abs=0.012)
    assert joints[12, 2] <= body.height * 1.001


def test_a_standing_body_reaches_its_height():
    assert Body(height=1.7).joints()[12, 2] == pytest.approx(1.7, rel=0.005)


def test_left_joints_are_on_the_left():
    joints = Body(stride=0.3, swing=(0.4, -0.4)).joints()
    for i, name in enumerate(JOINTS[:12]):
        assert (joints[i, 1] > 0) == name.startswith("left")


def test_a_stride_puts_the_left_foot_forward():
    joints = Body(stride=0.3).joints()
    assert joints[10, 0] > 0.1
    assert joints[11, 0] < -0.1


def test_every_joint_lies_inside_the_body():
    body = Body(height=1.75, stride=0.2, swing=(0.3, -0.3))
    distance = np.linalg.norm(surface(body)[None] - body.joints()[:, None], axis=2).min(1)
    assert distance.max() < 0.12


def test_the_neck_is_the_middle_of_the_shoulders_as_in_the_skeleton():
    joints = Body().joints()
    np.testing.assert_allclose(joints[13], (joints[0] + joints[1]) / 2)


def test_all_parts_belong_to_the_subject():
    assert all(part.subject for part in Body().parts())


def test_a_body_without_height_is_refused():
    with pytest.raises(ValueError, match="height and girth must be positive"):
        Body(height=0)
