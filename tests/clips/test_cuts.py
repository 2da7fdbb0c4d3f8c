"""Bars beside a picture say nothing about cuts; test_open_clip.py has what else looks like one."""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path

import av
import numpy as np
import pytest

from cltransfer.clips.cuts import find_shots
from cltransfer.clips.pairs import open_pairs
from cltransfer.clips.part import find_part
from cltransfer.clips.source import ClipSource
from cltransfer.errors import InputError

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "video"


def small_of(path: Path) -> np.ndarray:
    """Small pictures of all frames of a clip."""
    return find_part(path, (0.0, math.inf), None).small()


def cuts_of(small: np.ndarray) -> list[int]:
    """Frames that begin another shot."""
    return [begin for begin, _ in find_shots(small)[1:]]


def drawn(seed: int, count: int) -> np.ndarray:
    """Small pictures of a still camera before something of its own, with a little noise."""
    random = np.random.default_rng(seed)
    base = np.kron(random.integers(10, 250, (6, 8, 3)), np.ones((3, 4, 1)))
    return np.stack([np.clip(base + random.normal(0, 2, base.shape), 0, 255) for _ in range(count)]).astype(np.uint8)


@pytest.mark.parametrize("bars", [(0, 0), (2, 0), (3, 0), (0, 6), (0, 11), (6, 0)])
@pytest.mark.parametrize("seeds", [(0, 1), (2, 3), (4, 5)])
def test_bars_do_not_hide_a_cut(bars: tuple[int, int], seeds: tuple[int, int]) -> None:
    clip = np.concatenate([drawn(seed, 10) for seed in seeds])
    rows, columns = bars
    clip[:, :rows] = clip[:, 18 - rows :] = 0
    clip[:, :, :columns] = clip[:, :, 32 - columns :] = 0
    assert cuts_of(clip) == [10]


@pytest.mark.parametrize("between", [0, 1, 2])
@pytest.mark.parametrize("seeds", [(0, 1), (2, 3), (4, 5)])
def test_frames_that_mix_both_shots_do_not_hide_a_cut(between: int, seeds: tuple[int, int]) -> None:
    """A frame that is made between two others, for another rate, is one of each cut."""
    before, after = (drawn(seed, 10) for seed in seeds)
    shares = np.linspace(0, 1, between + 2)[1:-1, None, None, None]
    mixed = ((1 - shares) * before[-1] + shares * after[0]).round().astype(np.uint8)
    assert cuts_of(np.concatenate([before, mixed, after])) == [10 + between]


@pytest.mark.parametrize("between", [1, 2])
def test_frames_that_mix_real_clips_do_not_hide_a_cut(between: int) -> None:
    if not DATA.is_dir():
        pytest.skip("needs the clips of shared/data")
    before, after = (small_of(DATA / f"{name}.mp4")[:24] for name in ("sav_05_juggle", "lp_s32"))
    shares = np.linspace(0, 1, between + 2)[1:-1, None, None, None]
    mixed = ((1 - shares) * before[-1] + shares * after[0]).round().astype(np.uint8)
    assert cuts_of(np.concatenate([before, mixed, after])) == [24 + between]


def test_a_long_clip_takes_little_more_than_its_small_pictures() -> None:
    clip = np.concatenate([drawn(seed, 600) for seed in range(5)])
    tracemalloc.start()
    cuts = cuts_of(clip)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert cuts == [600, 1200, 1800, 2400]  # of blocks that end elsewhere
    assert most < 3 * clip.nbytes  # of all at once it is 20


@pytest.mark.parametrize(
    "pair", [("sav_05_juggle", "lp_s32"), ("lp_s32", "lp_s20"), ("sav_04_coffee", "sav_05_juggle")]
)
def test_bars_do_not_hide_a_cut_between_real_clips(pair: tuple[str, str]) -> None:
    if not DATA.is_dir():
        pytest.skip("needs the clips of shared/data")
    plain = [small_of(DATA / f"{name}.mp4")[:12] for name in pair]
    assert cuts_of(np.concatenate(plain)) == [12]
    barred = np.concatenate(plain)
    barred[:, :3] = barred[:, 15:] = 0
    assert cuts_of(barred) == [12]


