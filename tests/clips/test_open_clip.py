"""Cleaning a clip: which part, one shot, no bars; times by pts."""

import math
import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.clips import part as parts
from cltransfer.clips.clip import read_clip, write_video
from cltransfer.clips.cuts import find_shots
from cltransfer.clips.decoding import decode
from cltransfer.clips.frame import Frame
from cltransfer.clips.letterbox import find_letterbox
from cltransfer.clips.open_clip import ASSUMED, open_clip
from cltransfer.clips.pairs import open_pairs
from cltransfer.clips.part import find_part
from cltransfer.clips.persons import Spot
from cltransfer.clips.source import ClipSource
from cltransfer.errors import InputError, UsageError

VIDEOS = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "video"
SIZE = (64, 36)


def scenery(seed: int, count: int = 10, drift: int = 1, size: tuple[int, int] = SIZE) -> Tensor:
    """Frames of a camera that pans over a blotchy wall of its own colours."""
    random = torch.Generator().manual_seed(seed)
    coarse = torch.rand(1, 3, 6, 24, generator=random) ** torch.tensor([1.0, 1 + seed % 4, 0.5])[:, None, None]
    wall = torch.nn.functional.interpolate(coarse, (size[1], 4 * size[0]), mode="bilinear")[0]
    frames = [wall[:, :, i * drift : i * drift + size[0]] for i in range(count)]
    return (torch.stack(frames) * 255).round().to(torch.uint8)


def small_of(path: Path) -> np.ndarray:
    """Small pictures of all frames of a clip."""
    return find_part(path, (0.0, math.inf), None).small()


def cuts_of(small: np.ndarray) -> list[int]:
    """Frames that begin another shot."""
    return [begin for begin, _ in find_shots(small)[1:]]


def small(image: Tensor) -> np.ndarray:
    return torch.nn.functional.interpolate(image.float(), (18, 32), mode="area").byte().permute(0, 2, 3, 1).numpy()


def saved(path: Path, image: Tensor, times: Tensor | None = None) -> ClipSource:
    write_video(path, image, torch.arange(len(image)).double() / 10 if times is None else times, lossless=True)
    return ClipSource(path)


def images(folder: Path, image: Tensor) -> Path:
    folder.mkdir()
    for i, rgb in enumerate(image):
        assert cv2.imwrite(str(folder / f"{i}.png"), rgb.permute(1, 2, 0).numpy()[..., ::-1])
    return folder


def test_a_cut_is_refused_with_its_frame_and_both_shots(tmp_path: Path) -> None:
    where = saved(tmp_path / "a.mkv", torch.cat([scenery(0), scenery(1)]))
    with pytest.raises(InputError, match=r"frame 10: a cut at 1\.000 s") as caught:
        open_clip(where, 4)
    assert f"take one: '{where.path}#t=0.000,0.900' or '{where.path}#t=1.000,1.900'; no cut?" in str(caught.value)
    for part in ((0.0, 0.9), (1.0, 1.9)):
        clip, _ = open_clip(replace(where, span=part))
        assert (len(clip), clip.start) == (10, part[0])
    assert len(open_clip(replace(where, cuts="keep"))[0]) == 20


def test_the_shots_of_a_folder_are_named_by_its_rate(tmp_path: Path) -> None:
    folder = images(tmp_path / "a", torch.cat([scenery(0), scenery(1)]))
    with pytest.raises(InputError) as caught:
        open_clip(ClipSource.parse(f"{folder}#fps=10"))
    assert f"'{folder}#t=0.000,0.900&fps=10' or '{folder}#t=1.000,1.900&fps=10'" in str(caught.value)
    clip, _ = open_clip(ClipSource.parse(f"{folder}#t=1.000,1.900&fps=10"))
    assert torch.equal(clip.image, scenery(1))
    torch.testing.assert_close(clip.times, torch.arange(10).double() / 10)


