"""The camera path of a clip from its frames, against the path it was rendered along."""

from __future__ import annotations

import itertools
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from scipy.stats import spearmanr

from cltransfer import shots
from cltransfer.camera import Camera, intrinsics
from cltransfer.sfm import NoPathError, OutOfTimeError, mapping
from cltransfer.sfm.mapping import Placed
from cltransfer.sfm.path import _between, reconstruct_path


@pytest.fixture(scope="module")
def orbit(filmed):
    true, image, depth, subject = filmed("orbit", 12)
    return true, reconstruct_path(image, subject, true.times), depth


def test_every_frame_gets_a_camera_at_its_time(orbit):
    true, found, _ = orbit
    assert found.points.frames.unique().tolist() == list(range(12))
    assert torch.equal(found.trajectory.times, true.times)
    assert found.trajectory.camera.size == true.camera.size
    torch.testing.assert_close(found.trajectory.camera.w2c[0], torch.eye(4, dtype=torch.float64))


TIMES = torch.tensor([0.0, 0.1, 0.5, 0.6, 0.9, 1.0], dtype=torch.float64)


def steady():
    """Six frames that are shown unevenly, of a camera that moves, turns and zooms evenly in time."""
    c2w = torch.eye(4, dtype=torch.float64).repeat(6, 1, 1)
    c2w[:, :3, :3] = torch.from_numpy(Rotation.from_rotvec(np.outer(TIMES, [0.2, 0.9, 0.1])).as_matrix())
    c2w[:, :3, 3] = TIMES[:, None] * torch.tensor([3.0, -1.0, 2.0], dtype=torch.float64)
    return Camera(c2w.inverse(), intrinsics(300 * 1.5**TIMES, (480, 270)), (480, 270))


@pytest.mark.parametrize(("placed", "stand"), [([0, 2, 3, 5], range(6)), ([2, 3], [2, 2, 2, 3, 3, 3])])
def test_a_frame_that_was_not_placed_stands_where_a_steady_camera_was_when_it_was_shown(placed, stand):
    """Before the first that was placed and behind the last it stands where these do."""
    true = steady()
    found = _between(Placed(np.array(placed), true[placed]), TIMES)
    torch.testing.assert_close(found.w2c, true[list(stand)].w2c, atol=1e-12, rtol=0)
    torch.testing.assert_close(found.focal, true[list(stand)].focal)


def test_the_path_is_right_up_to_scale(orbit):
    true, found, _ = orbit
    relative = true.camera.w2c @ true.camera.c2w[:1]  # in the axes of the first camera
    turned = Rotation.from_matrix((found.trajectory.camera.w2c @ relative.inverse())[:, :3, :3]).magnitude()
    assert np.degrees(turned).max() < 1.5  # of 60 degrees
    got, wanted = found.trajectory.camera.center, -(relative[:, :3, :3].mT @ relative[:, :3, 3:])[..., 0]
    scale = float((got * wanted).sum() / got.square().sum())
    assert float((scale * got - wanted).norm(dim=1).max() / wanted.norm(dim=1).max()) < 0.04


def test_the_lens_is_found_where_the_camera_turns(orbit):
    true, found, _ = orbit
    assert float(found.trajectory.camera.focal[0]) == pytest.approx(float(true.camera.focal[0]), rel=0.05)


def test_depth_of_points_is_right_up_to_scale_on_the_subject_too(orbit):
    true, found, depth = orbit
    points = found.points
    column, row = points.pixels.floor().long().T
    off = (points.depth / depth[points.frames, row, column]).log()
    far, wide = (each.camera.center.diff(dim=0).norm(dim=1).sum() for each in (found.trajectory, true))
    assert float(off.nanmedian().exp()) == pytest.approx(float(far / wide), rel=0.05)  # the path is of the same scale
    off -= off.nanmedian()
    sure = points.confidence > 0.5
    for side in (points.hidden, ~points.hidden):
        assert int((sure & side).sum()) > 50
        assert float(off[sure & side].abs().nanmedian()) < 0.05
    assert float(points.depth.median()) == pytest.approx(1.0)


@pytest.mark.parametrize(("frames", "seed"), [(8, 0), pytest.param(12, 0, marks=pytest.mark.slow), (8, 3)])
def test_space_is_not_turned_inside_out(filmed, frames, seed):
    """Of seed 0 the mapper has a right model too, that explains fewer corners; of seed 3 it has none.

    By ranks: what is far is far, wherever one point of thousands is found at the camera.
    """
    true, image, depth, subject = filmed("handheld", frames, seed)
    points = reconstruct_path(image, subject, true.times).points
    column, row = points.pixels.floor().long().T
    both = torch.stack([points.depth, depth[points.frames, row, column].double()]).log()[:, points.confidence > 0.5]
    assert spearmanr(*both[:, both.isfinite().all(0)].numpy())[0] > 0.7


@pytest.mark.parametrize(("name", "reason"), [("pan", "no parallax"), ("zoom", "no parallax")])
def test_a_camera_that_only_turns_or_zooms_is_told_before_anything_is_mapped(filmed, monkeypatch, name, reason):
    import pycolmap

    def refuse(*args, **options):
        raise AssertionError("mapping was started")

    monkeypatch.setattr(pycolmap, "incremental_mapping", refuse)
    true, image, _, subject = filmed(name)
    with pytest.raises(
        NoPathError, match=f"clip: camera path: {reason}: a homography of each pair of frames explains 9. %"
    ):
        reconstruct_path(image, subject, true.times)


