"""What an image file is, whatever its name says, and videos that a decoder could be led astray by."""

import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
import torch
from av.stream import Disposition
from av.video.reformatter import Colorspace
from PIL import Image

from cltransfer.clips.clip import read_clip
from cltransfer.clips.image_folder import clip_hash
from cltransfer.clips.open_clip import open_clip
from cltransfer.clips.pairs import open_pairs
from cltransfer.clips.source import ClipSource
from cltransfer.errors import InputError

EARLY = """
import sys
from pathlib import Path
from cltransfer.clips.clip import read_clip
for _ in range(4):
    read_clip(Path(sys.argv[1]), span=(0, 0.2))
"""


def video_of(path: Path, codec: str, pictures: list[np.ndarray], size: tuple[int, int] = (64, 48)) -> Path:
    """A video whose header has ``size`` (W, H), whatever its pictures (H, W, 3) have."""
    with av.open(str(path), "w", options={}) as container:
        container.metadata["title"] = "Cafe 1"
        stream = container.add_stream(codec, rate=24)
        stream.width, stream.height = size
        stream.pix_fmt = "rgb24" if codec == "png" else "yuvj420p"
        for i, picture in enumerate(pictures):
            packet = av.Packet(cv2.imencode(".png" if codec == "png" else ".jpg", picture)[1].tobytes())
            packet.stream, packet.pts, packet.dts, packet.time_base = stream, i, i, Fraction(1, 24)
            container.mux(packet)
    return path


def noise(count: int, height: int = 48, width: int = 64) -> list[np.ndarray]:
    return list(np.random.default_rng(0).integers(0, 255, (count, height, width, 3), dtype=np.uint8))


def test_a_video_of_pngs_that_is_left_early_does_not_wait_for_ever(tmp_path: Path) -> None:
    """Its decoder's threads gave back memory of Python's while Python waited for them."""
    video = video_of(tmp_path / "a.mov", "png", noise(24, 240, 320), (320, 240))
    reading = [sys.executable, "-c", EARLY, str(video)]
    subprocess.run(reading, env={**os.environ, "CLTRANSFER_THREADS": "2"}, timeout=100, check=True)


def test_a_song_with_a_cover_is_no_clip(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "song.mp4"), "w") as container:
        cover = container.add_stream("mjpeg", rate=1)
        cover.width, cover.height, cover.pix_fmt = 64, 48, "yuvj420p"
        cover.disposition = Disposition.attached_pic
        song = container.add_stream("aac", rate=44_100)
        container.mux(cover.encode(av.VideoFrame.from_ndarray(noise(1)[0])) + cover.encode())
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 44_100), np.float32), format="fltp", layout="mono")
        silence.sample_rate, silence.pts = 44_100, 0
        container.mux(song.encode(silence) + song.encode())
    with pytest.raises(InputError, match=r"song\.mp4: video: no video stream"):
        read_clip(tmp_path / "song.mp4")


@pytest.mark.parametrize("name", ["cut.mp4", "cut.MOV", "cut.png"])
def test_a_file_that_is_cut_short_is_told_to_be_and_not_to_be_of_a_kind_that_is_not_read(
    tmp_path: Path, name: str
) -> None:
    whole = tmp_path / f"whole{Path(name).suffix.lower()}"
    if whole.suffix == ".png":
        cv2.imwrite(str(whole), noise(1)[0])
    else:
        video_of(whole, "mjpeg", noise(3))
    data = whole.read_bytes()
    (tmp_path / name).write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="cannot be decoded") as caught:
        read_clip(tmp_path / name)
    assert caught.value.hint.endswith(", it is damaged or cut short: copy or download it anew")


@pytest.mark.parametrize("name", ["a.gif", "b.mp4"])
def test_a_gif_is_told_not_to_be_read_and_what_to_do(tmp_path: Path, name: str) -> None:
    pictures = [Image.fromarray(picture) for picture in noise(2)]
    pictures[0].save(tmp_path / name, format="GIF", save_all=True, append_images=pictures[1:])
    with pytest.raises(InputError, match=r": video: .* \(GIF is not read: convert it to mp4 or PNGs\)"):
        read_clip(tmp_path / name)


def test_a_title_of_another_code_page_is_no_fault(tmp_path: Path) -> None:
    video = video_of(tmp_path / "a.avi", "mjpeg", noise(3))
    data = video.read_bytes()
    assert b"Cafe 1" in data
    video.write_bytes(data.replace(b"Cafe 1", b"Caf\xe9 1"))
    assert len(read_clip(video).image) == 3


@pytest.mark.parametrize(("codec", "name"), [("mjpeg", "a.avi"), ("png", "a.mov")])
def test_a_frame_that_is_larger_than_the_header_says_is_never_decoded(tmp_path: Path, codec: str, name: str) -> None:
    large = np.zeros((3000, 3000, 3), np.uint8)
    video = video_of(tmp_path / name, codec, [*noise(1), large, large])
    with pytest.raises(InputError, match=rf"{name}: video: cannot be decoded"):
        read_clip(video)