def test_a_shot_is_named_with_all_that_was_asked_of_the_clip(tmp_path: Path) -> None:
    where = saved(tmp_path / "a.mkv", torch.cat([scenery(0), scenery(1)]))
    with pytest.raises(InputError) as caught:
        open_clip(ClipSource.parse(f"{where.path}#person=1&letterbox=keep"))
    first, second = (f"{where.path}#t={part}&person=1&letterbox=keep" for part in ("0.000,0.900", "1.000,1.900"))
    assert f"take one: '{first}' or '{second}';" in str(caught.value)
    assert len(open_clip(ClipSource.parse(second))[0]) == 10


def test_a_place_is_named_in_the_shot_that_shows_it(tmp_path: Path) -> None:
    where = saved(tmp_path / "a.mkv", torch.cat([scenery(0), scenery(1)]))
    with pytest.raises(InputError) as caught:
        open_clip(ClipSource.parse(f"{where.path}#t=0.5&person=0.4,0.6,1"))
    assert f"'{where.path}#t=0.500,0.900' or '{where.path}#t=1.000,1.900&person=0.4,0.6,0.5';" in str(caught.value)


def test_the_check_for_cuts_sees_every_frame_that_is_read(tmp_path: Path) -> None:
    times = torch.arange(20).double() / 24
    where = saved(tmp_path / "a.mkv", torch.cat([scenery(0), scenery(1)]), times)
    assert len(open_clip(replace(where, span=(0.0, 0.375)))[0]) == 10
    with pytest.raises(InputError, match=r"frame 10: a cut at 0\.417 s"):
        open_clip(replace(where, span=(0.0, 0.4166)))  # 10/24 but for rounding: the next shot's first frame is read


def test_a_shot_of_which_frames_are_missing_is_one_and_is_told(tmp_path: Path) -> None:
    kept = torch.cat([torch.arange(10), torch.arange(30, 40)])
    where = saved(tmp_path / "a.mkv", scenery(0, 40, 2)[kept], kept.double() / 10)
    clip, told = open_clip(where)
    assert len(clip) == 20
    assert told == (
        "2.1 s without a frame before 3.000 s, and something else is seen then: taken for one shot "
        "(if it is two, take one, #t=START,END)",
    )
    assert open_pairs(where, where, None)[1] == told
    assert open_clip(replace(where, span=(0.0, 0.9)))[1] == open_clip(replace(where, cuts="keep"))[1] == ()
    cut = saved(
        tmp_path / "b.mkv",
        torch.cat([scenery(0, 40, 2)[kept], scenery(1)]),
        torch.arange(30) / 10 + 2.0 * (torch.arange(30) > 9),
    )
    with pytest.raises(InputError, match=r"frame 20: a cut at 4\.000 s; a reference") as caught:
        open_clip(cut)
    assert f"'{cut.path}#t=0.000,3.900' or '{cut.path}#t=4.000,4.900'" in str(caught.value)


def test_of_many_gaps_in_a_shot_the_first_is_told_and_how_many_more_there_are(tmp_path: Path) -> None:
    times = torch.cat([torch.arange(10) + begin for begin in (0, 20, 40)]).double() / 10
    told = open_clip(saved(tmp_path / "a.mkv", torch.cat([scenery(s) for s in range(3)]), times))[1]
    assert [note.partition(",")[0] for note in told] == ["1.1 s without a frame before 2.000 s (and 1 more such)"]


def test_shots_of_one_frame_are_not_offered(tmp_path: Path) -> None:
    where = saved(tmp_path / "a.mkv", torch.cat([scenery(0, 1), scenery(1, 1)]))
    with pytest.raises(InputError, match=r"\(no cut\? #cuts=keep\)"):
        open_clip(where)


@pytest.mark.parametrize("drift", [0, 1, 8, 15])
def test_a_camera_however_fast_is_no_cut(drift: int) -> None:
    assert cuts_of(small(scenery(2, 12, drift))) == []


def repeated(frames: Tensor, times: tuple[int, ...]) -> np.ndarray:
    """Small pictures (F, h, w, 3) of frames that are shown so often, in turn."""
    return small(frames[[i for i in range(len(frames)) for _ in range(times[i % len(times)])]])


