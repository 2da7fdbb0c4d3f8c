"""People are found by the boxes that meet: every one of them, none that is not there, each by its own boxes."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.errors import InputError, UsageError
from cltransfer.near_plane import drawn_whole
from cltransfer.registry import RENDERERS
from cltransfer.scenes import Scene
from cltransfer.scenes.bake import bake_grid, bake_splats
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.scenes.person.find_people import (
    FOV,
    SIZE,
    Boxes,
    Found,
    _reach,
    boxes_of,
    chosen,
    find_people,
    people_of,
    ring,
    standing,
)
from cltransfer.scenes.simplify import subset

UP = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
TALL = torch.tensor([0.0, 0.0, 0.0], dtype=torch.float64), 1.8
SMALL = torch.tensor([1.5, -0.3, 0.4], dtype=torch.float64), 1.2


def seen(cameras: Camera, *people: tuple[torch.Tensor, float]) -> Boxes:
    """What a perfect detector says of standing people, middles and heights."""
    boxes: Boxes = [np.zeros((0, 5)) for _ in range(len(cameras))]
    for middle, height in people:
        pixels, depth = cameras.project(middle[None])
        for v in range(len(cameras)):
            x, y = pixels[v, 0].tolist()
            if depth[v, 0] <= 0 or not (0 < x < cameras.size[0] and 0 < y < cameras.size[1]):
                continue
            tall = height * float(cameras.focal[v] / depth[v, 0])
            box = np.array([[x - 0.2 * tall, y - 0.5 * tall, 0.4 * tall, tall, 0.9]])
            boxes[v] = np.concatenate([boxes[v], box])
    return boxes


def seen_anywhere(camera: Camera, person: tuple[torch.Tensor, float]) -> np.ndarray:
    """The whole box of a standing person in one view, (5,), however much of it the frame cuts off."""
    pixels, depth = camera.project(person[0][None])
    tall = person[1] * float(camera.focal[0] / depth[0, 0])
    x, y = pixels[0, 0].tolist()
    return np.array([x - 0.2 * tall, y - 0.5 * tall, 0.4 * tall, tall, 0.9])


def wide() -> Camera:
    return ring(torch.tensor([0.5, 0.0, 0.0], dtype=torch.float64), 3.0, UP, 12)


def test_two_people_are_told_apart() -> None:
    cameras = wide()
    people = people_of(cameras, seen(cameras, TALL, SMALL))
    assert len(people) == 2
    for person, (middle, height) in zip(sorted(people, key=lambda p: -p.height), (TALL, SMALL)):
        assert (person.middle - middle).norm() < 0.05
        assert person.height == pytest.approx(height, rel=0.05)
        assert person.views == 12


def test_a_box_in_one_view_is_nobody() -> None:
    cameras = wide()
    boxes = seen(cameras, TALL)
    boxes[0] = np.concatenate([boxes[0], [[20.0, 30.0, 40.0, 80.0, 0.5]]])
    assert len(people_of(cameras, boxes)) == 1


def test_everyone_gets_their_own_boxes() -> None:
    cameras = wide()
    boxes = seen(cameras, TALL, SMALL)
    people = people_of(cameras, boxes)
    assert len(people) == 2
    for person in people:
        middle = TALL if person.height > 1.5 else SMALL
        expected = torch.stack([torch.from_numpy(view[0]) for view in seen(cameras, middle)]).float()
        torch.testing.assert_close(boxes_of(person, standing(person, UP), cameras, boxes), expected)


def test_where_the_person_is_not_seen_there_is_no_box() -> None:
    cameras = wide()
    person = people_of(cameras, seen(cameras, TALL))[0]
    boxes = seen(cameras, TALL)
    boxes[3] = seen(cameras, SMALL)[3]
    boxes[5] = boxes[5][:0]
    found = boxes_of(person, standing(person, UP), cameras, boxes)
    assert torch.isnan(found[:, 0]).nonzero()[:, 0].tolist() == [3, 5]


@pytest.mark.parametrize("span", [0.8, 0.5, 0.3, 0.2])
def test_in_a_close_up_the_box_that_the_frame_cuts_is_the_persons(span: float) -> None:
    person = Found(*TALL, views=12)
    face = TALL[0] + 0.45 * TALL[1] * UP
    eye = torch.tensor([[0.0, float(face[1]), span * TALL[1] / (2 * math.tan(FOV / 2))]], dtype=torch.float64)
    camera = Camera.look_at(eye, face[None], UP, FOV, SIZE)
    whole = seen_anywhere(camera, TALL)
    low, high = np.maximum(whole[:2], 0), np.minimum(whole[:2] + whole[2:4], SIZE)
    cut = np.concatenate([low, high - low, [0.9]])
    bystander = np.array([20.0, 200.0, 40.0, 120.0, 0.9])
    for body in (standing(person, UP), TALL[0] + torch.tensor([[0, 0.9, 0], [0.2, 0.5, 0], [-0.2, -0.8, 0]])):
        found = boxes_of(person, body, camera, [np.stack([bystander, cut])])
        torch.testing.assert_close(found[0], torch.from_numpy(cut).float())
        assert boxes_of(person, body, camera, [bystander[None]]).isnan().all()


def test_one_out_of_the_frame_or_behind_the_camera_has_no_box() -> None:
    person = Found(*TALL, views=12)
    eye = torch.tensor([[0.0, 0.0, 4.0]], dtype=torch.float64)
    away = torch.tensor([[4.0, 0.0, 4.0], [0.0, 0.0, 8.0]], dtype=torch.float64)
    cameras = Camera.look_at(eye, away, UP, FOV, SIZE)
    box = np.array([[0.0, 100.0, 60.0, 200.0, 0.9]])
    assert boxes_of(person, standing(person, UP), cameras, [box, box]).isnan().all()


def test_a_scene_is_searched_from_far_then_near() -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    middle, height = scene.subject.anchor, scene.subject.height
    other = middle + torch.tensor([1.6, 0.0, 0.0], dtype=torch.float64)
    people = find_people(scene, lambda cameras: seen(cameras, (middle, height), (other, 0.9 * height)))
    assert len(people) == 2
    assert {min(range(2), key=lambda i: float((p.middle - (middle, other)[i]).norm())) for p in people} == {0, 1}


def test_nobody_and_too_few_are_errors() -> None:
    scene, renderer = named_scene("courtyard"), RENDERERS.build("gaussian_splats")
    with pytest.raises(InputError, match="no person found") as caught:
        chosen(find_people(scene, lambda cameras: seen(cameras)), 0, scene, renderer)
    up, views = "give --up X,Y,Z", "cltransfer lift SCENE --view TRAJECTORY.json --out FOLDER"
    subject = "then transfer --subject FOLDER/subject.json)"
    assert str(caught.value).endswith(
        f"any view (if the scene is not upright, {up}; or lift it from views of your own: {views}, {subject}"
    )
    cameras = wide()
    with pytest.raises(UsageError, match=r"person 1: only person 0 is seen in this scene$"):
        chosen(people_of(cameras, seen(cameras, TALL)), 1, scene, renderer)
    with pytest.raises(UsageError, match=r"person 2: expected 0 to 1: 2 are seen$"):
        chosen(2 * people_of(cameras, seen(cameras, TALL)), 2, scene, renderer)


def of_reach(reach: float, geometry: str) -> Scene:
    """A box most of which lies within about ``reach`` of its middle."""
    signs = torch.tensor([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    mesh = Mesh.plain(reach / 3**0.5 * signs, torch.combinations(torch.arange(8), 3))
    forms = {
        "mesh": lambda: mesh,
        "gaussian_splats": lambda: bake_splats(mesh, 500),
        "nerf_grid": lambda: bake_grid(mesh, 8),
    }
    return Scene(forms[geometry](), None, UP, "box", "")


@pytest.mark.parametrize("geometry", ["mesh", "gaussian_splats", "nerf_grid"])
@pytest.mark.parametrize("reach", [0.05, 0.9, 20.0])
def test_who_may_be_cut_off_before_the_lens_is_told_with_the_options_that_draw_them(
    reach: float, geometry: str
) -> None:
    scene, usual = of_reach(reach, geometry), RENDERERS.build(geometry)
    nearest = _reach(scene)[1] / 10
    with pytest.raises(InputError) as caught:
        chosen([], 0, scene, usual)
    options = dict(re.findall(rf"renderer.{geometry}.(\w+)=([\d.e-]+\d)", str(caught.value)))
    assert bool(options) == ("cut off before the lens" in str(caught.value)) == (nearest < drawn_whole(usual))
    if options:
        told = RENDERERS.build(geometry, {name: float(value) for name, value in options.items()})
        assert 0 < drawn_whole(told) <= nearest
        with pytest.raises(InputError) as caught:
            chosen([], 0, scene, told)
        assert "cut off" not in str(caught.value)


def test_a_scene_that_is_one_point_is_said() -> None:
    point = replace(of_reach(1.0, "gaussian_splats"), name="dot", subject=None)
    point = replace(point, geometry=subset(point.geometry, torch.tensor([0])))
    with pytest.raises(InputError, match=r"^dot: scene: expected something that has an extent, all Splats lie at one"):
        find_people(point, lambda cameras: [np.zeros((0, 5))] * len(cameras))


def test_an_empty_scene_is_said() -> None:
    grid = bake_grid(of_reach(1.0, "mesh").geometry, 8)
    nothing = Scene(replace(grid, density=grid.density * 0), None, UP, "fog", "")
    with pytest.raises(InputError, match=r"^fog: scene: expected something to see, got an empty NerfGrid$"):
        find_people(nothing, lambda cameras: [np.zeros((0, 5))] * len(cameras))