def test_a_folder_is_known_by_what_is_played_of_it(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "clip", "png", "PNG")
    before = clip_hash(folder)
    (tmp_path / "outside.txt").write_text("1")
    (folder / "notes").symlink_to(tmp_path / "outside.txt")
    (folder / ".DS_Store").write_text("mine")
    (folder / "run").mkdir()
    (folder / "run" / "0.png").write_text("no picture of this clip")
    assert clip_hash(folder) == before
    (folder / "times.json").write_text("[0, 1]")
    timed = clip_hash(folder)
    (folder / "1.png").write_bytes((folder / "0.png").read_bytes())
    assert len({before, timed, clip_hash(folder)}) == 3


def folder_of(folder: Path, suffix: str, kind: str) -> Path:
    """Two images of one kind under names of a suffix."""
    folder.mkdir()
    for i, seed in enumerate((3, 4)):
        pixels = np.random.default_rng(seed).integers(0, 255, (24, 32, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(folder / f"{i}.{suffix}", format=kind)
    return folder


@pytest.mark.parametrize(("kind", "right", "wrong"), [("JPEG", "jpg", "png"), ("PNG", "png", "jpeg")])
def test_an_image_is_what_its_first_bytes_say(tmp_path: Path, kind: str, right: str, wrong: str) -> None:
    named = read_clip(folder_of(tmp_path / "named", right, kind))
    misnamed = read_clip(folder_of(tmp_path / "misnamed", wrong, kind))
    assert torch.equal(misnamed.image, named.image)
    assert misnamed.size == (32, 24)


def test_a_jpeg_by_a_name_of_a_png_is_refused_where_it_is_cut_short_or_huge(tmp_path: Path) -> None:
    file = folder_of(tmp_path / "clip", "png", "JPEG") / "1.png"
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"1\.png: video: cannot be decoded: the file is cut short"):
        read_clip(file.parent)
    at = whole.index(b"\xff\xc0") + 5
    file.write_bytes(whole[:at] + b"\xff\xdc\xff\xdc" + whole[at + 4 :])
    with pytest.raises(InputError, match=r"1\.png: size: expected at most 64000000 pixels a frame, got 65500x65500"):
        read_clip(file.parent)


def test_what_is_neither_png_nor_jpeg_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_clip(folder_of(tmp_path / "clip", "png", "WEBP"))
    assert str(caught.value).endswith("0.png: image: is no PNG or JPEG, whatever its name (convert it)")


@pytest.mark.parametrize("name", ["0.png", "0.jpg", "0.mp4"])
def test_an_empty_file_is_told_so(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    said = f"{name}: size: expected a clip or an image, the file is empty (copy or write it anew)"
    with pytest.raises(InputError) as caught:
        read_clip(tmp_path / name)
    assert str(caught.value).endswith(said)


def test_a_scene_where_a_clip_belongs_is_told_how_it_can_teach(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text("ply\n")
    with pytest.raises(InputError, match=r"a scene is a reference by a path through it: a\.ply@trajectory\.json"):
        read_clip(tmp_path / "a.ply")
    (tmp_path / "a.ply").rename(tmp_path / "$(a).ply")
    with pytest.raises(InputError, match=r"by a path through it: '\$\(a\)\.ply@trajectory\.json'"):
        read_clip(tmp_path / "$(a).ply")


def test_features_where_a_clip_belongs_are_told_who_takes_them(tmp_path: Path) -> None:
    (tmp_path / "a.safetensors").write_bytes(b"\xff" * 100)
    with pytest.raises(InputError, match=r"features .* are for `transfer`, .* a grid .*: a\.safetensors@"):
        read_clip(tmp_path / "a.safetensors")


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize(("height", "tagged", "known"), [(720, False, 709), (480, False, 601), (480, True, 709)])
def test_a_video_that_does_not_tell_its_colours_has_those_of_its_height(
    tmp_path: Path, height: int, tagged: bool, known: int, full: bool
) -> None:
    """Players take BT.709 from 720 rows on, BT.601 below, in either range; what is told holds."""
    kind = "yuvj420p" if full else "yuv420p"
    rgb = np.full((height, 320, 3), (200, 40, 40), np.uint8)
    matrix = {709: Colorspace.ITU709, 601: Colorspace.ITU601}[known]
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=24, options={"crf": "1"})
        stream.width, stream.height, stream.pix_fmt = 320, height, kind
        if tagged:
            stream.codec_context.colorspace = Colorspace.ITU709
        frame = av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(format=kind, dst_colorspace=matrix)
        frame.colorspace = matrix if tagged else 2
        for packet in (*stream.encode(frame), *stream.encode()):
            container.mux(packet)
    seen = read_clip(tmp_path / "a.mp4").image[0, :, height // 2, 160].tolist()
    assert seen == pytest.approx([200, 40, 40], abs=3)


@pytest.mark.parametrize("name", ["a.avi", "a.mkv"])
def test_a_video_of_jpegs_has_their_colours_at_any_height(tmp_path: Path, name: str) -> None:
    bgr = np.full((720, 320, 3), (40, 40, 200), np.uint8)
    seen = read_clip(video_of(tmp_path / name, "mjpeg", [bgr, bgr], (320, 720))).image[0, :, 360, 160].tolist()
    assert seen == pytest.approx([200, 40, 40], abs=6)


def plain_frame(number: int) -> av.VideoFrame:
    frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 90, np.uint8), format="rgb24")
    frame.pts, frame.time_base = number, Fraction(1, 24)
    return frame


def written(path: Path, interlaced: bool = False, transfer: int = 1) -> ClipSource:
    """A video of H.264, as it says of itself."""
    with av.open(str(path), "w") as container:
        options = {"x264-params": "tff=1"} if interlaced else {}
        stream = container.add_stream("libx264", rate=24, options=options)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.color_trc = transfer
        for i in range(4):
            container.mux(stream.encode(plain_frame(i)))
        container.mux(stream.encode())
    return ClipSource(path)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (
            {"interlaced": True},
            ("interlaced: two moments in each frame (deinterlace it first, as by ffmpeg -vf bwdif)",),
        ),
        ({"transfer": 16}, ("HDR (PQ): read as if it were SDR, washed out (convert it first)",)),
        ({"transfer": 18}, ("HDR (HLG): read as if it were SDR, washed out (convert it first)",)),
        ({}, ()),
    ],
)
@pytest.mark.parametrize("name", ["a.mp4", "a.mkv"])
def test_a_video_that_is_interlaced_or_hdr_is_told_once_and_read_all_the_same(
    tmp_path: Path, said: dict[str, int], told: tuple[str, ...], name: str
) -> None:
    where = written(tmp_path / name, **said)
    clip, flags = open_clip(where)
    assert len(clip) == 4
    assert flags == told
    plain = written(tmp_path / "plain.mp4")
    assert open_pairs(where, plain, None)[1:] == (told, ())
    assert open_pairs(plain, where, None)[1:] == ((), told)