@pytest.mark.parametrize("times", [(1,), (2,), (2, 3), (3,), (4,)])
@pytest.mark.parametrize("seed", range(4))
def test_a_fast_camera_whose_frames_are_shown_repeatedly_is_no_cut(times: tuple[int, ...], seed: int) -> None:
    wall = scenery(seed, 10, 12)
    still = torch.cat([wall[:1].expand(12, -1, -1, -1), wall, wall[-1:].expand(12, -1, -1, -1)])
    assert cuts_of(repeated(still, times)) == []
    one, other = scenery(seed, 8), scenery(seed + 1, 8)
    assert cuts_of(repeated(torch.cat([one, other]), times)) == [sum(times[i % len(times)] for i in range(8))]


def test_a_flash_is_no_cut() -> None:
    frames = scenery(3, 12)
    frames[6] = 255
    assert cuts_of(small(frames)) == []


@pytest.mark.parametrize("times", [(1,), (2,), (2, 3), (3,)])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_a_flash_that_shows_something_is_no_cut(seed: int, count: int, times: tuple[int, ...]) -> None:
    frames = scenery(seed, 12)
    frames[6 : 6 + count] = scenery(seed + 1, 12)[6 : 6 + count]
    assert cuts_of(repeated(frames, times)) == []


@pytest.mark.parametrize("times", [(1,), (2, 3)])
@pytest.mark.parametrize("steps", [2, 3, 4])
@pytest.mark.parametrize("seed", range(4))
def test_a_short_whip_pan_between_still_pictures_is_no_cut(seed: int, steps: int, times: tuple[int, ...]) -> None:
    wall = scenery(seed, 1 + steps, 16)
    still = torch.cat([wall[:1].expand(12, -1, -1, -1), wall, wall[-1:].expand(12, -1, -1, -1)])
    assert cuts_of(repeated(still, times)) == []


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("tilts", [False, True])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_short_whip_is_no_cut_whichever_way_it_goes(seed: int, tilts: bool, back: bool) -> None:
    wall = scenery(seed, 3, 16, SIZE[::-1]).transpose(2, 3) if tilts else scenery(seed, 3, 16)
    wall = wall.flip(0) if back else wall
    assert cuts_of(small(torch.cat([wall[:1].expand(12, -1, -1, -1), wall, wall[-1:].expand(12, -1, -1, -1)]))) == []


@pytest.mark.parametrize("still", [0, 12])
def test_frames_of_a_fast_camera_that_are_about_the_mean_of_those_beside_are_no_blend(still: int) -> None:
    wall = scenery(0, 8, 5)
    frames = torch.cat([wall[:1].expand(still, -1, -1, -1), wall, wall[-1:].expand(still, -1, -1, -1)])
    assert cuts_of(small(frames)) == []


def test_a_cut_stands_out_of_a_fast_pan_on_both_sides() -> None:
    for seed in (0, 1):
        assert cuts_of(small(torch.cat([scenery(seed, 10, 6), scenery(seed + 3, 10, 6)]))) == [10]


@pytest.mark.parametrize(("drift", "seed"), [(2, 0), (2, 1), (3, 1), (3, 2), (4, 0)])
def test_a_mix_of_two_shots_that_move_on_does_not_hide_the_cut_and_no_other_frame_is_one(drift: int, seed: int) -> None:
    before, after = scenery(seed, 11, drift), scenery(seed + 3, 11, drift)
    mixed = ((before[-1:].float() + after[:1].float()) / 2).round().byte()
    assert find_shots(small(torch.cat([before[:10], mixed, after[1:]]))) == [(0, 9), (11, 20)]


def test_a_mix_behind_a_few_still_frames_does_not_hide_the_cut_into_a_moving_shot() -> None:
    before, after = scenery(1, 4, 0), scenery(4, 10, 4)
    mixed = ((before[-1:].float() + after[:1].float()) / 2).round().byte()
    assert find_shots(small(torch.cat([before, mixed, after]))) == [(0, 3), (5, 14)]


