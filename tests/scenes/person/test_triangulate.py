"""One point from many views, some of which are wrong."""

from __future__ import annotations

import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.scenes.person import triangulate as module
from cltransfer.scenes.person.triangulate import triangulate


def ring(views: int) -> Camera:
    azimuth = torch.arange(views, dtype=torch.float64) * (2 * math.pi / views)
    eye = torch.stack([4 * torch.cos(azimuth), 4 * torch.sin(azimuth), 0.5 + 0.1 * azimuth], dim=1)
    return Camera.look_at(eye, torch.zeros(1, 3), torch.tensor([0.0, 0, 1]), 0.7, (640, 360))


POINT = torch.tensor([[0.2, -0.1, 0.4]], dtype=torch.float64)


def test_exact_pixels_give_the_exact_point() -> None:
    cameras = ring(8)
    pixels = cameras.project(POINT)[0][:, 0]
    found = triangulate(cameras, pixels, torch.ones(8, dtype=torch.bool), 8.0)
    torch.testing.assert_close(found.point, POINT[0], atol=1e-9, rtol=0)
    assert bool(found.agreed.all())
    assert float(found.error.max()) < 1e-6


def test_wrong_views_are_outvoted_and_named() -> None:
    cameras = ring(10)
    pixels = cameras.project(POINT)[0][:, 0]
    pixels[[1, 4, 7]] += torch.tensor([60.0, -40.0], dtype=torch.float64)
    found = triangulate(cameras, pixels, torch.ones(10, dtype=torch.bool), 8.0)
    torch.testing.assert_close(found.point, POINT[0], atol=1e-6, rtol=0)
    assert (~found.agreed).nonzero()[:, 0].tolist() == [1, 4, 7]


def test_a_pair_that_meets_behind_a_camera_does_not_spoil_the_rest() -> None:
    cameras = ring(6)
    pixels = cameras.project(POINT)[0][:, 0]
    pixels[0] = torch.tensor([-4000.0, 180.0])  # its rays meet others behind the cameras: infinite errors
    found = triangulate(cameras, pixels, torch.ones(6, dtype=torch.bool), 8.0)
    torch.testing.assert_close(found.point, POINT[0], atol=1e-6, rtol=0)


def test_pairs_are_looked_at_a_few_at_a_time_to_the_same_end(monkeypatch: pytest.MonkeyPatch) -> None:
    cameras = ring(10)
    pixels = cameras.project(POINT)[0][:, 0]
    pixels[[1, 4, 7]] += torch.tensor([60.0, -40.0], dtype=torch.float64)
    sizes: list[int] = []
    plain = module._of_pairs

    def counted(P: torch.Tensor, xy: torch.Tensor, pairs: torch.Tensor) -> torch.Tensor:
        sizes.append(len(pairs))
        return plain(P, xy, pairs)

    monkeypatch.setattr(module, "_of_pairs", counted)
    found = []
    for block in (module.BLOCK, 70):
        monkeypatch.setattr(module, "BLOCK", block)
        found.append(triangulate(cameras, pixels, torch.ones(10, dtype=torch.bool), 8.0))
    assert sizes == [5, 45, 1, 5, 7, 7, 7, 7, 7, 7, 3, 1]
    torch.testing.assert_close(found[0].point, found[1].point, atol=1e-12, rtol=0)
    assert torch.equal(found[0].agreed, found[1].agreed)


@pytest.mark.parametrize("wrong", [0, 1])
def test_views_that_all_agree_take_few_pairs_and_give_what_all_pairs_give(
    monkeypatch: pytest.MonkeyPatch, wrong: int
) -> None:
    cameras = ring(21)
    noise = torch.randn(21, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    pixels = cameras.project(POINT)[0][:, 0] + noise
    pixels[:wrong] += 60.0
    tried: list[torch.Tensor] = []
    plain = module._of_pairs

    def noted(P: torch.Tensor, xy: torch.Tensor, pairs: torch.Tensor) -> torch.Tensor:
        tried.append(plain(P, xy, pairs))
        return tried[-1]

    monkeypatch.setattr(module, "_of_pairs", noted)
    found = triangulate(cameras, pixels, torch.ones(21, dtype=torch.bool), 8.0)
    assert sum(map(len, tried)) == (11 if wrong == 0 else 11 + 210 + 1)
    P = cameras.K @ cameras.w2c[:, :3]
    errors = plain(P, pixels, torch.combinations(torch.arange(21), 2))
    best = errors[int(module._agreeing(errors, 8.0).argmax())] < 8.0
    torch.testing.assert_close(found.point, module._intersect(P[best][None], pixels[best][None])[0], atol=3e-3, rtol=0)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (40.0, -3.0, 25.0)])
def test_a_point_does_not_depend_on_where_the_world_has_its_origin(origin: tuple[float, float, float]) -> None:
    """Views from a short way beside one another, as of a truck: there the linear method draws towards the origin."""
    generator, shift = torch.Generator().manual_seed(0), torch.tensor(origin, dtype=torch.float64)
    eye = shift + torch.stack([torch.linspace(-0.4, 0.4, 24), torch.zeros(24), torch.full((24,), -5.0)], 1).double()
    cameras = Camera.look_at(eye, shift, torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64), 0.7, (640, 360))
    point = shift + torch.tensor([0.1, 0.2, 0.0], dtype=torch.float64)
    pixels = cameras.project(point[None])[0][:, 0] + 2 * torch.randn(24, 2, generator=generator, dtype=torch.float64)
    found = triangulate(cameras, pixels, torch.ones(24, dtype=torch.bool), 12.0)
    assert float((found.point - point).norm()) < 0.25


def test_fewer_than_two_views_leave_the_point_unknown() -> None:
    cameras = ring(4)
    pixels = cameras.project(POINT)[0][:, 0]
    found = triangulate(cameras, pixels, torch.tensor([True, False, False, False]), 8.0)
    assert bool(torch.isnan(found.point).all())
    assert not bool(found.agreed.any())


def test_a_view_that_looks_away_does_not_agree() -> None:
    """It is given the pixel at which the point behind it would be drawn."""
    turn = torch.arange(6, dtype=torch.float64) * (2 * math.pi / 6)
    eye = torch.stack([4 * torch.cos(turn), 4 * torch.sin(turn), 0.5 + 0.1 * turn], dim=1)
    aim = torch.zeros(6, 3, dtype=torch.float64)
    aim[5] = 2 * eye[5]
    cameras = Camera.look_at(eye, aim, torch.tensor([0.0, 0, 1]), 0.7, (640, 360))
    point = torch.tensor([[0.2, -0.1, 0.4]], dtype=torch.float64)
    pixels = cameras.project(point)[0][:, 0]
    behind = cameras.to_camera(point)[5, 0]
    pixels[5] = (cameras.K[5] @ behind)[:2] / behind[2]
    found = triangulate(cameras, pixels, torch.ones(6, dtype=torch.bool), 8.0)
    assert found.agreed.tolist() == [True] * 5 + [False]
