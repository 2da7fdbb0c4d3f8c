"""A person is lifted from given views, whoever else is told apart in them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from kornia.geometry.conversions import (
    axis_angle_to_rotation_matrix,
    quaternion_to_rotation_matrix,
    rotation_matrix_to_quaternion,
)
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.errors import InputError
from cltransfer.features import Features
from cltransfer.pipeline.components import SCENE_SOURCE, Components
from cltransfer.pipeline.graph import run
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.person.find_people import ring
from cltransfer.scenes.person.lift import Lift, LiftOptions, lift
from cltransfer.scenes.splats import Splats


def lifted(scene: Scene, views: int, thinned: int = 1, doubted: int = 0) -> Lift:
    """Lifted by exact readings from a ring of ``views`` about the person, in none of which a detector sees anybody.

    Of the maps each ``thinned``-th row and column is there. Of the first ``doubted`` views the pose network says that
    nobody is in the box.
    """
    parts, person = Components.build(load_config()), scene.subject
    plan = parts.plan("scene")
    assert person is not None

    def look(cameras: Camera, box: Tensor | None) -> Features:
        seen = run(plan, parts.renderer.render(scene, cameras, plan.buffers - SCENE_SOURCE), None)
        subject, depth = (seen.require(name)[:, ::thinned, ::thinned] for name in ("subject", "depth"))
        keypoints, subject = seen.require("keypoints").clone(), subject.clone()
        keypoints[:doubted], subject[:doubted] = torch.nan, False
        return replace(seen, box=torch.ones(len(cameras), 5), subject=subject, depth=depth, keypoints=keypoints)

    cameras = ring(person.anchor, person.height, scene.up, views)
    nobody = [np.zeros((0, 5)) for _ in range(views)]
    return lift(scene, parts.renderer, look, lambda cameras: nobody, LiftOptions(given=cameras))


def test_who_is_lifted_counts_though_no_boxes_meet() -> None:
    assert lifted(named_scene("courtyard"), 4).subject.people == 1


def test_who_is_lifted_by_maps_of_fewer_pixels_is_nearly_the_same() -> None:
    scene = named_scene("courtyard")
    full, half = lifted(scene, 8), lifted(scene, 8, thinned=2)
    theirs = full.label > 0.5
    assert float((half.label > 0.5)[theirs].double().mean()) > 0.97
    assert int(((half.label > 0.5) & ~theirs).sum()) < 0.03 * int(theirs.sum())


def test_a_view_that_the_pose_network_doubts_has_no_vote() -> None:
    """It would say of all that no view sees, inside the body, that it is nobody's."""
    scene = named_scene("courtyard")
    sure, doubtful = lifted(scene, 12), lifted(scene, 16, doubted=4)
    assert (sure.found, doubtful.found) == (12, 12)
    theirs, still = sure.label > 0.5, doubtful.label > 0.5
    assert float(still[theirs].double().mean()) > 0.97


@pytest.mark.parametrize(("apart", "known"), [(0.05, False), (0.5, True)])
def test_joints_that_all_views_see_from_one_place_are_not_known(apart: float, known: bool) -> None:
    scene = named_scene("courtyard")
    person, parts = scene.subject, Components.build(load_config())
    assert person is not None
    plan, count = parts.plan("scene"), 8
    beside = torch.linspace(-apart / 2, apart / 2, count).double()[:, None] * person.left
    eye = person.anchor + person.height * (3 * person.facing + beside)
    cameras = Camera.look_at(eye, person.anchor, scene.up, 0.7, (160, 90))

    def look(cameras: Camera, box: Tensor | None) -> Features:
        seen = run(plan, parts.renderer.render(scene, cameras, plan.buffers - SCENE_SOURCE), None)
        return replace(seen, box=torch.ones(len(cameras), 5))

    options = LiftOptions(given=cameras)
    if known:
        found = lift(scene, parts.renderer, look, lambda cameras: [np.zeros((0, 5))] * count, options)
        assert float((found.subject.joints - person.joints).norm(dim=1).nanmedian()) < 0.05 * person.height
        return
    with pytest.raises(InputError, match="only 0 joints that 3 views agree on"):
        lift(scene, parts.renderer, look, lambda cameras: [np.zeros((0, 5))] * count, options)