@pytest.mark.parametrize("steps", [2, 3])
@pytest.mark.parametrize("seeds", [(0, 3), (1, 5), (4, 2)])
def test_a_cut_into_a_short_whip_pan_is_found(seeds: tuple[int, int], steps: int) -> None:
    wall = scenery(seeds[1], 1 + steps, 16)
    frames = torch.cat([scenery(seeds[0], 12), wall, wall[-1:].expand(12, -1, -1, -1)])
    assert 12 in cuts_of(small(frames))


@pytest.mark.parametrize("level", [0, 7, 255])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 12])
def test_a_cut_through_pictures_that_show_nothing_is_found(level: int, count: int) -> None:
    nothing = (level + torch.rand(count, 3, *SIZE[::-1])).clamp(max=255).byte()
    assert cuts_of(small(torch.cat([scenery(0), nothing, scenery(1)]))) == [10 + count]
    assert cuts_of(small(torch.cat([scenery(0)[:5], nothing, scenery(0)[5:]]))) == []
    assert cuts_of(small(torch.cat([nothing, scenery(0), nothing]))) == []
    assert cuts_of(small(nothing)) == []


@pytest.mark.parametrize("to", [0, 255])
@pytest.mark.parametrize("pause", [1, 4])
@pytest.mark.parametrize("length", [4, 12, 24])
def test_a_fade_is_a_cut_where_it_ends_in_another_shot(to: int, pause: int, length: int) -> None:
    fade = torch.linspace(1, 0, length)[:, None, None, None]

    def faded(frames: Tensor, share: Tensor) -> Tensor:
        return (to + (frames.float() - to) * share).round().byte()

    def through(first: Tensor, second: Tensor) -> Tensor:
        nothing = torch.full((pause, 3, *SIZE[::-1]), to, dtype=torch.uint8)
        ends, begins = faded(first[-length:], fade), faded(second[:length], fade.flip(0))
        return torch.cat([first[:-length], ends, nothing, begins, second[length:]])

    one, other = scenery(0, 48), scenery(1, 48)
    (cut,) = cuts_of(small(through(one, other)))
    assert 48 + pause <= cut < 48 + pause + length / 2
    assert cuts_of(small(through(one[:24], one[24:]))) == []


def test_the_shots_offered_leave_out_the_black_between(tmp_path: Path) -> None:
    black = torch.zeros(3, 3, *SIZE[::-1], dtype=torch.uint8)
    where = saved(tmp_path / "a.mkv", torch.cat([black, scenery(0), black, scenery(1), black]))
    with pytest.raises(InputError, match=r"frame 16: a cut at 1\.600 s") as caught:
        open_clip(where)
    assert f"take one: '{where.path}#t=0.300,1.200' or '{where.path}#t=1.600,2.500'; no cut?" in str(caught.value)
    assert torch.equal(open_clip(replace(where, span=(1.6, 2.5)))[0].image, scenery(1))
    with pytest.raises(InputError) as caught:
        open_clip(ClipSource.parse(f"{where.path}#person=0.4,0.6,1"))
    assert f"'{where.path}#t=0.300,1.200&person=0.4,0.6,0.7' or '{where.path}#t=1.600,2.500';" in str(caught.value)


def test_every_cut_is_found() -> None:
    assert cuts_of(small(torch.cat([scenery(s, 8) for s in range(4)]))) == [8, 16, 24]


@pytest.mark.needs("video/sintel_alley", "video/intel_asl_walk.mkv")
def test_a_real_shot_has_no_cut_and_two_joined_have_one() -> None:
    first, second = (small_of(VIDEOS / name) for name in ("sintel_alley", "intel_asl_walk.mkv"))
    assert cuts_of(first) == cuts_of(second) == []
    assert cuts_of(np.concatenate([first, second])) == [len(first)]


