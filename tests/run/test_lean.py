"""A trunk that leans far on one side alone is told of, and only where both sides tell how it leans."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.extractors.scene_orientation import SceneOrientation
from cltransfer.features import Features
from cltransfer.run.lean import lean_note, trunk_lean
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import Setup, shot
from cltransfer.skeleton import JOINTS
from cltransfer.subject import Subject

TOLD = (
    "the person's trunk leans by {} degrees in the scene, by {} than 45 in the reference: their size is compared along "
    "the longer side of the reference's body, and may be far off"
)


@pytest.fixture(scope="module")
def person() -> Subject:
    subject = builtin_scene("courtyard").subject
    assert subject is not None
    return subject


def leaning(person: Subject, degrees: float) -> Subject:
    """The person, leant to their left."""
    angle, upright = math.radians(degrees), person.joints - person.anchor
    along = [upright @ axis for axis in (person.left, person.facing, person.up)]
    left = math.cos(angle) * along[0] + math.sin(angle) * along[2]
    up = math.cos(angle) * along[2] - math.sin(angle) * along[0]
    joints = person.anchor + torch.stack([left, along[1], up], 1) @ torch.stack([person.left, person.facing, person.up])
    return replace(person, joints=joints)


def seen(person: Subject, **setup: float) -> Features:
    """What a clip shows of them: joints and angles, and neither cameras nor who it is."""
    camera = shot("static", person, (160, 90), 2, setup=Setup(**setup)).camera  # type: ignore[arg-type]
    pixels = camera.project(person.joints)[0]
    features = Features(camera.size, camera=camera, person=person)
    angles = SceneOrientation()(features, None).require("orientation")
    keypoints = torch.cat([pixels, torch.ones(2, 14, 1, dtype=torch.float64)], dim=2)
    return Features(camera.size, keypoints=keypoints, orientation=angles)


@pytest.mark.parametrize("degrees", [0.0, 30.0, -60.0, 90.0, 180.0])
def test_a_trunk_leans_as_far_as_its_person_was_leant(person: Subject, degrees: float) -> None:
    own = math.degrees(trunk_lean(person))
    assert own < 5
    assert math.degrees(trunk_lean(leaning(person, degrees))) == pytest.approx(abs(degrees), abs=own + 0.1)


@pytest.mark.parametrize(("here", "there"), [(0.0, 90.0), (90.0, 0.0), (-90.0, 0.0), (60.0, 0.0)])
def test_who_leans_far_on_one_side_alone_is_told_of(person: Subject, here: float, there: float) -> None:
    body = leaning(person, here)
    told = lean_note(body, seen(leaning(person, there)))
    assert told == TOLD.format(f"{math.degrees(trunk_lean(body)):.0f}", "more" if there > 45 else "less")


def test_who_leans_but_a_little_farther_is_not_told_of(person: Subject) -> None:
    assert lean_note(leaning(person, 60), seen(leaning(person, 30))) == ""


@pytest.mark.parametrize("degrees", [0.0, 40.0, 60.0, 90.0, 180.0])
@pytest.mark.parametrize("azimuth", [0.0, 0.8, 1.5, 2.5])
@pytest.mark.parametrize("elevation", [0.0, 0.6, 1.2, -0.3])
def test_a_person_is_as_they_are_from_wherever_they_are_seen(
    person: Subject, degrees: float, azimuth: float, elevation: float
) -> None:
    body = leaning(person, degrees)
    assert lean_note(body, seen(body, azimuth=azimuth, elevation=elevation)) == ""


def test_what_a_reference_does_not_show_is_untold(person: Subject) -> None:
    lying, clip = leaning(person, 90), seen(person)
    assert lean_note(lying, clip) != ""
    keypoints, angles = clip.require("keypoints"), clip.require("orientation")
    unsure, steep, rolled = keypoints.clone(), angles.clone(), angles.clone()
    unsure[:, JOINTS.index("neck"), 2] = 0.0
    steep[:, 1] = 1.2
    rolled[:, 2] = 1.5
    for lacking in (
        replace(clip, keypoints=unsure),
        replace(clip, keypoints=keypoints * torch.nan),
        replace(clip, orientation=steep),
        replace(clip, orientation=rolled),  # a network's: the body as it lies, or the camera
        replace(clip, orientation=None),
        replace(clip, keypoints=None),
    ):
        assert lean_note(lying, lacking) == ""


def test_a_scene_that_does_not_know_the_trunk_tells_nothing_of_it(person: Subject) -> None:
    confidence = torch.ones(14, dtype=torch.float64)
    confidence[JOINTS.index("left_hip")] = 0.0
    unknown = replace(leaning(person, 90), confidence=confidence)
    assert math.isnan(trunk_lean(unknown))
    assert [lean_note(body, seen(person)) for body in (unknown, None)] == ["", ""]


def test_most_frames_tell_how_a_reference_leans(person: Subject) -> None:
    stands, lies = seen(person), seen(leaning(person, 90))
    mixed = Features.concatenate([stands, lies, lies])
    assert lean_note(leaning(person, 90), mixed) == ""
    assert lean_note(person, mixed) != ""
