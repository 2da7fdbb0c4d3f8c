"""Numba against plain torch, and both against values worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.camera import Camera, intrinsics
from cltransfer.errors import UsageError
from cltransfer.renderers._nerf_grid_torch import Rays, march
from cltransfer.renderers.kernels import grids
from cltransfer.renderers.kernels.grid_march import Settings
from cltransfer.renderers.nerf_grid import NerfGridRenderer
from cltransfer.scenes import Scene
from cltransfer.scenes.nerf_grid import NerfGrid
from cltransfer.testing import RendererCase

ALL = NerfGridRenderer.provides
SH0 = 0.28209479177387814
BOX = torch.tensor([[-1.0, -1, 3], [1, 1, 5]], dtype=torch.float64)


def scene_of(grid: NerfGrid) -> Scene:
    return Scene(grid, None, torch.tensor([0.0, 0, 1]), "test", "0" * 64)


def forward(size: tuple[int, int] = (1, 1), focal: float = 100.0) -> Camera:
    return Camera(torch.eye(4).double()[None], intrinsics(torch.tensor([focal]).double(), size), size)


def around(middle: torch.Tensor, distance: float, size: tuple[int, int]) -> Camera:
    sides = torch.tensor([[1.0, 0.3, 0.4], [-0.5, 1, 0.1], [0.2, -0.7, -1]], dtype=torch.float64)
    return Camera.look_at(middle + distance * sides, middle, torch.tensor([0.0, 0, 1]), 0.9, size)


def slab(density: float, color: tuple[float, float, float] = (0.2, 0.4, 0.6)) -> NerfGrid:
    sh = ((torch.tensor(color) - 0.5) / SH0).expand(9, 9, 9, 1, 3).clone()
    return NerfGrid(torch.full((9, 9, 9), density), sh, torch.full((9, 9, 9), 0.5), BOX)


def blobs(shape: tuple[int, int, int], degree: int, seed: int = 0) -> NerfGrid:
    """Lumps of matter in a box whose voxels are not cubes."""
    random = torch.Generator().manual_seed(seed)
    coarse = torch.randn(1, 1, 5, 5, 5, generator=random)
    lumps = torch.nn.functional.interpolate(coarse, shape, mode="trilinear", align_corners=True)[0, 0]
    sh = torch.randn(*shape, (degree + 1) ** 2, 3, generator=random) * 0.4
    aabb = torch.tensor([[-1.0, -2, 0], [2, 2, 1.5]], dtype=torch.float64)
    return NerfGrid((lumps * 20 - 8).clamp(min=0), sh, (lumps > 0.5).float(), aabb)


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("step", [0.3, 1.0])
def test_numba_matches_the_oracle(degree, step):
    grid = blobs((22, 41, 30), degree)
    cameras = around(grid.aabb.mean(0), 3.0, (31, 18))
    fast = NerfGridRenderer(step=step).render(scene_of(grid), cameras, ALL)
    plain = NerfGridRenderer(backend="torch", step=step).render(scene_of(grid), cameras, ALL)
    assert plain.alpha.max() > 0.9
    for buffer in ("image", "alpha", "label"):
        torch.testing.assert_close(fast.require(buffer), plain.require(buffer), atol=2e-4, rtol=0)
    for buffer in ("depth", "expected_depth"):
        both = fast.require(buffer), plain.require(buffer)
        assert (both[0].isnan() != both[1].isnan()).float().mean() < 2e-3
        assert (both[0] - both[1]).abs().nanmean() < 1e-4


def test_a_camera_inside_the_box_matches_the_oracle_and_sees_nothing_before_near():
    grid = blobs((22, 41, 30), 1)
    cameras = around(grid.aabb.mean(0), 0.6, (31, 18))
    fast = NerfGridRenderer(near=0.4).render(scene_of(grid), cameras, ALL)
    plain = NerfGridRenderer(near=0.4, backend="torch").render(scene_of(grid), cameras, ALL)
    torch.testing.assert_close(fast.image, plain.image, atol=2e-4, rtol=0)
    assert fast.depth[fast.depth.isfinite()].min() >= 0.4


@pytest.mark.parametrize("backend", ["numba", "torch"])
@pytest.mark.parametrize("density", [0.1, 0.7, 3.0])
def test_a_uniform_slab_absorbs_as_beer_and_lambert_say(backend, density):
    got = NerfGridRenderer(backend=backend).render(scene_of(slab(density)), forward(), ALL)
    alpha = 1 - math.exp(-density * 2)
    assert got.alpha.item() == pytest.approx(alpha, abs=1e-4)
    assert got.label.item() == pytest.approx(alpha / 2, abs=1e-4)
    assert got.image.flatten().tolist() == pytest.approx([0.2 * alpha, 0.4 * alpha, 0.6 * alpha], abs=1e-4)


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_depths_in_a_uniform_slab_are_those_of_the_exponential(backend):
    density, thick = 1.5, 2.0
    got = NerfGridRenderer(backend=backend, step=0.1).render(scene_of(slab(density)), forward(), ALL)
    assert got.depth.item() == pytest.approx(3 + math.log(2) / density, abs=1e-5)
    left = math.exp(-density * thick)
    mean = 3 + 1 / density - thick * left / (1 - left)
    assert got.expected_depth.item() == pytest.approx(mean, abs=1e-3)


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_a_dense_box_has_the_depth_of_its_face_along_the_axis(backend):
    camera = forward((33, 33), focal=66.0)
    got = NerfGridRenderer(backend=backend).render(scene_of(slab(2000.0)), camera, ALL)
    inside = got.alpha > 0.5
    assert inside[0, 8:25, 8:25].all()
    torch.testing.assert_close(got.depth[inside], torch.full_like(got.depth[inside], 3.0), atol=2e-3, rtol=0)
    assert got.depth[~inside].isnan().all()


def test_half_a_pixel_of_matter_has_no_median_and_a_trace_no_mean():
    faint, trace = (NerfGridRenderer().render(scene_of(slab(d)), forward(), ALL) for d in (0.3, 1e-4))
    assert faint.depth.isnan().all()
    assert faint.expected_depth.isfinite().all()
    assert trace.expected_depth.isnan().all()


def test_a_camera_that_looks_away_sees_black():
    away = Camera.look_at(torch.zeros(1, 3), torch.tensor([[0.0, 0, -1]]), torch.tensor([0.0, -1, 0]), 0.9, (4, 3))
    got = NerfGridRenderer().render(scene_of(slab(5.0)), away, ALL)
    assert not got.alpha.any()
    assert not got.image.any()
    assert got.depth.isnan().all()


def test_jumping_over_empty_bricks_changes_nothing():
    grid = blobs((60, 70, 50), 0, seed=3)
    grid = replace(grid, density=grid.density * (torch.arange(50) % 25 < 4))
    packed = grid.packed
    assert (packed.bricks > 0).any()
    cameras = around(grid.aabb.mean(0), 3.0, (40, 30))
    views = [grids.make_view(packed, w2c, K, cameras.size, Settings(0.1, 0.5))
             for w2c, K in zip(cameras.w2c.numpy(), cameras.K.numpy())]  # fmt: skip
    jumping = grids.render(packed, views, ALL, 1)
    walking = grids.render(packed._replace(bricks=packed.bricks * 0), views, ALL, 1)
    for a, b in zip(jumping, walking):
        torch.testing.assert_close(torch.from_numpy(a), torch.from_numpy(b), atol=2e-5, rtol=1e-5, equal_nan=True)


def test_threads_do_not_change_a_pixel():
    grid = blobs((22, 41, 30), 2)
    cameras = around(grid.aabb.mean(0), 3.0, (31, 18))
    one, three = (NerfGridRenderer(threads=n).render(scene_of(grid), cameras, ALL) for n in (1, 3))
    for buffer in ALL:
        torch.testing.assert_close(one.require(buffer), three.require(buffer), atol=0, rtol=0, equal_nan=True)


def test_the_oracle_has_the_slopes_of_finite_differences():
    grid = blobs((5, 6, 4), 1)
    density, sh = ((v.double() + 0.3).requires_grad_() for v in (grid.density, grid.sh))
    origin = torch.tensor([[-3.0, 0.1, 0.6]]).double()
    direction = torch.tensor([[1.0, 0.05, 0.02]]).double()

    def seen(density, sh):
        field = NerfGrid(density, sh, grid.label.double(), grid.aabb)
        return march(field, Rays(origin, direction), Settings(0.1, 0.5))["image"]

    assert torch.autograd.gradcheck(seen, (density, sh), atol=1e-6)


def test_empty_cells_named_to_the_oracle_are_left_out():
    grid = slab(1.0)
    rays = Rays(torch.zeros(1, 3), torch.tensor([[0.0, 0, 1]]))
    filled = torch.zeros(8, 8, 8, dtype=torch.bool)
    assert march(grid, rays, Settings(0.1, 0.5), filled)["alpha"].item() == 0
    filled[:4] = True  # the nearer half
    assert march(grid, rays, Settings(0.1, 0.5), filled)["alpha"].item() == pytest.approx(1 - math.exp(-1), abs=1e-4)


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(UsageError, match=r"does not draw Splats .choose: renderer.gaussian_splats={}"):
        NerfGridRenderer().render(replace(scene_of(slab(1.0)), geometry=synthetic_room(200)), forward(), ALL)
    with pytest.raises(UsageError, match="has no buffer flow"):
        NerfGridRenderer().render(scene_of(slab(1.0)), forward(), frozenset({"flow"}))
    skew = forward()
    skew.K[0, 0, 1] = 1
    with pytest.raises(ValueError, match="skew"):
        NerfGridRenderer().render(scene_of(slab(1.0)), skew, ALL)
    for options, line in (({"step": 0.0}, "step must be in"), ({"near": 0.0}, "near"), ({"threads": -1}, "threads")):
        with pytest.raises(ValueError, match=line):
            NerfGridRenderer(**options)


class TestContract(RendererCase):
    component = NerfGridRenderer()
    scene = scene_of(slab(200.0))
    points = torch.cartesian_prod(*(torch.linspace(float(BOX[0, k]), float(BOX[1, k]), 17) for k in range(3)))