@pytest.mark.parametrize(("rows", "columns"), [(5, 0), (0, 8), (4, 6), (0, 0)])
def test_bars_are_cropped_and_told(tmp_path: Path, rows: int, columns: int) -> None:
    frames = 40 + scenery(4) // 2
    frames[:, :, :rows] = frames[:, :, SIZE[1] - rows :] = 3
    frames[..., :columns] = frames[..., SIZE[0] - columns :] = 3
    where = saved(tmp_path / "a.mkv", frames)
    clip, flags = open_clip(where)
    assert clip.size == (SIZE[0] - 2 * columns, SIZE[1] - 2 * rows)
    assert torch.equal(clip.image, frames[:, :, rows : SIZE[1] - rows, columns : SIZE[0] - columns])
    assert len(flags) == (rows + columns > 0)
    assert open_clip(replace(where, letterbox="keep"))[0].size == SIZE


def test_bars_that_compression_has_lit_beside_the_picture_are_bars() -> None:
    frames = torch.full((3, 3, 100, 160), 16, dtype=torch.uint8)
    frames[:, :, 20:80] = 120
    frames[0, :, [18, 19, 80], ::20] = 40
    assert find_letterbox(frames) == (0, 20, 160, 80)
    frames[0, :, 10, ::20] = 200  # a title in the bar
    assert find_letterbox(frames) == (0, 0, 160, 100)


def test_a_dark_line_at_the_edge_is_no_bar() -> None:
    for rows, bars in ((1, (0, 0, 160, 200)), (2, (0, 2, 160, 198))):
        frames = torch.full((3, 3, 200, 160), 120, dtype=torch.uint8)
        frames[:, :, :rows] = frames[:, :, 200 - rows :] = 16
        assert find_letterbox(frames) == bars


def test_an_upright_picture_in_a_wide_frame_has_bars() -> None:
    frames = torch.zeros(3, 3, 540, 960, dtype=torch.uint8)
    frames[..., 328:632] = 200
    assert find_letterbox(frames) == (328, 0, 632, 540)


@pytest.mark.parametrize(
    "picture",
    [(219, 30, 421, 330), (60, 30, 580, 330), (40, 60, 600, 300), (170, 100, 470, 260), (240, 110, 400, 250)],
)
def test_bars_on_all_four_sides_are_all_bars(picture: tuple[int, int, int, int]) -> None:
    left, top, right, bottom = picture
    frames = torch.zeros(3, 3, 360, 640, dtype=torch.uint8)
    frames[:, :, top:bottom, left:right] = 200
    assert find_letterbox(frames) == picture


def test_a_dark_picture_and_a_thing_before_black_are_no_letterbox() -> None:
    whole = (0, 0, *SIZE)
    assert find_letterbox(torch.zeros(3, 3, SIZE[1], SIZE[0], dtype=torch.uint8)) == whole
    thing = torch.zeros(3, 3, SIZE[1], SIZE[0], dtype=torch.uint8)
    y, x = torch.meshgrid(torch.arange(SIZE[1]), torch.arange(SIZE[0]), indexing="ij")
    thing[:, :, (y - 18) ** 2 + (x - 32) ** 2 < 200] = 200
    assert find_letterbox(thing) == whole
    lamp = torch.zeros_like(thing)
    lamp[:, :, 14:22, 10:20] = 200  # a rectangle, and not in the middle
    assert find_letterbox(lamp) == whole
    night = 40 + scenery(5) // 2
    night[:, :, :8] = 2  # a black sky over a lit street: no bar below
    assert find_letterbox(night) == whole
    night[:, :, 33:] = 2  # nor as high a one
    assert find_letterbox(night) == whole
    slit = torch.zeros_like(thing)
    slit[:, :, 15:21] = 200  # of a door: all but a sixth is dark
    assert find_letterbox(slit) == whole


def test_uneven_frames_are_thinned_evenly_in_time(tmp_path: Path) -> None:
    times = torch.cat([torch.arange(10) * 0.01, 0.1 + torch.arange(10) * 0.1]).double()
    saved(tmp_path / "a.mkv", scenery(6, 20), times)
    kept = read_clip(tmp_path / "a.mkv", 5).times
    torch.testing.assert_close(kept, torch.tensor([0.0, 0.2, 0.5, 0.7, 1.0]).double(), atol=0.055, rtol=0)
    assert bool((read_clip(tmp_path / "a.mkv", 19).times.diff() > 0).all())