def test_a_still_camera_is_told(filmed):
    true, image, _, subject = filmed("pan")
    with pytest.raises(NoPathError, match=r"the camera stands still: points move by at most 0\.00 %"):
        reconstruct_path(image[[0] * 5], subject[[0] * 5], true.times[:5])


def test_a_zoom_on_the_move_is_told(filmed):
    true, image, _, subject = filmed("dolly_zoom", 12)
    with pytest.raises(NoPathError, match=r"only \d+ of 12 frames could be placed with one lens"):
        reconstruct_path(image, subject, true.times)


@pytest.mark.parametrize("zoom", [pytest.param(1.1, marks=pytest.mark.slow), 1.5])
def test_a_zoom_while_orbiting_is_found(filmed, monkeypatch, zoom):
    orbit = shots._moving(azimuth=(0.0, math.radians(30 if zoom < 1.2 else 60)), zoom=(1.0, zoom))
    monkeypatch.setitem(shots._SHOTS, f"orbit_zoom_{zoom}", (2.8, 0.5, orbit))
    true, image, depth, subject = filmed(f"orbit_zoom_{zoom}", 12)
    found = reconstruct_path(image, subject, true.times)
    np.testing.assert_allclose(found.trajectory.camera.focal, true.camera.focal, rtol=0.05)
    points = found.points
    column, row = points.pixels.floor().long().T
    off = (points.depth / depth[points.frames, row, column]).log()[points.confidence > 0.5]
    assert float((off - off.nanmedian()).abs().nanmedian()) < 0.05  # with one lens it is 0.19 and more


def test_frames_without_texture_are_told():
    flat = np.full((4, 90, 160, 3), 128, np.uint8)
    with pytest.raises(NoPathError, match="no two frames share 50 points off the subject, at best 0"):
        reconstruct_path(flat, None, torch.arange(4.0))


@pytest.mark.parametrize("count", [2, 121])
def test_too_few_and_too_many_frames_are_told(count):
    with pytest.raises(NoPathError, match=f"expected 3 to 120 frames, got {count}"):
        reconstruct_path(np.zeros((count, 9, 16, 3), np.uint8), None, torch.arange(float(count)))


def test_the_same_clip_gives_the_same_bits_leaves_no_file_and_says_nothing(filmed, orbit, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    true, image, _, subject = filmed("orbit", 12)
    first, second = orbit[1], reconstruct_path(image, subject, true.times)
    assert torch.equal(first.trajectory.camera.w2c, second.trajectory.camera.w2c)
    assert torch.equal(first.points.depth, second.points.depth)
    assert list(Path(tmp_path).iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_a_model_that_time_cut_off_is_not_used(filmed, monkeypatch):
    """The mapper is real and places all frames, the clock says that it was late."""
    true, image, _, subject = filmed("orbit", 12)
    clock = iter(range(0, 10**6, 500))
    monkeypatch.setattr(mapping.time, "monotonic", lambda: float(next(clock)))
    with pytest.raises(OutOfTimeError, match="time ran out after 60 s with 12 of 12 frames placed"):
        reconstruct_path(image, subject, true.times, lens=1.1, seconds=60)


def test_time_that_ran_out_for_one_guess_of_the_lens_is_told(filmed, monkeypatch):
    import pycolmap

    clock = itertools.chain([0.0, 1e3], itertools.repeat(1e3))
    monkeypatch.setattr(mapping.time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(pycolmap, "incremental_mapping", lambda *args: {})
    true, image, _, subject = filmed("orbit", 12)
    with pytest.raises(OutOfTimeError, match="time ran out after 60 s with 0 of 4 frames placed"):
        reconstruct_path(image[::3], subject[::3], true.times[::3])


@pytest.mark.parametrize(("lens", "seconds", "each"), [(None, 9, [3, 3, 3]), (None, 1, [1, 1, 1]), (1.1, 9, [9])])
def test_seconds_are_shared_by_the_guesses_of_the_lens_each_at_least_one(filmed, monkeypatch, lens, seconds, each):
    import pycolmap

    given = []
    monkeypatch.setattr(pycolmap, "incremental_mapping", lambda *args: given.append(args[-1].max_runtime_seconds) or {})
    true, image, _, subject = filmed("orbit", 12)
    with pytest.raises(NoPathError, match="only 0 of 4 frames"):
        reconstruct_path(image[::3], subject[::3], true.times[::3], lens=lens, seconds=seconds)
    assert given == each


def test_a_lens_that_nobody_has_is_not_used(filmed, monkeypatch):
    true, image, _, subject = filmed("orbit", 12)
    options = mapping._options

    def unbound(*args):
        made = options(*args)
        made.min_focal_length_ratio, made.max_focal_length_ratio = 0.01, 100  # as where refining goes beyond its range
        return made

    monkeypatch.setattr(mapping, "_options", unbound)
    monkeypatch.setattr(mapping, "FOCAL_RANGE", (2.0, 3.0))
    with pytest.raises(NoPathError, match="no lens of 2 to 3 longer sides explains the frames"):
        reconstruct_path(image, subject, true.times, lens=1.1)


def test_a_known_lens_is_kept(filmed):
    true, image, _, subject = filmed("orbit", 12)
    found = reconstruct_path(image, subject, true.times, lens=1.1)
    assert float(found.trajectory.camera.focal[0]) == pytest.approx(1.1 * 480)
