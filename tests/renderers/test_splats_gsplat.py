"""Our side of gsplat: against the oracle on the CPU with gsplat's functions in torch, on a GPU with gsplat itself."""

from __future__ import annotations

import importlib.util
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
import torch
from torch import Tensor

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.camera import Camera
from cltransfer.errors import ModelError
from cltransfer.renderers import _splats_gsplat, gaussian_splats
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene
from cltransfer.scenes.simplify import subset
from cltransfer.scenes.splats import Splats

ALL = GaussianSplats.provides
HAS_GSPLAT, HAS_CUDA = importlib.util.find_spec("gsplat") is not None, torch.cuda.is_available()
on_gpu = pytest.mark.skipif(not (HAS_GSPLAT and HAS_CUDA), reason="no CUDA device here, or gsplat is not installed")


def scene_of(splats: Splats) -> Scene:
    return Scene(splats, None, torch.tensor([0.0, 0.0, 1.0]), "test", "0" * 64)


def psnr(a: Tensor, b: Tensor) -> float:
    return -10 * math.log10(float(((a - b) ** 2).mean()))


@pytest.fixture
def gsplat(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """gsplat's functions on the CPU."""
    path = Path(__file__).with_name("gsplat_in_torch.py")
    spec = importlib.util.spec_from_file_location("gsplat", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "gsplat", module)
    spec.loader.exec_module(module)
    return module


def off_centre(cameras: Camera) -> Camera:
    K = cameras.K.clone()
    K[:, 0, 0] *= torch.tensor([0.6, 1.0, 2.0], dtype=torch.float64)
    K[:, :2, 2] += torch.tensor([3.0, -2.0], dtype=torch.float64)
    return replace(cameras, K=K)


def test_a_scene_without_gaussians_is_empty_as_it_is_by_the_oracle(monkeypatch):
    monkeypatch.setattr(gaussian_splats, "require_gsplat", lambda *_: None)
    empty = scene_of(subset(synthetic_room(10), torch.zeros(10, dtype=torch.bool)))
    cameras = room_cameras(2, (33, 17))
    got, plain = (GaussianSplats(backend=name).render(empty, cameras, ALL) for name in ("gsplat", "torch"))
    for name in ALL:
        torch.testing.assert_close(got.require(name), plain.require(name), equal_nan=True, rtol=0, atol=0)


@pytest.mark.parametrize("antialiased", [True, False])
def test_every_buffer_is_the_oracles(gsplat, antialiased):
    room, cameras = synthetic_room(3000, degree=2), off_centre(room_cameras(3, (75, 50)))
    renderer = GaussianSplats(backend="torch", antialiased=antialiased, near=0.5, near_fade=1.0)
    plain = renderer.render(scene_of(room), cameras, ALL)
    got = _splats_gsplat.render(room, cameras, renderer.settings, ALL)
    assert psnr(got["image"], plain.image) >= 50
    assert torch.equal(got["depth"].isnan(), plain.depth.isnan())
    assert ((got["depth"] - plain.depth).abs() > 1e-3 * plain.depth).float().mean() < 1e-3
    torch.testing.assert_close(got["alpha"], plain.alpha, atol=1.5e-2, rtol=0)
    torch.testing.assert_close(got["label"], plain.label, atol=1.5e-2, rtol=0)
    error = (got["expected_depth"] / plain.expected_depth - 1).abs()
    assert error.max() < 2e-2
    assert error.mean() < 2e-4


def test_without_the_cap_on_a_splats_opacity_it_is_the_oracle_bit_by_bit_nearly(gsplat, monkeypatch):
    monkeypatch.setattr(gsplat, "MAX_ALPHA", 0.99)
    room, cameras = synthetic_room(2000, degree=0), room_cameras(2, (64, 48))
    renderer = GaussianSplats(backend="torch")
    plain = renderer.render(scene_of(room), cameras, frozenset({"image"}))
    got = _splats_gsplat.render(room, cameras, renderer.settings, frozenset({"image"}))
    assert psnr(got["image"], plain.image) >= 80


def test_groups_of_cameras_are_drawn_like_all_at_once(gsplat, monkeypatch):
    room, cameras = synthetic_room(500, degree=0), room_cameras(3, (40, 30))
    whole = _splats_gsplat.render(room, cameras, GaussianSplats().settings, ALL)
    monkeypatch.setattr(_splats_gsplat, "MOST_PROJECTED", 1000)
    assert [(g.start, g.stop) for g in _splats_gsplat.groups(500, cameras)] == [(0, 2), (2, 4)]
    parts = _splats_gsplat.render(room, cameras, GaussianSplats().settings, ALL)
    for name in ALL:
        torch.testing.assert_close(parts[name], whole[name], rtol=0, atol=0, equal_nan=True)


def test_a_camera_that_sees_nothing_gets_zeros_and_undefined_depth(gsplat):
    away = Camera.look_at(
        torch.tensor([[0.0, 0, 50]]), torch.tensor([[0.0, 1, 100]]), torch.tensor([0.0, 0, 1]), 0.8, (20, 10)
    )
    got = _splats_gsplat.render(synthetic_room(500), away, GaussianSplats().settings, ALL)
    assert got["image"].abs().max() == 0
    assert got["depth"].isnan().all()
    assert got["expected_depth"].isnan().all()


def test_only_what_is_asked_for_is_drawn(gsplat, monkeypatch):
    monkeypatch.setattr(_splats_gsplat, "_paint", None)
    monkeypatch.delattr(gsplat, "rasterize_to_indices_in_range")
    got = _splats_gsplat.render(
        synthetic_room(300), room_cameras(2, (32, 18)), GaussianSplats().settings, frozenset({"label", "alpha"})
    )
    assert {name: tuple(value.shape) for name, value in got.items()} == {"label": (2, 18, 32), "alpha": (2, 18, 32)}


def test_medians_stand_behind_those_that_leave_more_than_half():
    at, crossed = _splats_gsplat.median_places(torch.tensor([2, 0, 1, 0]), torch.tensor([5, 0, 1, 3]))
    assert crossed.tolist() == [True, False, False, True]
    assert at.tolist() == [2, 6]


@pytest.mark.skipif(HAS_GSPLAT, reason="gsplat is installed")
def test_without_gsplat_one_line_says_how_to_get_it():
    with pytest.raises(ModelError) as caught:
        GaussianSplats(backend="gsplat").render(scene_of(synthetic_room(200)), room_cameras(1, (8, 8)), ALL)
    assert str(caught.value) == (
        'renderer gaussian_splats: gsplat is not installed (pip install "cltransfer[cuda]", or backend=numba)'
    )
    assert caught.value.exit_code == 4


@pytest.mark.skipif(HAS_CUDA, reason="a CUDA device is here")
def test_torch_on_a_device_that_is_not_there_is_refused_in_one_line():
    with pytest.raises(ModelError, match="there is no CUDA device"):
        GaussianSplats("torch", device="cuda").render(scene_of(synthetic_room(200)), room_cameras(1, (8, 8)), ALL)


@on_gpu
def test_gsplat_itself_matches_the_oracle():
    room, cameras = scene_of(synthetic_room(10_000)), room_cameras(4, (160, 90))
    plain = GaussianSplats(backend="torch").render(room, cameras, ALL)
    got = GaussianSplats(backend="gsplat").render(room, cameras, ALL)
    assert psnr(got.image, plain.image) >= 50
    assert ((got.depth - plain.depth).abs() > 1e-3 * plain.depth).float().mean() < 1e-3
    assert (got.depth.isnan() == plain.depth.isnan()).float().mean() > 0.999
    torch.testing.assert_close(got.label, plain.label, atol=1.5e-2, rtol=0)
