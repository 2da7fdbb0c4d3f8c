"""Views: looked at when they are wanted, once, and after the ones before them."""

from __future__ import annotations

import sys
import weakref
from collections.abc import Callable

import torch

from cltransfer.camera import Camera
from cltransfer.driver.view import View
from cltransfer.features import Features

SIZE = (4, 3)


def cameras(count: int) -> Camera:
    at = torch.arange(float(count))
    eyes = torch.stack([at, torch.zeros(count), torch.full((count,), -5.0)], dim=1)
    return Camera.look_at(eyes, torch.zeros(3), torch.tensor([0.0, 1.0, 0.0]), 0.7, SIZE)


def seen(count: int, looks: list[str], name: str) -> Callable[[], Features]:
    def look() -> Features:
        looks.append(name)
        return Features(SIZE, image=torch.zeros(count, 3, *SIZE[::-1]))

    return look


def test_it_is_looked_at_once_and_only_when_it_is_wanted() -> None:
    looks = list[str]()
    view = View(cameras(3), seen(3, looks, "view"), None)
    part = view.part(1)
    assert looks == []
    assert part is view.part(1)
    assert part is not view.part(2)
    assert len(part.features) == 1
    assert part.features is part.features
    assert view.features is view.features
    assert looks == ["view"]


def test_one_camera_s_view_is_its_own_part() -> None:
    view = View(cameras(1), seen(1, [], "view"), None)
    assert view.part(0) is view


def test_those_before_are_looked_at_first_however_many_there_are() -> None:
    looks, views, camera = list[str](), list[View](), cameras(1)
    count = sys.getrecursionlimit() + 10
    for i in range(count):
        views.append(View(camera, seen(1, looks, str(i)), views[-1] if views else None))
    views[-1].settle()
    assert looks == [str(i) for i in range(count)]


def test_what_was_looked_at_holds_nothing_that_looking_took() -> None:
    class Scene:
        pass

    def of(scene: Scene, before: View | None) -> View:
        return View(cameras(1), lambda: Features(SIZE, image=torch.full((1, 3, 3, 4), float(bool(scene)))), before)

    scene, first = Scene(), View(cameras(1), seen(1, [], "first"), None)
    held = weakref.ref(scene), weakref.ref(first)
    view = of(scene, first)
    del scene, first
    assert all(one() is not None for one in held)
    view.settle()
    assert all(one() is None for one in held)
