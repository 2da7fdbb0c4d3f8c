"""A subject: saved and read back, refused when damaged."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from scipy.spatial.transform import Rotation

from cltransfer.errors import InputError
from cltransfer.subject import Subject
from cltransfer.testing import sample_subject


def subject() -> Subject:
    joints = sample_subject().joints.clone()
    joints[3] = torch.nan
    confidence = torch.ones(14, dtype=torch.float64)
    confidence[3] = 0
    facing, up = torch.eye(3, dtype=torch.float64)[[0, 2]]
    return Subject(joints, confidence, facing, up, 1.7, 1.0)


def test_a_subject_comes_back_and_an_unknown_joint_is_null(tmp_path: Path) -> None:
    subject().save(tmp_path / "subject.json", note="a report")
    assert json.loads((tmp_path / "subject.json").read_text())["joints"]["right_elbow"] is None
    again = Subject.load(tmp_path / "subject.json")
    torch.testing.assert_close(again.joints, subject().joints, equal_nan=True)
    assert again.height == 1.7


def test_what_a_person_is_made_of_is_kept_as_float64() -> None:
    one = subject()
    rough = Subject(one.joints.float(), one.confidence.float(), one.facing.float(), one.up, 1.7)
    assert {rough.joints.dtype, rough.confidence.dtype, rough.facing.dtype, rough.left.dtype} == {torch.float64}
    assert one != rough


def test_a_subject_may_be_named_by_a_text(tmp_path: Path) -> None:
    path = str(tmp_path / "subject.json")
    subject().save(path)
    Subject.load(path)
    with pytest.raises(InputError, match="no such file"):
        Subject.load(f"{path}.lost")


def test_left_is_left_of_facing() -> None:
    torch.testing.assert_close(subject().left, torch.tensor([0.0, 1, 0], dtype=torch.float64))  # x ahead, z up


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "other"}, "format: expected 'cltransfer.subject'"),
        ({"facing": [2, 0, 0]}, "facing: expected a unit vector"),
        ({"height": -1}, "height must be positive"),
        ({"height": 10**400}, "not a subject: int too large"),
        ({"height": 1700}, "height: expected about 1.72, as its bones tell, got 1700"),
        ({"height": 0.17}, "height: expected about 1.72, as its bones tell, got 0.17"),
        ({"metres_per_unit": -1}, "metres_per_unit: expected a number above 0 or null, got -1.0"),
        ({"metres_per_unit": 0}, "metres_per_unit: expected a number above 0 or null, got 0.0"),
        ({"metres_per_unit": math.inf}, "metres_per_unit: expected a number above 0 or null, got inf"),
        ({"up": [1, 0]}, "up must be"),
        ({"joints": {}}, "left_shoulder: field is missing"),
    ],
)
def test_a_damaged_subject_is_refused_by_field(tmp_path: Path, change: dict, message: str) -> None:
    path = tmp_path / "subject.json"
    path.write_text(json.dumps({**subject().to_json(), **change}))
    with pytest.raises(InputError) as caught:
        Subject.load(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_body_of_another_build_has_its_own_height(tmp_path: Path) -> None:
    """A figure of two heads stands as high as its bones would be in a person of less than half of that."""
    person = sample_subject()
    x, y, z = person.joints.unbind(1)
    legs = z[[6, 7]].mean()
    squat = torch.where(z > legs, 0.25 * 1.7 + (z - legs) * 0.75 * 1.7 / (1.7 - legs), z * 0.25 * 1.7 / legs)
    replace(person, joints=torch.stack([x, y, squat], 1)).save(tmp_path / "squat.json")
    one_known = torch.full_like(person.joints, torch.nan)
    one_known[12] = person.joints[12]
    sure = one_known.isfinite().all(1).double()
    replace(person, joints=one_known, confidence=sure).save(tmp_path / "head.json")
    assert {Subject.load(tmp_path / name).height for name in ("squat.json", "head.json")} == {1.7}


@pytest.mark.parametrize("pose", ["sitting", "bowing", "stepping"])
def test_the_middle_of_a_person_turns_with_the_scene(pose: str) -> None:
    person = sample_subject()
    joints, ahead = person.joints.clone(), person.height * person.facing
    if pose == "sitting":
        joints[8:12] += 0.3 * ahead
    elif pose == "bowing":
        joints[[0, 1, 12, 13]] += 0.4 * ahead - 0.2 * person.height * person.up
    else:
        joints[[8, 10]] += 0.2 * ahead + 0.1 * person.height * person.left
    posed = replace(person, joints=joints)
    for turn in torch.from_numpy(Rotation.random(20, rng=0).as_matrix()):
        turned = replace(posed, joints=joints @ turn.T, facing=turn @ posed.facing, up=turn @ posed.up)
        torch.testing.assert_close(turned.anchor, turn @ posed.anchor, rtol=0, atol=1e-12)