def test_a_png_whose_rows_come_in_another_order_is_not_told_to_be_interlaced(tmp_path: Path) -> None:
    codec: Any = av.CodecContext.create("png", "w")
    codec.width, codec.height, codec.pix_fmt, codec.time_base = 64, 48, "rgb24", Fraction(1, 24)
    codec.options = {"flags": "+ildct"}
    data = b"".join(bytes(packet) for packet in codec.encode(plain_frame(0)))
    assert data[28] == 1  # Adam7
    (tmp_path / "0.png").write_bytes(data)
    assert read_clip(tmp_path).notes == ()


def test_a_video_of_which_no_frame_that_is_kept_is_interlaced_is_not_told_to_be(tmp_path: Path) -> None:
    """A film of four frames, and as many of television behind it."""
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("mpeg2video", rate=24)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for first, flags in ((0, ""), (4, "+ildct+ilme")):
            codec: Any = av.CodecContext.create("mpeg2video", "w")
            codec.width, codec.height, codec.pix_fmt, codec.time_base = 64, 48, "yuv420p", Fraction(1, 24)
            codec.options = {"flags": flags} if flags else {}
            frames = [plain_frame(first + i).reformat(format="yuv420p") for i in range(4)]
            for frame in (*frames, None):
                for packet in codec.encode(frame):
                    packet.stream = stream
                    container.mux(packet)
    film, told = open_clip(ClipSource(tmp_path / "a.mkv", (0.0, 0.1)))
    assert (len(film), told) == (3, ())
    assert open_clip(ClipSource(tmp_path / "a.mkv"))[1][0].startswith("interlaced: ")


@pytest.mark.parametrize("codec", ["libx264", "mpeg4"])
def test_an_avi_whose_frames_are_coded_in_another_order_is_read_in_theirs(tmp_path: Path, codec: str) -> None:
    with av.open(str(tmp_path / "a.avi"), "w") as container:
        stream: Any = container.add_stream(codec, rate=24)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.max_b_frames = 2
        brighter = [np.full((48, 64, 3), 20 + 15 * i, np.uint8) for i in range(12)]
        for frame in (*(av.VideoFrame.from_ndarray(picture, format="rgb24") for picture in brighter), None):
            container.mux(stream.encode(frame))
    clip = read_clip(tmp_path / "a.avi")
    assert clip.times.diff().mul(24).round(decimals=6).unique().tolist() == [1.0]
    assert (clip.image.float().mean((1, 2, 3)).diff() > 0).all()
