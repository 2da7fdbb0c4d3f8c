from __future__ import annotations

import dataclasses
import hashlib
import tracemalloc

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.errors import InputError, UsageError
from cltransfer.fit._views import Views, box_around, box_around_focus, psnr, views_of
from cltransfer.renderers.nerf_grid import NerfGridRenderer
from cltransfer.scenes.nerf_grid import NerfGrid
from cltransfer.scenes.posed import PosedImages
from cltransfer.scenes.posed.lens import Lens


def test_every_eighth_view_is_held_out_and_none_is_in_both(views):
    learn, held_out = views.split(8)
    assert (len(learn), len(held_out)) == (21, 4)
    assert torch.equal(held_out.image, views.image[::8])
    assert torch.equal(held_out.camera.w2c, views.camera.w2c[::8])
    both = torch.cat([learn.camera.center, held_out.camera.center])
    assert len(both.unique(dim=0)) == 25


def test_the_digest_follows_images_cameras_and_box(views):
    changed = views.image.clone()
    changed[0, 0, 0, 0] += 1
    assert views.digest == dataclasses.replace(views).digest
    assert views.digest != dataclasses.replace(views, image=changed).digest
    assert views.digest != dataclasses.replace(views, aabb=views.aabb * 2).digest


def test_the_digest_is_of_all_bytes_and_copies_one_image_at_most(views):
    backwards = dataclasses.replace(
        views, image=views.image.flip(1).permute(0, 2, 3, 1).contiguous().permute(0, 3, 1, 2)
    )
    for seen in (views, backwards):
        parts = (seen.camera.w2c, seen.camera.K, seen.image, seen.aabb)
        expected = hashlib.sha256(b"".join(part.contiguous().numpy().tobytes() for part in parts)).hexdigest()
        tracemalloc.start()
        got = seen.digest
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert got == expected
        assert peak < 2 * seen.image[0].numel()


def test_pixels_that_do_not_count_are_scored_nowhere(views):
    counted = torch.ones(25, 48, 48, dtype=torch.bool)
    counted[:, :, 30:] = False
    image = views.image.clone()
    image[:, :, :, 30:] = 255
    nothing = NerfGrid(torch.zeros(2, 2, 2), torch.zeros(2, 2, 2, 1, 3), torch.zeros(2, 2, 2), views.aabb)
    masked = dataclasses.replace(views, image=image, counted=counted)
    power = ((views.image[..., :30] / 255) ** 2).flatten(1).mean(1)
    assert psnr(nothing, masked, NerfGridRenderer()) == pytest.approx(float((-10 * power.log10()).mean()), abs=1e-4)
    learn, held_out = masked.split(8)
    assert (len(learn.counted), len(held_out.counted)) == (21, 4)
    assert masked.digest != dataclasses.replace(masked, counted=None).digest
    assert masked.digest != dataclasses.replace(masked, counted=~counted).digest
    with pytest.raises(ValueError, match=r"counted must be \(25, 48, 48\), got \(25, 48, 40\)"):
        dataclasses.replace(views, counted=counted[..., :40])


def test_images_must_be_as_large_as_their_cameras_say(views):
    with pytest.raises(ValueError, match=r"image must be \(25, 3, 48, 48\)"):
        Views(views.camera, views.image[:, :, :40], views.aabb)


def test_the_box_leaves_strays_out():
    random = torch.Generator().manual_seed(0)
    points = torch.rand(1000, 3, generator=random)
    points[0], points[1] = 500.0, -500.0
    low, high = box_around(points)
    assert ((low > -0.2) & (low < 0)).all()
    assert ((high > 1) & (high < 1.2)).all()


def test_without_points_the_box_is_about_what_the_cameras_look_at(views):
    expected = torch.tensor([[-3.0] * 3, [3.0] * 3], dtype=torch.float64)
    torch.testing.assert_close(box_around_focus(views.camera), expected, atol=1e-5, rtol=0)


def test_a_set_with_two_images_is_refused(views, tmp_path):
    lens = Lens((48, 48), (50.0, 50.0), (24.0, 24.0))
    posed = PosedImages(tmp_path, views.camera[range(2)], (lens, lens), ("a", "b"), (tmp_path / "a.png", None))
    with pytest.raises(InputError, match="images: expected at least 3, got 1"):
        views_of(posed, 100)


