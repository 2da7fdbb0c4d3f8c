from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.initial_view import COARSE, Aim, _stands, best_of_orbit, first_seen
from cltransfer.driver.stage import Stage
from cltransfer.errors import UsageError
from cltransfer.features import Features
from cltransfer.orientation import orientation_from_axes, wrap
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.scenes.builtin import named_scene
from cltransfer.shots import shot
from cltransfer.testing.samples import sample_features


def test_the_frame_to_stand_by_is_one_that_shows_the_person() -> None:
    features = sample_features(0, 4)
    joints = features.require("keypoints").clone()
    joints[0], joints[1:3, :, 2] = torch.nan, 0.0  # behind the camera, outside the frame
    placed = torch.tensor([False, True, True, True])
    for shown, expected in ((joints, 3), (torch.cat([joints[:3], joints[:1]]), 1)):
        found = first_seen(replace(features, keypoints=shown), placed)
        torch.testing.assert_close(found.require("keypoints"), shown[expected][None], equal_nan=True)
    assert torch.equal(first_seen(features, placed).require("keypoints"), features.require("keypoints")[1:2])


@pytest.mark.parametrize("degrees", [15.0, 40.0, 70.0])
def test_a_lens_that_is_kept_is_that_of_the_given_view(degrees: float) -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    parts = Components.build(load_config(overrides=["search_side=96", "losses.filmic_space=null"]))
    plan = parts.plan("scene")
    stage = Stage(scene, parts.renderer, plan, Objective(parts.losses), (96, 54))
    first = stage.features(shot("static", scene.subject, (96, 54), 1).camera, None)
    center = scene.subject.anchor + 6 * scene.subject.facing
    given = Camera.look_at(center[None], scene.subject.anchor[None], scene.up, math.radians(degrees), (96, 54))
    views = best_of_orbit(stage, first, (96, 54), False, given)
    torch.testing.assert_close(views.vertical_fov, given.vertical_fov.expand(len(views)))
    wanted = first.require("keypoints")[0, :, 1]
    seen = stage.features(views[0], None).require("keypoints")[0, :, 1]
    assert float(seen.max() - seen.min()) == pytest.approx(float(wanted.max() - wanted.min()), rel=0.15)


def test_losses_that_need_motion_alone_do_not_tell_where_to_stand() -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    still = [f"losses.{name}=null" for name in ("shot_size", "framing", "filmic_space", "camera_angle")]
    parts = Components.build(load_config(overrides=still))
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (96, 54))
    first = stage.features(shot("static", scene.subject, (96, 54), 1).camera, None)
    with pytest.raises(UsageError, match="losses: camera_movement: none tells where to stand in a first frame"):
        best_of_orbit(stage, first, (96, 54), True)


def test_a_reference_of_joints_alone_is_told_what_it_lacks() -> None:
    scene, first = named_scene("courtyard"), sample_features(0, 1)
    parts = Components.build(load_config())
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (96, 54))
    joints = Features(first.size, keypoints=first.keypoints)
    with pytest.raises(UsageError, match=r"in a first frame \(add subject to the reference, which shot_size needs"):
        best_of_orbit(stage, joints, (96, 54), True)


def test_whom_the_network_took_from_behind_is_looked_at_from_the_front_with_the_same_lean() -> None:
    up, left, ray = torch.tensor([[0.3, -0.9, 0.1], [0.8, 0.2, 0.5], [0.1, 0.0, -1.0]], dtype=torch.float64)
    true, read = (orientation_from_axes(side, up, ray) for side in (left, -left))
    assert float(wrap(_stands(read) - true).abs().sum(1).amin()) < 1e-9


@pytest.mark.parametrize(("told", "free", "count"), [(True, False, 2), (False, False, 18), (True, True, 18)])
def test_a_size_that_tells_the_distance_makes_one_view_of_a_stand(told: bool, free: bool, count: int) -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    keypoints = sample_features(0, 1).require("keypoints").clone()
    camera = shot("static", scene.subject, (96, 54), 1).camera
    keypoints[..., :2], keypoints[..., 2] = camera.project(scene.subject.joints)[0], 1.0 if told else 0.0
    stands = torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], dtype=torch.float64)
    views = Aim(scene.subject, (96, 54), Features((96, 54), keypoints=keypoints), free).views(stands, COARSE)
    assert len(views) == count
    assert len({(round(x, 3), round(y, 3), round(z, 3)) for x, y, z in views.center.tolist()}) == count
