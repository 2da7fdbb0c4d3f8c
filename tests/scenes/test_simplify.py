from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.camera import Camera
from cltransfer.computer import memory
from cltransfer.errors import ResourceError, UsageError
from cltransfer.renderers._splats_torch import render_one
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.renderers.kernels.splats import make_view
from cltransfer.scenes import Scene
from cltransfer.scenes.simplify import (
    PARTS,
    STACKED,
    face_area,
    importance,
    merged,
    pixel_width,
    stacked,
    subset,
    working_set,
)
from cltransfer.scenes.splats import Splats

SETTINGS = GaussianSplats().settings
UP = torch.tensor([0.0, 0, 1], dtype=torch.float64)


def splats(means: list[list[float]], label: list[float] | None = None, scale: float = 0.01) -> Splats:
    """Round grey Gaussians of opacity 0.5."""
    n = len(means)
    return Splats(
        torch.tensor(means),
        torch.full((n, 3), scale),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
        torch.full((n,), 0.5),
        torch.zeros(n, 1, 3),
        torch.tensor(label or [0.0] * n),
    )


def camera(distance: float = 10.0) -> Camera:
    """On -x, looking along +x, with a focal length of 100 px: a pixel is 0.1 wide at distance 10."""
    eye = torch.tensor([[-distance, 0.0, 0.0]])
    return Camera.look_at(eye, torch.zeros(1, 3), UP, 2 * math.atan(0.5), (160, 100))


def test_a_pixel_widens_with_distance_and_the_nearest_camera_counts() -> None:
    points = torch.tensor([[0.0, 0, 0], [10, 0, 0]])
    torch.testing.assert_close(pixel_width(points, camera()), torch.tensor([0.1, 0.2], dtype=torch.float64))
    both = Camera(torch.cat([camera().w2c, camera(5).w2c]), torch.cat([camera().K, camera(5).K]), (160, 100))
    torch.testing.assert_close(pixel_width(points, both), torch.tensor([0.05, 0.15], dtype=torch.float64))


@pytest.mark.parametrize(("fx", "fy"), [(200.0, 100.0), (100.0, 200.0)])
def test_of_a_pixel_that_is_not_square_the_shorter_side_counts(fx: float, fy: float) -> None:
    K = camera().K.clone()
    K[:, 0, 0], K[:, 1, 1] = fx, fy
    oblong = replace(camera(), K=K)
    torch.testing.assert_close(pixel_width(torch.zeros(1, 3), oblong), torch.tensor([0.05], dtype=torch.float64))
    pair = splats([[0.1, 0.02, 0.01], [0.1, 0.1, 0.01]])  # in one voxel of 0.125, in two of 0.0625
    assert [len(merged(pair, one, 2)) for one in (camera(), oblong)] == [1, 2]


def test_two_in_a_voxel_become_one_with_their_mean_and_covariance() -> None:
    pair = splats([[0.01, 0.02, 0.01], [0.03, 0.02, 0.01]])
    one = merged(pair, camera(), 2)
    assert len(one) == 1
    torch.testing.assert_close(one.means[0], torch.tensor([0.02, 0.02, 0.01]))
    ratio = one.covariances()[0] / one.covariances()[0, 1, 1]
    expected = torch.diag(torch.tensor([(0.01**2 + 0.01**2) / 0.01**2, 1.0, 1.0]))
    torch.testing.assert_close(ratio, expected, rtol=1e-4, atol=1e-4)
    depth = -torch.log1p(-one.opacity[0]) * 0.01 * math.hypot(0.01, 0.01)  # area before it grows to cover
    assert float(depth) == pytest.approx(2 * math.log(2) * 0.01**2, rel=1e-4)


def test_what_nobody_sees_is_left_out_and_what_is_hardly_there_stays_a_number() -> None:
    pair = [[0.01, 0.02, 0.01], [0.03, 0.02, 0.01]]
    far = [[x + 9, y, z] for x, y, z in pair]
    for faint, count in ((0.0, 1), (1e-20, 2)):
        opacity = torch.tensor([0.5, 0.5, faint, faint])
        found = merged(replace(splats(pair + far), opacity=opacity), camera(), 2)
        assert len(found) == count
        assert all(bool(getattr(found, name).isfinite().all()) for name in PARTS)
        torch.testing.assert_close(found.means[0], merged(splats(pair), camera(), 2).means[0])
    half = replace(splats(pair), opacity=torch.tensor([0.5, 0.0]))
    torch.testing.assert_close(merged(half, camera(), 2).means, half.means[:1])
    assert len(merged(replace(half, opacity=torch.zeros(2)), camera(), 2)) == 0


def test_a_merge_that_does_not_fit_in_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pile = splats([[0.01, 0.02, 0.01], [0.03, 0.02, 0.01]] * 1000)
    apart = splats([[0.1, 0.1, 0.1], [0.1, 0.6, 0.1]])
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**19)
    with pytest.raises(ResourceError, match="memory: 2000 Gaussians that are to be merged need 1 MB, 0 MB are free"):
        merged(pile, camera(), 2)
    assert merged(apart, camera(), 2) is apart


def test_what_is_farther_apart_than_a_voxel_is_left_alone() -> None:
    apart = splats([[0.1, 0.1, 0.1], [0.1, 0.6, 0.1]])
    assert merged(apart, camera(), 2) is apart
    assert len(merged(apart, camera(100), 2)) == 1  # from far away they are one


