"""People are found by the boxes that meet: every one of them, none that is not there, each by its own boxes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.errors import InputError, UsageError
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.find_people import Boxes, boxes_of, chosen, find_people, people_of, ring

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
    for person in people_of(cameras, boxes):
        middle = TALL if person.height > 1.5 else SMALL
        expected = torch.stack([torch.from_numpy(view[0]) for view in seen(cameras, middle)]).float()
        torch.testing.assert_close(boxes_of(person, cameras, boxes), expected)


def test_where_the_person_is_not_seen_there_is_no_box() -> None:
    cameras = wide()
    person = people_of(cameras, seen(cameras, TALL))[0]
    boxes = seen(cameras, TALL)
    boxes[3] = seen(cameras, SMALL)[3]
    boxes[5] = boxes[5][:0]
    found = boxes_of(person, cameras, boxes)
    assert torch.isnan(found[:, 0]).nonzero()[:, 0].tolist() == [3, 5]


def test_a_scene_is_searched_from_far_then_near() -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    middle, height = scene.subject.anchor, scene.subject.height
    other = middle + torch.tensor([1.6, 0.0, 0.0], dtype=torch.float64)
    people = find_people(scene, lambda cameras: seen(cameras, (middle, height), (other, 0.9 * height)))
    assert len(people) == 2
    assert {min(range(2), key=lambda i: float((p.middle - (middle, other)[i]).norm())) for p in people} == {0, 1}


def test_nobody_and_too_few_are_errors() -> None:
    scene = named_scene("courtyard")
    with pytest.raises(InputError, match="no person found") as caught:
        chosen(find_people(scene, lambda cameras: seen(cameras)), 0, scene)
    assert "cut off" not in str(caught.value)
    cameras = wide()
    with pytest.raises(UsageError, match="expected 0 to 0: 1 are seen"):
        chosen(people_of(cameras, seen(cameras, TALL)), 1, scene)


def test_of_a_tiny_scene_the_hint_says_how_to_draw_it_whole() -> None:
    scene = named_scene("courtyard")
    splats = scene.geometry
    tiny = replace(scene, geometry=replace(splats, means=0.02 * splats.means, scales=0.02 * splats.scales))
    said = r"cut off before the lens\? renderer.gaussian_splats.near=(\S+) renderer.gaussian_splats.near_fade=([^,]+),"
    with pytest.raises(InputError) as caught:
        chosen([], 0, tiny)
    found = re.search(said, str(caught.value))
    assert found is not None
    assert scene.subject is not None
    assert 0 < float(found[1]) + float(found[2]) < 0.02 * 2.2 * scene.subject.height  # from where a ring looks at them