@pytest.mark.parametrize("points", [None, torch.full((9, 3), 0.3)])
@pytest.mark.parametrize("place", [0.0, 1e4])
def test_cameras_or_points_at_one_place_are_refused(views, tmp_path, monkeypatch, points, place):
    w2c = views.camera.w2c.clone()
    w2c[:, :3, 3] = -(w2c[:, :3, :3] @ torch.full((3,), place, dtype=w2c.dtype))
    lens, count = Lens((48, 48), (50.0, 50.0), (24.0, 24.0)), len(views)
    camera = dataclasses.replace(views.camera, w2c=w2c)
    names = tuple(map(str, range(count)))
    posed = PosedImages(tmp_path, camera, (lens,) * count, names, tuple(map(tmp_path.joinpath, names)), points)
    monkeypatch.setattr(PosedImages, "images", lambda *words: (camera, views.image))
    with pytest.raises(InputError, match="expected several places, all are at one"):
        views_of(posed, 48)


@pytest.mark.parametrize(("distance", "good"), [(1e3, True), (1e5, False)])
def test_cameras_from_where_float32_does_not_tell_the_points_are_refused(views, tmp_path, monkeypatch, distance, good):
    eye = torch.full((1, 3), distance / 3**0.5, dtype=torch.float64)
    w2c = views.camera.w2c.clone()
    w2c[4] = Camera.look_at(eye, 0 * eye, torch.tensor([0.0, 0, 1]), 0.8, (48, 48)).w2c[0]
    lens, count = Lens((48, 48), (50.0, 50.0), (24.0, 24.0)), len(views)
    camera, names = dataclasses.replace(views.camera, w2c=w2c), tuple(f"{i}.png" for i in range(count))
    points = torch.rand(500, 3, generator=torch.Generator().manual_seed(0)) - 0.5
    posed = PosedImages(tmp_path, camera, (lens,) * count, names, tuple(map(tmp_path.joinpath, names)), points)
    monkeypatch.setattr(PosedImages, "images", lambda *words: (camera, views.image))
    if good:
        assert len(views_of(posed, 48)) == count
        return
    with pytest.raises(InputError, match=r"cameras: expected within 2000 sides of the box .*, 4.png is 9.14e\+04 away"):
        views_of(posed, 48)


@pytest.mark.parametrize("shift", [0.0, 100.0])
@pytest.mark.parametrize("apart", [False, True], ids=["the same way", "apart"])
def test_cameras_that_look_at_no_common_place_need_points(views, tmp_path, monkeypatch, shift, apart):
    x = torch.linspace(-1, 1, 9, dtype=torch.float64)
    eyes = torch.stack([x, torch.full_like(x, shift), 0.1 * x**2], 1)
    ways = torch.stack([x if apart else 0 * x, torch.ones_like(x), 0 * x], 1)
    camera = Camera.look_at(eyes, eyes + ways, torch.tensor([0.0, 0, 1], dtype=torch.float64), 0.8, (16, 16))
    lens, names = Lens((16, 16), (20.0, 20.0), (8.0, 8.0)), tuple(map(str, range(9)))
    posed = PosedImages(tmp_path, camera, (lens,) * 9, names, tuple(map(tmp_path.joinpath, names)), None)
    monkeypatch.setattr(PosedImages, "images", lambda *words: (camera, torch.zeros(9, 3, 16, 16, dtype=torch.uint8)))
    with pytest.raises(InputError, match="cameras: look the same way or apart, and there are no points"):
        views_of(posed, 16)


def test_a_near_plane_is_held_against_what_lies_before_the_cameras(views):
    with pytest.raises(
        UsageError, match=r"near: hides what is nearer than 3\.2, the middle of the scene is 3 from the"
    ):
        views.check_near(3.2)
    views.check_near(2.5)
    behind = dataclasses.replace(views[[0]], aabb=views.aabb + 2 * views.camera.center[0])
    behind.check_near(3.2)  # where nothing lies it hides nothing


def test_psnr_of_black_is_that_of_the_images_power(views):
    nothing = NerfGrid(torch.zeros(2, 2, 2), torch.zeros(2, 2, 2, 1, 3), torch.zeros(2, 2, 2), views.aabb)
    power = ((views.image / 255) ** 2).flatten(1).mean(1)
    expected = float((-10 * power.log10()).mean())
    assert psnr(nothing, views, NerfGridRenderer()) == pytest.approx(expected, abs=1e-4)