def standing_at(cameras: Camera, middle: Tensor, height: float) -> np.ndarray:
    """Boxes (V, 5) of one who stands there, as a perfect detector sees them."""
    pixels, depth = cameras.project(middle[None])
    tall = height * cameras.focal[:, None] / depth
    size = torch.cat([0.4 * tall, tall], dim=1)
    return torch.cat([pixels[:, 0] - size / 2, size, torch.ones_like(tall)], dim=1).numpy()


def test_of_several_people_in_given_views_one_is_read_in_all_of_them_but_a_head_is_nobody_else() -> None:
    scene, parts = named_scene("courtyard"), Components.build(load_config())
    plan, person = parts.plan("scene"), scene.subject
    assert person is not None
    cameras = ring(person.anchor, 1.5 * person.height, scene.up, 8)
    places = (person.anchor, person.anchor + 0.8 * person.height * person.left)
    several = list(np.stack([standing_at(cameras, place, person.height) for place in places], axis=1))
    several[3] = several[3][:1]  # most views see the first
    theirs = [view[:1] for view in several]
    heads = [box * [1, 1, 1, 0.3, 1] if v < 4 else box for v, box in enumerate(theirs)]  # two whose boxes meet
    nested = [np.concatenate([box, box * [1, 1, 1, 0.3, 1]]) for box in theirs]
    looked = list[Tensor | None]()

    def look(cameras: Camera, box: Tensor | None) -> Features:
        looked.append(box)
        seen = run(plan, parts.renderer.render(scene, cameras, plan.buffers - SCENE_SOURCE), None)
        return replace(seen, box=torch.ones(len(cameras), 5))

    for boxes in (several, heads, nested):
        found = lift(scene, parts.renderer, look, lambda cameras, boxes=boxes: boxes, LiftOptions(given=cameras))
        assert found.subject.people == 2
    torch.testing.assert_close(looked[0], torch.tensor(np.concatenate(theirs)).float())
    assert looked[1:] == [None, None]  # the main one of each view is the same


def test_a_person_of_whom_nothing_tells_where_they_face_is_refused() -> None:
    parts, scene = Components.build(load_config()), named_scene("courtyard")
    plan, person = parts.plan("scene"), scene.subject
    assert person is not None

    def look(cameras: Camera, box: Tensor | None) -> Features:
        seen = run(plan, parts.renderer.render(scene, cameras, plan.buffers - SCENE_SOURCE), None)
        keypoints = seen.require("keypoints").clone()
        keypoints[:, [1, 7], 2] = 0  # no pair of shoulders, none of hips
        nothing = torch.full_like(seen.require("orientation"), math.nan)
        return replace(seen, box=torch.ones(len(cameras), 5), keypoints=keypoints, orientation=nothing)

    cameras = ring(person.anchor, person.height, scene.up, 6)
    nobody = [np.zeros((0, 5)) for _ in range(6)]
    with pytest.raises(InputError, match="lift: nothing tells which way the person faces"):
        lift(scene, parts.renderer, look, lambda cameras: nobody, LiftOptions(given=cameras))


def lying(scene: Scene, degrees: float) -> Scene:
    """The scene with its person laid on the back, from upright by 90 degrees or more: then the feet are higher."""
    person, splats = scene.subject, scene.geometry
    assert person is not None
    assert isinstance(splats, Splats)
    turn = axis_angle_to_rotation_matrix(-math.radians(degrees) * torch.linalg.cross(person.up, person.facing)[None])[0]
    theirs = splats.label > 0.5

    def laid(points: Tensor) -> Tensor:
        return (points.double() - person.anchor) @ turn.T + person.anchor - 0.4 * person.height * person.up

    means, quats = splats.means.clone(), splats.quats.clone()
    means[theirs] = laid(splats.means[theirs]).float()
    turned = turn @ quaternion_to_rotation_matrix(splats.quats[theirs].double())
    quats[theirs] = rotation_matrix_to_quaternion(turned.contiguous()).float()
    return replace(
        scene, geometry=replace(splats, means=means, quats=quats), subject=replace(person, joints=laid(person.joints))
    )


@pytest.mark.parametrize("degrees", [90.0, 100.0])
def test_who_lies_is_lifted_as_tall_as_who_stands(degrees: float) -> None:
    scene = lying(named_scene("courtyard"), degrees)
    found, person = lifted(scene, 16), scene.subject
    assert person is not None
    assert found.subject.height == pytest.approx(person.height, rel=0.05)
    theirs = scene.geometry.label > 0.5
    assert float((found.label[theirs] > 0.5).double().mean()) > 0.95