def test_a_span_counts_from_the_first_frame_and_keeps_both_ends(tmp_path: Path) -> None:
    saved(tmp_path / "a.mkv", scenery(7, 10), 5 + torch.arange(10).double() / 10)
    clip = read_clip(tmp_path / "a.mkv", span=(0.2, 0.5))
    torch.testing.assert_close(clip.times, torch.tensor([0.0, 0.1, 0.2, 0.3]).double(), atol=1e-6, rtol=0)
    assert clip.start == pytest.approx(0.2)
    for end, when in ((3.0, "between 2 and 3 s"), (math.inf, "from 2 s on")):
        with pytest.raises(InputError, match=rf"a\.mkv: t: no frame {when}: the clip ends at 0\.900 s$"):
            read_clip(tmp_path / "a.mkv", span=(2.0, end))


def test_a_rate_that_nothing_says_is_told(tmp_path: Path) -> None:
    folder = images(tmp_path / "a", scenery(0, 4))
    assert open_clip(ClipSource(folder))[1] == (ASSUMED,)
    assert open_clip(ClipSource(folder, fps=24))[1] == ()
    (folder / "times.json").write_text("[0, 1, 2, 3]")
    assert open_clip(ClipSource(folder))[1] == ()
    assert open_clip(saved(tmp_path / "a.mkv", scenery(0, 4)))[1] == ()


@pytest.mark.parametrize(
    "source", ["a.mp4", "b/a.mp4#t=1.500", "a.mp4#t=0.000,4.000&person=2&cuts=keep", "b/a#person=0.4,0.6,1.5&fps=29.97"]
)
def test_a_source_is_named_as_it_was(source: str) -> None:
    assert ClipSource.parse(source).named == source


def test_a_source_names_its_part(tmp_path: Path) -> None:
    assert ClipSource.parse("a.mp4#t=,4&person=2&letterbox=keep") == ClipSource(
        Path("a.mp4"), (0.0, 4.0), 2, "keep", None
    )
    assert ClipSource.parse("frames#fps=29.97&t=1,2&person=1") == ClipSource(Path("frames"), (1.0, 2.0), 1, fps=29.97)
    (tmp_path / "b#t=1.mp4").touch()
    assert ClipSource.parse(str(tmp_path / "b#t=1.mp4")).path.name == "b#t=1.mp4"


def test_parts_that_each_have_a_mark_are_told_to_be_joined(tmp_path: Path) -> None:
    source = f"{tmp_path / 'take#2.mp4'}#t=0,0.2#person=0.4,0.6,1"
    with pytest.raises(UsageError, match=r"expected one # before all parts, got several \(join parts by &: ") as told:
        ClipSource.parse(source)
    joined = shlex.split(told.value.hint.removeprefix("join parts by &: "))[0]
    wanted = ClipSource(tmp_path / "take#2.mp4", (0.0, 0.2), (0.4, 0.6, 1.0))
    assert ClipSource.parse(joined) == wanted
    assert ClipSource.parse("take#2.mp4#t=1").path == Path("take#2.mp4")
    (tmp_path / "take#2.mp4#t=0,0.2").touch()
    assert ClipSource.parse(source).path == tmp_path / "take#2.mp4#t=0,0.2"


def test_a_person_is_named_by_a_place_and_a_moment() -> None:
    times = torch.tensor([0.0, 0.5, 1.0], dtype=torch.float64)
    assert ClipSource.parse("a.mp4#person=0.25,0.5").who(times, (200, 100)) == Spot(0, 0.25, 0.5, (200, 100))
    assert ClipSource.parse("a.mp4#person=0.25,0.5,0.6").who(times, (200, 100)) == Spot(1, 0.25, 0.5, (200, 100))
    assert ClipSource.parse("a.mp4#person=0.25,0.5,0.7").who(times, (200, 100)) == Spot(1, 0.25, 0.5, (200, 100), 2)
    assert ClipSource.parse("a.mp4#person=0.25,0.5,0.3").who(times, (200, 100)) == Spot(1, 0.25, 0.5, (200, 100), 0)
    assert ClipSource.parse("a.mp4#person=1").who(times, (200, 100)) == 1
    assert ClipSource.parse("a.mp4").who(times, (200, 100)) is None
    with pytest.raises(UsageError, match=r"expected up to 1\.000 s, where the frames that are read end, got 3"):
        ClipSource.parse("a.mp4#person=0.25,0.5,3").who(times, (200, 100))


