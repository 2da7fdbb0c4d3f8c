"""JAWS' parameters: the exponential map as written out, about the world's origin; the published range of the lens."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from kornia.geometry.conversions import vector_to_skew_symmetric_matrix
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.frame import Memory, solve
from cltransfer.driver.problem import Problem
from cltransfer.driver.schedule import make_schedule
from cltransfer.driver.stage import Stage, read_path
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.scenes.load import load_scene
from cltransfer.search.se3_jaws import Se3Jaws, exponential
from cltransfer.shots import shot
from cltransfer.testing import sample_subject

SUBJECT = sample_subject()
HOME = Camera.look_at(
    SUBJECT.anchor[None] + torch.tensor([[0.5, 4.0, 0.3]]), SUBJECT.anchor[None], SUBJECT.up, 0.7, (160, 90)
)


def drawn(count: int, dimensions: int = 8) -> Tensor:
    return torch.rand(count, dimensions, generator=torch.Generator().manual_seed(0), dtype=torch.float64) - 0.5


def test_for_a_unit_axis_it_is_the_matrix_exponential_of_the_twist() -> None:
    x = 2 * drawn(20)
    w = x[:, 3:6] / x[:, 3:6].norm(dim=1, keepdim=True)
    twist = torch.zeros(20, 4, 4, dtype=torch.float64)
    twist[:, :3, :3], twist[:, :3, 3] = vector_to_skew_symmetric_matrix(w), x[:, :3]
    expected = torch.matrix_exp(x[:, 6, None, None] * twist)
    R, p = exponential(x[:, :3], w, x[:, 6])
    torch.testing.assert_close(R, expected[:, :3, :3])
    torch.testing.assert_close(p, expected[:, :3, 3])


def test_a_free_axis_is_no_rotation_and_the_quirk_takes_the_nearest() -> None:
    x = 2 * drawn(20)
    R, p = exponential(x[:, :3], x[:, 3:6], x[:, 6])
    assert float((R @ R.transpose(1, 2) - torch.eye(3)).abs().max()) > 0.01
    camera = Se3Jaws(unit_axis=False).cameras(x, HOME, None)
    move = camera.c2w @ HOME.w2c
    nearest = move[:, :3, :3]
    torch.testing.assert_close(move[:, :3, 3], p)
    # the nearest rotation leaves a symmetric, positive remainder
    remainder = nearest.transpose(1, 2) @ R
    torch.testing.assert_close(remainder, remainder.transpose(1, 2))
    assert bool((torch.linalg.eigvalsh(remainder) > 0).all())
    assert not torch.allclose(camera.w2c, Se3Jaws().cameras(x, HOME, None).w2c)


def test_a_turn_is_about_the_worlds_origin_not_about_the_camera() -> None:
    turn = torch.zeros(1, 8, dtype=torch.float64)
    turn[0, 5], turn[0, 6], turn[0, 7] = 1, math.pi / 2, 1
    camera = Se3Jaws().cameras(turn, HOME, None)
    x, y, z = HOME.center[0].tolist()
    torch.testing.assert_close(camera.center, torch.tensor([[-y, x, z]], dtype=torch.float64))


def test_the_lens_reaches_from_a_quarter_to_three_and_a_half() -> None:
    search = Se3Jaws()
    ends = torch.zeros(2, 8, dtype=torch.float64)
    ends[:, 7] = torch.stack(search.bounds())[:, 7]
    torch.testing.assert_close(search.cameras(ends, HOME, None).focal / HOME.focal, torch.tensor([0.25, 3.5]).double())


@pytest.mark.parametrize("unit_axis", [True, False])
@pytest.mark.parametrize("dimensions", [7, 8])
def test_recentred_is_the_same_camera_at_the_start_of_the_parameters(dimensions: int, unit_axis: bool) -> None:
    search, x = Se3Jaws(unit_axis=unit_axis), drawn(1, dimensions)
    again, home = search.recentred(x[0], HOME)
    assert torch.equal(again[:7], torch.zeros(7, dtype=torch.float64))
    found, expected = search.cameras(again[None], home, None), search.cameras(x, HOME, None)
    torch.testing.assert_close(found.w2c, expected.w2c)
    torch.testing.assert_close(found.K, expected.K)
    torch.testing.assert_close(home.focal, HOME.focal)


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e-3, 3.0])
def test_a_camera_that_is_moved_and_hardly_turned_is_expressed(turn: float) -> None:
    move = torch.eye(4, dtype=torch.float64)[None].clone()
    axis = torch.nn.functional.normalize(torch.tensor([[1.0, 2.0, -0.5]], dtype=torch.float64))
    move[:, :3, :3], _ = exponential(torch.zeros(1, 3).double(), axis, torch.tensor([turn], dtype=torch.float64))
    move[:, :3, 3] = torch.tensor([0.7, -0.2, 0.4])
    there = Camera(torch.linalg.inv(move @ HOME.c2w), HOME.K, HOME.size)
    search = Se3Jaws()
    again = search.cameras(search.vector(there, HOME, None), HOME, None)
    torch.testing.assert_close(again.w2c, there.w2c, atol=1e-5, rtol=0)


def test_translation_must_be_positive() -> None:
    with pytest.raises(ValueError, match="translation must be positive"):
        Se3Jaws(translation=0)


def test_a_frame_starts_at_the_camera_it_is_given_however_far_it_was_moved_without_a_turn() -> None:
    config = load_config(overrides=["preset=five_adam", "adam.iterations=1", "adam.rate=1e-6"])
    scene, parts, search = load_scene("builtin:plaza"), Components.build(config), Se3Jaws()
    assert scene.subject is not None
    home = shot("static", scene.subject, (48, 27), 1).camera
    aside = home.w2c.clone()
    aside[:, 0, 3] += 0.5  # a truck of half a unit, whose v is out of all bounds
    camera = replace(home, w2c=aside)
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (48, 27))
    reference = read_path(stage, camera)
    defined = stage.objective.defined(reference)
    problem = Problem(stage, search, home, reference[0], None, defined[0], True)
    schedule = make_schedule(config, search, stage.objective, reference)
    start = search.vector(camera, home, None)
    assert bool((start.abs() > problem.bounds[1]).any())
    found = solve(problem, start, Memory(), schedule, np.random.Generator(np.random.PCG64(0)))
    assert float((problem.cameras(found.x[None]).center - camera.center).norm()) < 0.1


@pytest.mark.parametrize(("unit", "step"), [(1000.0, "0.000588"), (3.28, ""), (1.0, ""), (0.001, "588")])
def test_steps_of_another_unit_are_told_whatever_bounds_them(unit: float, step: str) -> None:
    person = sample_subject()
    person = replace(person, height=person.height * unit)
    told = {Se3Jaws(translation=bound).unit_note(person) for bound in (5.0, 5.0 * unit)}
    line = f"the camera moves by steps in scene units, each {step} heights of the person: se3_jaws is made for scenes"
    assert told == {f"{line} in metres" if step else ""}