def test_a_gaussian_larger_than_its_voxel_is_left_alone() -> None:
    large = splats([[0.01, 0.02, 0.01], [0.03, 0.02, 0.01]], scale=0.5)
    assert merged(large, camera(), 2) is large


def test_subject_and_surroundings_are_never_merged() -> None:
    three = splats([[0.01, 0.02, 0.01], [0.02, 0.02, 0.01], [0.03, 0.02, 0.01]], label=[1, 0, 1])
    two = merged(three, camera(), 2)
    assert sorted(two.label.tolist()) == [0, 1]
    torch.testing.assert_close(two.means[two.label == 1][0], torch.tensor([0.02, 0.02, 0.01]))


def test_a_pile_covers_what_its_layers_cover() -> None:
    opacity = torch.tensor([0.3, 0.6, 0.9], dtype=torch.float64)
    peak, growth = stacked(opacity, -torch.log1p(-opacity))
    torch.testing.assert_close(peak, opacity)  # one layer is itself
    torch.testing.assert_close(growth, torch.ones(3, dtype=torch.float64))
    peak, growth = stacked(opacity, -3 * torch.log1p(-opacity))
    torch.testing.assert_close(peak, (1 - (1 - opacity) ** 3).clamp(max=0.99))
    radius = torch.linspace(0, 6, 4001, dtype=torch.float64)
    profile = torch.exp(-(radius**2) / 2)
    for k in range(3):  # the integral over a disc, by summing rings
        pile = torch.trapezoid((1 - (1 - opacity[k] * profile) ** 3) * radius, radius)
        assert float(growth[k] ** (2 / STACKED)) == pytest.approx(float(pile / (1 - (1 - opacity[k]) ** 3)), rel=5e-3)


def test_the_same_scene_gives_the_same_bits_and_larger_k_fewer_gaussians() -> None:
    room, view = synthetic_room(20_000), room_cameras(1, (160, 90))
    first, second = merged(room, view, 4), merged(room, view, 4)
    assert all(
        torch.equal(getattr(first, n), getattr(second, n)) for n in ("means", "scales", "quats", "opacity", "sh")
    )
    counts = [len(merged(room, view, k)) for k in (1, 2, 4, 8)]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] < 0.6 * len(room)


def test_every_merged_gaussian_can_be_drawn() -> None:
    few = merged(synthetic_room(20_000), room_cameras(1, (160, 90)), 8)
    assert bool(((few.opacity > 0) & (few.opacity <= 0.995)).all())
    assert bool((few.scales > 0).all())
    torch.testing.assert_close(few.quats.norm(dim=1), torch.ones(len(few)))
    assert bool((face_area(few.scales) > 0).all())


def test_a_working_set_looks_like_its_scene_and_keeps_its_person() -> None:
    scene = Scene(synthetic_room(100_000), None, UP, "room", "0" * 64)
    cameras, renderer = room_cameras(4, (160, 90)), GaussianSplats(threads=1)
    small = working_set(scene, cameras, 2)
    assert len(small.geometry) < 0.9 * len(scene.geometry)
    full, few = (renderer.render(s, cameras, renderer.provides) for s in (scene, small))
    psnr = -10 * (full.require("image") - few.require("image")).square().mean((1, 2, 3)).log10()
    assert float(psnr.min()) > 36
    area = few.require("label").sum((1, 2)) / full.require("label").sum((1, 2))
    torch.testing.assert_close(area, torch.ones(4), rtol=0, atol=0.02)


def test_only_splats_can_be_merged() -> None:
    with pytest.raises(UsageError, match=r"lod: expected Gaussian splats, got dict \(set lod=0\)"):
        working_set(Scene({}, None, UP, "room", "0" * 64), camera(), 2)
    with pytest.raises(ValueError, match="k must be positive"):
        merged(splats([[0.0, 0, 0]]), camera(), 0)


def test_importance_is_the_slope_of_the_oracle_where_one_pixel_is_looked_at() -> None:
    """The label buffer is sum(weight label): its slope by a label is the weight."""
    room, cameras = synthetic_room(2_000), room_cameras(1, (8, 6))
    found = importance(room, [make_view(cameras.w2c[0].numpy(), cameras.K[0].numpy(), (8, 6), SETTINGS)])
    label = room.label.clone().requires_grad_()
    drawn = render_one(room.with_label(label), cameras, SETTINGS)["label"]
    slopes = [torch.autograd.grad(pixel, label, retain_graph=True)[0] for pixel in drawn.flatten()]
    torch.testing.assert_close(found, torch.stack(slopes).amax(0), rtol=1e-3, atol=2e-4)
    assert float(found.max()) > 0.2


def test_what_contributes_nothing_can_go_unseen() -> None:
    room, cameras = synthetic_room(20_000), room_cameras(2, (96, 54))
    views = [make_view(w2c, K, cameras.size, SETTINGS) for w2c, K in zip(cameras.w2c.numpy(), cameras.K.numpy())]
    kept = subset(room, importance(room, views) > 0.005)
    assert len(kept) < 0.7 * len(room)
    renderer = GaussianSplats(threads=1)
    images = [
        renderer.render(Scene(s, None, UP, "room", "0" * 64), cameras, frozenset({"image"})).image for s in (room, kept)
    ]
    assert float(-10 * (images[0] - images[1]).square().mean().log10()) > 45