def test_a_small_light_in_the_dark_is_no_picture_between_bars() -> None:
    clip = np.random.default_rng(0).integers(0, 6, (20, 18, 32, 3)).astype(np.uint8)
    clip[:, 8:11, 14:18] = 200  # moves by a cell half-way
    clip[10:] = np.roll(clip[10:], 3, axis=2)
    assert cuts_of(clip) == []


def test_a_screen_in_the_dark_that_shows_something_else_is_no_cut() -> None:
    random = np.random.default_rng(0)
    clip = random.integers(0, 6, (20, 18, 32, 3)).astype(np.uint8)
    for half in (clip[:10], clip[10:]):
        half[:, 7:11, 12:19] = random.integers(40, 255, (4, 7, 3))
    assert cuts_of(clip) == []


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_cut_between_stills_that_are_held_for_long_stands_out(seed: int) -> None:
    """Of a slide show: what is held for longer than frames are repeated is a still camera, by which change is rare."""
    random = np.random.default_rng(seed)
    shots = [np.kron(random.integers(low, low + 160, (6, 8, 3)), np.ones((3, 4, 1))) for low in (10, 80)]
    stills = [np.clip(shot + random.normal(0, 38, shot.shape), 0, 255) for shot in shots for _ in range(5)]
    assert cuts_of(np.repeat(np.stack(stills), 8, axis=0).astype(np.uint8)) == [40]


@pytest.mark.parametrize("bars", [0, 16])
@pytest.mark.parametrize(("asked", "keeps"), [("", False), ("#letterbox=keep", True)])
def test_a_scored_reference_is_advised_as_it_was_asked_for(tmp_path: Path, bars: int, asked: str, keeps: bool) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    random = np.random.default_rng(0)
    shots = [np.kron(random.integers(0, 255, (8, 8, 3)), np.ones((16, 16, 1))).astype(np.uint8) for _ in range(2)]
    with av.open(str(folder / "cut.mp4"), "w") as file:
        stream = file.add_stream("libx264", rate=10)
        stream.width = stream.height = 128
        stream.pix_fmt = "yuv420p"
        for picture in [shots[0]] * 8 + [shots[1]] * 8:
            picture[:bars] = picture[128 - bars :] = 0
            file.mux(stream.encode(av.VideoFrame.from_ndarray(picture)))
        file.mux(stream.encode())
    clip = folder / "cut.mp4"
    with pytest.raises(InputError, match="a cut at") as told:
        open_pairs(ClipSource.parse(f"{clip}{asked}"), ClipSource.parse(str(clip)), None)
    assert ("letterbox=keep" in str(told.value)) == keeps


def test_a_camera_so_fast_that_no_frame_shows_what_another_does_is_no_cut() -> None:
    fast = [drawn(seed, 1) for seed in range(1, 11)]
    assert cuts_of(np.concatenate(fast)) == []
    assert cuts_of(np.concatenate([drawn(0, 40), *fast, drawn(11, 40)])) == []  # however long it stood before


@pytest.mark.parametrize("first", [4, 10])
def test_shots_of_two_frames_hide_no_cut_beside_them(first: int) -> None:
    shots = [drawn(0, first), *(drawn(seed, 2) for seed in (1, 2, 3)), drawn(4, 10)]
    assert cuts_of(np.concatenate(shots)) == [first, first + 2, first + 4, first + 6]


def test_a_picture_of_one_colour_shows_nothing_and_one_that_a_single_colour_draws_is_shown() -> None:
    random = np.random.default_rng(0)
    red = (np.array([200, 30, 30]) + random.integers(0, 2, (3, 18, 32, 3))).astype(np.uint8)
    assert find_shots(np.concatenate([drawn(0, 6), red, drawn(1, 6)])) == [(0, 5), (9, 14)]
    blue = np.full((4, 18, 32, 3), 128, np.uint8)
    blue[..., 2] += random.integers(0, 13, (18, 32)).astype(np.uint8)
    assert find_shots(blue) == [(0, 3)]
