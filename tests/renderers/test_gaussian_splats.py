"""Numba against the torch oracle, and both against values worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.camera import Camera, intrinsics
from cltransfer.errors import UsageError
from cltransfer.registry import RENDERERS
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene
from cltransfer.scenes.simplify import PARTS, subset
from cltransfer.scenes.splats import Splats

ALL = GaussianSplats.provides
SH0 = 0.28209479177387814


def scene_of(splats: Splats) -> Scene:
    return Scene(splats, None, torch.tensor([0.0, 0.0, 1.0]), "test", "0" * 64)


def balls(means: list[list[float]], scale: float, opacity: float, colors: list[list[float]]) -> Splats:
    n = len(means)
    sh = ((torch.tensor(colors) - 0.5) / SH0)[:, None]
    quats = torch.tensor([[1.0, 0, 0, 0]]).expand(n, 4)
    return Splats(torch.tensor(means), torch.full((n, 3), scale), quats, torch.full((n,), opacity), sh, torch.zeros(n))


def forward_camera(size: tuple[int, int], focal: float) -> Camera:
    return Camera(torch.eye(4).double()[None], intrinsics(torch.tensor([focal]).double(), size), size)


def psnr(a: Tensor, b: Tensor) -> float:
    return -10 * math.log10(float(((a - b) ** 2).mean()))


def both(splats: Splats, cameras: Camera, **options: object) -> tuple[object, object]:
    scene = scene_of(splats)
    fast = GaussianSplats(**options).render(scene, cameras, ALL)  # type: ignore[arg-type]
    plain = GaussianSplats(backend="torch", **options).render(scene, cameras, ALL)  # type: ignore[arg-type]
    return fast, plain


@pytest.mark.parametrize("antialiased", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_numba_matches_the_oracle_at_10k(antialiased):
    fast, plain = both(synthetic_room(10_000), room_cameras(1, (96, 54)), antialiased=antialiased)
    assert psnr(fast.image, plain.image) >= 60
    assert torch.equal(fast.depth.isnan(), plain.depth.isnan())
    differs = (fast.depth - plain.depth).abs() > 1e-3 * plain.depth
    assert differs.float().mean() < 1e-3
    torch.testing.assert_close(fast.alpha, plain.alpha, atol=1e-2, rtol=0)
    torch.testing.assert_close(fast.label, plain.label, atol=1e-2, rtol=0)
    error = (fast.expected_depth / plain.expected_depth - 1).abs()
    assert error.max() < 2e-2
    assert error.mean() < 1e-4


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_every_degree_of_harmonics_matches_the_oracle(degree):
    room = synthetic_room(2000, seed=degree, degree=degree)
    room = replace(room, sh=room.sh * torch.where(torch.arange(room.sh.shape[1]) > 0, 8, 1)[:, None])
    fast, plain = both(room, room_cameras(1, (64, 48)))
    assert psnr(fast.image, plain.image) >= 60


@pytest.mark.parametrize("size", [(33, 17), (1, 1), (16, 16), (75, 130)])
def test_odd_sizes_own_focal_lengths_and_off_centre_principal_points_match_the_oracle(size):
    cameras = room_cameras(3, size)
    scale = torch.tensor([[0.6, 0.7], [1.0, 1.0], [2.5, 2.3]], dtype=torch.float64)
    K = cameras.K.clone()
    K[:, 0, 0] *= scale[:, 0]
    K[:, 1, 1] *= scale[:, 1]
    K[:, :2, 2] += torch.tensor([[0.3, -0.2], [0.0, 0.1], [-0.6, 0.7]], dtype=torch.float64) * torch.tensor(size)
    fast, plain = both(synthetic_room(3000), replace(cameras, K=K))
    assert psnr(fast.image, plain.image) >= 60
    assert psnr(fast.alpha, plain.alpha) >= 60


def test_wide_view_keeps_what_the_oracle_keeps_at_the_edges():
    cameras = room_cameras(2, (120, 60))
    K = cameras.K.clone()
    K[:, 0, 0] = K[:, 1, 1] = 25.0  # 135 degrees across
    fast, plain = both(synthetic_room(5000, degree=0), replace(cameras, K=K), near_fade=0.0)
    assert psnr(fast.image, plain.image) >= 60


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_one_ball_has_the_values_worked_out_by_hand(backend):
    # variance on the image: (focal * scale / depth)^2 + 0.3 = (100 * 0.08 / 4)^2 + 0.3 = 4.3 px^2
    ball = balls([[0.0, 0.0, 4.0]], 0.08, 0.8, [[0.25, 0.5, 1.0]])
    camera = forward_camera((9, 9), 100.0)
    renderer = GaussianSplats(backend=backend, antialiased=False, near_fade=0.0)
    got = renderer.render(scene_of(ball), camera, ALL)
    for x, y in ((4, 4), (7, 4), (2, 5)):
        squared = (x - 4) ** 2 + (y - 4) ** 2  # the middle of pixel 4 is at 4.5, the ball's centre
        alpha = 0.8 * math.exp(-squared / 8.6)
        assert float(got.alpha[0, y, x]) == pytest.approx(alpha, abs=2e-5)
        assert got.image[0, :, y, x].tolist() == pytest.approx([alpha * 0.25, alpha * 0.5, alpha], abs=2e-5)
    assert float(got.depth[0, 4, 4]) == 4.0
    assert float(got.expected_depth[0, 4, 4]) == pytest.approx(4.0, abs=1e-5)
    assert math.isnan(float(got.depth[0, 4, 7]))  # alpha 0.28: transmittance stays above a half
    # antialiased: peak * sqrt(4^2 / 4.3^2)
    soft = GaussianSplats(backend=backend, near_fade=0.0).render(scene_of(ball), camera, ALL)
    assert float(soft.alpha[0, 4, 4]) == pytest.approx(0.8 * 4 / 4.3, abs=2e-5)


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_two_balls_composite_front_to_back_whatever_their_order(backend):
    near, far = [0.0, 0.0, 2.0], [0.0, 0.0, 5.0]
    red, green = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
    renderer = GaussianSplats(backend=backend, antialiased=False, near_fade=0.0)
    for order in (1, -1):
        pair = balls([near, far][::order], 0.5, 0.6, [red, green][::order])
        label = torch.tensor([0.0, 1.0][::order])
        got = renderer.render(scene_of(pair.with_label(label)), forward_camera((1, 1), 50.0), ALL)
        assert got.image[0, :, 0, 0].tolist() == pytest.approx([0.6, 0.24, 0], abs=1e-5)
        assert float(got.label) == pytest.approx(0.24, abs=1e-5)
        assert float(got.depth) == 2.0  # transmittance falls to 0.4 at the first
        assert float(got.expected_depth) == pytest.approx((0.6 * 2 + 0.24 * 5) / 0.84, abs=1e-5)


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_opacity_fades_behind_the_near_plane(backend):
    renderer = GaussianSplats(backend=backend, antialiased=False, near=0.5, near_fade=2.0)
    for depth, share in ((0.4, 0.0), (1.0, 0.25), (2.5, 1.0), (4.0, 1.0)):
        got = renderer.render(
            scene_of(balls([[0.0, 0.0, depth]], 1.0, 0.8, [[1.0, 1.0, 1.0]])),
            forward_camera((1, 1), 50.0),
            ALL,
        )
        assert float(got.alpha) == pytest.approx(0.8 * share, abs=1e-4)


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_the_splat_that_would_leave_less_than_one_ten_thousandth_ends_the_pixel_unseen(backend):
    wall = balls([[0.0, 0.0, 1.0 + 0.1 * k] for k in range(4)], 5.0, 1.0, [[1.0, 1.0, 1.0]] * 4)
    wall = replace(wall, opacity=torch.tensor([1.0, 0.98, 0.98, 0.3]))
    renderer = GaussianSplats(backend=backend, antialiased=False, near_fade=0.0)
    got = renderer.render(scene_of(wall), forward_camera((1, 1), 50.0), ALL)
    # transmittance: 0.01 (alpha is at most 0.99), 0.0002, then 0.000004 is too little, and nothing comes after
    assert float(got.alpha) == pytest.approx(0.9998, abs=2e-6)
    assert got.image[0, :, 0, 0].tolist() == pytest.approx([0.9998] * 3, abs=2e-6)


@pytest.mark.parametrize(("low", "high"), [(1e-4, 2e-4), (0.2, 0.9)])
def test_gaussians_outside_the_frame_reach_into_it_as_the_oracle_says(low, high):
    torch.manual_seed(0)
    n, size, focal = 1500, (24, 16), 8.0
    edge = torch.tensor([size[0], size[1]]) / (2 * focal)
    spot = torch.rand(n, 2) * 2 - 1
    spot = spot / spot.abs().amax(1, keepdim=True)  # on the border of a square
    beyond = 1 + torch.rand(n, 1) * (2 * high if high > 0.1 else 0.2)
    depth = torch.rand(n, 1) * 4 + 2
    splats = Splats(
        torch.cat([spot * beyond * edge * depth, depth], 1),
        (low + torch.rand(n, 3) * (high - low)) * depth,
        torch.nn.functional.normalize(torch.randn(n, 4), dim=-1),
        torch.full((n,), 0.9 if high < 0.1 else 0.05),
        torch.zeros(n, 1, 3),
        torch.zeros(n),
    )
    fast, plain = both(splats, forward_camera(size, focal), antialiased=False)
    assert float(plain.alpha.mean()) > 0.02
    torch.testing.assert_close(fast.alpha, plain.alpha, atol=2e-3, rtol=0)


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_a_camera_that_sees_nothing_gets_zeros_and_undefined_depth(backend):
    room = synthetic_room(500)
    away = Camera.look_at(
        torch.tensor([[0.0, 0, 50]]), torch.tensor([[0.0, 1, 100]]), torch.tensor([0.0, 0, 1]), 0.8, (20, 10)
    )
    got = GaussianSplats(backend=backend).render(scene_of(room), away, ALL)
    assert got.image.abs().max() == 0
    assert got.alpha.abs().max() == 0
    assert got.depth.isnan().all()
    assert got.expected_depth.isnan().all()


def test_a_scene_of_faint_gaussians_only_is_empty():
    faint = balls([[0.0, 0.0, 2.0]], 0.5, 0.003, [[1.0, 1.0, 1.0]])
    got = GaussianSplats().render(scene_of(faint), forward_camera((4, 4), 10.0), ALL)
    assert got.alpha.abs().max() == 0


def test_a_scene_without_gaussians_is_empty():
    for got in both(subset(synthetic_room(10), torch.zeros(10, dtype=torch.bool)), room_cameras(2, (33, 17))):
        assert not any(bool(plane.any()) for plane in (got.alpha, got.image, got.label))
        assert bool(got.depth.isnan().all() and got.expected_depth.isnan().all())


def test_a_batch_equals_its_single_cameras_bit_for_bit_on_any_number_of_threads():
    scene, cameras = scene_of(synthetic_room(3000)), room_cameras(5, (50, 40))
    batch = GaussianSplats(threads=2).render(scene, cameras, ALL)
    again = GaussianSplats(threads=1).render(scene, cameras, ALL)
    for name in ALL:
        single = torch.cat([GaussianSplats(threads=3).render(scene, cameras[i], ALL).require(name) for i in range(5)])
        assert batch.require(name).numpy().tobytes() == single.numpy().tobytes()
        assert batch.require(name).numpy().tobytes() == again.require(name).numpy().tobytes()


def test_a_view_cut_between_threads_has_the_bits_of_one_drawn_whole():
    scene, cameras = scene_of(synthetic_room(60_000)), room_cameras(3, (90, 50))
    for size in ((90, 50), (33, 20)):
        views = cameras.at_size(size)
        whole = GaussianSplats(threads=1).render(scene, views, ALL)
        for threads in (2, 5):
            cut = GaussianSplats(threads=threads).render(scene, views, ALL)
            for name in ALL:
                assert cut.require(name).numpy().tobytes() == whole.require(name).numpy().tobytes(), name


def test_buffers_without_colour_are_the_same_bits_as_with_it():
    scene, cameras = scene_of(synthetic_room(3000)), room_cameras(2, (50, 40))
    full = GaussianSplats().render(scene, cameras, ALL)
    lean = GaussianSplats().render(scene, cameras, frozenset({"depth", "label"}))
    assert lean.names() == {"depth", "label", "camera"}
    for name in ("depth", "label"):
        torch.testing.assert_close(lean.require(name), full.require(name), rtol=0, atol=0, equal_nan=True)


def test_a_gaussian_far_behind_all_others_changes_nothing_in_front():
    room = synthetic_room(2000)
    cameras = room_cameras(1, (50, 40))
    beyond = balls([(cameras.center[0] + cameras.c2w[0, :3, 2] * 1e6).tolist()], 1e5, 0.9, [[1.0, 1.0, 1.0]])
    far = replace(beyond, sh=torch.cat([beyond.sh, torch.zeros(1, 15, 3)], dim=1))
    parts = {
        n: torch.cat([getattr(room, n), getattr(far, n)])
        for n in ("means", "scales", "quats", "opacity", "sh", "label")
    }
    fast, plain = both(Splats(**parts), cameras)
    assert psnr(fast.image, plain.image) >= 60


def test_what_opaque_tiles_hide_is_skipped_and_nothing_else():
    # a wall fills the first slabs and closes the left tiles up to pixel 32; wide Gaussians behind it stick out
    torch.manual_seed(0)
    wall = torch.rand(20_000, 3) * torch.tensor([2.06, 3.0, 0.1]) + torch.tensor([-2.0, -1.5, 2.0])
    behind = torch.rand(100, 3) * torch.tensor([4.0, 5.0, 1.0]) + torch.tensor([-3.0, -2.5, 5.0])
    parts = [balls(wall.tolist(), 0.03, 0.95, [[0.2, 0.4, 0.6]] * len(wall))]
    parts.append(balls(behind.tolist(), 0.4, 0.5, [[0.9, 0.5, 0.1]] * len(behind)).with_label(torch.ones(100)))
    names = ("means", "scales", "quats", "opacity", "sh", "label")
    splats = Splats(**{n: torch.cat([getattr(part, n) for part in parts]) for n in names})
    fast, plain = both(splats, forward_camera((64, 48), 50.0))
    assert fast.label[0, :, :24].max() < 1e-3
    assert fast.label[0, :, 36:42].mean() > 0.2
    torch.testing.assert_close(fast.label, plain.label, atol=2e-4, rtol=0)
    assert psnr(fast.image, plain.image) >= 60


def test_more_tile_lists_than_fit_are_drawn_in_several_slabs():
    means = [[0.0, 0.0, 3.0 + 0.01 * k] for k in range(400)]
    veil = balls(means, 4.0, 0.02, [[0.3 + 0.001 * k, 0.5, 0.9] for k in range(400)])
    fast, plain = both(veil, forward_camera((320, 180), 100.0))  # each touches all 240 tiles
    assert psnr(fast.image, plain.image) >= 60
    assert psnr(fast.alpha, plain.alpha) >= 60


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_absurd_but_finite_gaussians_leave_the_image_finite(backend):
    room = synthetic_room(1000, degree=0)
    scales, means, opacity = room.scales.clone(), room.means.clone(), room.opacity.clone()
    scales[:4] = torch.tensor([1e9, 1e6, 1e-9, 1e5])[:, None]
    means[4:6] = torch.tensor([1e30, -3e38])[:, None]
    opacity[6:9] = torch.tensor([0.0, 1.0, 1.0])
    odd = replace(room, scales=scales, means=means, opacity=opacity)
    got = GaussianSplats(backend=backend).render(scene_of(odd), room_cameras(3, (40, 30)), ALL)
    assert got.image.isfinite().all()
    assert got.alpha.isfinite().all()


@pytest.mark.parametrize("backend", ["numba", "torch"])
@pytest.mark.parametrize("length", [10.0, 30.0])
def test_needles_of_which_float32_leaves_no_ellipse_are_left_out(backend, length):
    generator = torch.Generator().manual_seed(1)
    n = 60
    means = (torch.rand(n, 3, generator=generator) - 0.5) * torch.tensor([1.0, 1, 1]) + torch.tensor([0, 0, 1.5])
    quats = torch.nn.functional.normalize(torch.randn(n, 4, generator=generator), dim=1)
    camera = forward_camera((64, 36), 800.0)
    wrong = []
    for i in range(n):
        needle = replace(balls([means[i].tolist()], 1e-3, 0.8, [[0.5] * 3]), quats=quats[i : i + 1])
        needle = replace(needle, scales=torch.tensor([[length, 1e-3, 1e-3]]))
        exact = replace(needle, **{name: getattr(needle, name).double() for name in PARTS})
        got = GaussianSplats(backend=backend).render(scene_of(needle), camera, frozenset({"alpha"})).alpha
        want = GaussianSplats(backend="torch").render(scene_of(exact), camera, frozenset({"alpha"})).alpha
        wrong += [i] if float((got - want).abs().mean()) > 0.1 else []
    assert wrong == []


def test_identical_gaussians_render():
    same = balls([[0.0, 0.0, 3.0]] * 300, 0.1, 0.5, [[0.2, 0.4, 0.6]] * 300)
    got = GaussianSplats().render(scene_of(same), forward_camera((8, 8), 20.0), ALL)
    assert float(got.alpha.max()) > 0.99


def test_the_registry_builds_it_and_checks_its_options():
    assert RENDERERS.names().count("gaussian_splats") == 1
    assert not any("torch" in name or "kernels" in name for name in RENDERERS.names())
    assert RENDERERS.build("gaussian_splats", {"backend": "torch", "near": 0.2}) == GaussianSplats("torch", near=0.2)
    for options in ({"near": 0.0}, {"near_fade": -1.0}, {"threads": -1}, {"backend": "cuda"}):
        with pytest.raises(UsageError):
            RENDERERS.build("gaussian_splats", options)


def test_a_foreign_geometry_an_unknown_buffer_and_a_bad_camera_are_refused():
    camera = forward_camera((4, 4), 10.0)
    scene = scene_of(synthetic_room(200))
    with pytest.raises(UsageError, match="does not draw str"):
        GaussianSplats().render(replace(scene, geometry="mesh"), camera, ALL)
    with pytest.raises(UsageError, match="has no buffer normals"):
        GaussianSplats().render(scene, camera, frozenset({"normals"}))
    with pytest.raises(ValueError, match="finite"):
        GaussianSplats().render(scene, replace(camera, w2c=camera.w2c * math.nan), ALL)
    skewed = camera.K.clone()
    skewed[:, 0, 1] = 0.1
    with pytest.raises(ValueError, match="skew"):
        GaussianSplats().render(scene, replace(camera, K=skewed), ALL)