BAD_PERSONS = ["person=-1", "person=0.5", "person=0.5,1.5", "person=0.5,0.5,-1", "person=0.1,0.2,0.3,0.4"]
BAD_RATES = ["fps=", "fps=0", "fps=-30", "fps=nan", "fps=1e9", "fps=fast", "fps=30&fps=24"]


@pytest.mark.parametrize("part", [*BAD_PERSONS, "t=4,1", "t=x", "t=-1,2", "speed=2", "cuts=no", "t=1&t=2", *BAD_RATES])
def test_a_part_that_cannot_be_meant_is_a_usage_error(part: str) -> None:
    with pytest.raises(UsageError, match=rf"#{part.partition('=')[0]}"):
        ClipSource.parse(f"a.mp4#{part}")


@pytest.mark.parametrize(("step", "flagged"), [(0.1, False), (2.5, True)])
def test_frames_far_apart_in_time_are_flagged(tmp_path: Path, step: float, flagged: bool) -> None:
    where = saved(tmp_path / "clip.mkv", scenery(0), torch.arange(10).double() * step)
    _, flags = open_clip(where)
    assert [("frames are 2.5 s apart" in flag) for flag in flags] == ([True] if flagged else [])


def test_nothing_is_decoded_behind_the_last_frame_that_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    where, taken = saved(tmp_path / "clip.mkv", scenery(0, 10)), list[int]()
    decode = parts.decode

    def counted(path: Path) -> Iterator[Frame]:
        taken.append(0)
        for frame in decode(path):
            taken[-1] += 1
            yield frame

    monkeypatch.setattr(parts, "decode", counted)
    clip, _ = open_clip(replace(where, span=(0.0, 0.3), cuts="keep"))
    assert clip.times.tolist() == pytest.approx([0, 0.1, 0.2, 0.3])
    assert taken == [10, 4]  # once to know it, once for what is kept


def test_too_many_pairs_are_refused_before_they_are_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    where = saved(tmp_path / "clip.mkv", scenery(0, 10))
    monkeypatch.setattr(parts, "FRAME_LIMIT", 9)
    monkeypatch.setattr("cltransfer.clips.pairs.check_one_shot", lambda where, part: pytest.fail("looked for cuts"))
    with pytest.raises(InputError, match="frames: expected at most 9 to keep, got 10"):
        open_pairs(where, where, None)


@pytest.mark.parametrize(("asked", "wrong"), [("persn=1", "#persn: unknown part"), ("t=0,1&t=1,2", "#t: expected")])
def test_a_part_that_is_unknown_or_asked_twice_is_told_to_be(asked: str, wrong: str) -> None:
    with pytest.raises(UsageError, match=rf"clip.mp4#.*{wrong}.*\(known: t, person"):
        ClipSource.parse(f"clip.mp4#{asked}")


@pytest.mark.parametrize("cuts", ["", "keep"])
def test_a_video_is_decoded_once_to_know_it_whether_or_not_cuts_are_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cuts: str
) -> None:
    where, decoded = replace(saved(tmp_path / "clip.mkv", scenery(0, 10)), cuts=cuts), list[Path]()

    def noted(path: Path, exif: bool = True) -> Iterator[Frame]:
        decoded.append(path)
        return decode(path, exif)

    for module in ("part", "clip"):
        monkeypatch.setattr(f"cltransfer.clips.{module}.decode", noted)
    open_clip(where)
    assert len(decoded) == 2, "and once for what is kept"
