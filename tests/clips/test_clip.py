import json
import re
import struct
import subprocess
import sys
import time
import tracemalloc
import zlib
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import torch
from PIL import Image, ImageOps

from cltransfer.clips import part
from cltransfer.clips.clip import read_clip, write_video
from cltransfer.clips.png_chunks import drawn_chunks
from cltransfer.errors import InputError, ResourceError, UsageError

VIDEOS = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "video"


def noise(count=5, size=(41, 33), seed=0):
    g = torch.Generator().manual_seed(seed)
    return torch.randint(0, 256, (count, 3, size[1], size[0]), generator=g, dtype=torch.uint8)


def smooth(count=5, size=(64, 48)):
    """Frames whose red grows to the right, green downwards, and blue with time."""
    x = torch.linspace(20, 230, size[0]).expand(size[1], size[0])
    y = torch.linspace(20, 230, size[1])[:, None].expand(size[1], size[0])
    frames = [torch.stack([x, y, torch.full_like(x, 40.0 + 200 * i / count)]) for i in range(count)]
    return torch.stack(frames).round().to(torch.uint8)


def seconds(*values):
    return torch.tensor(values, dtype=torch.float64)


def encode(path, image, codec="libx264", pix_fmt="yuv444p", change=lambda stream: None, **options):
    """Any video as a camera or program might leave it."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=24, options=options)
        stream.height, stream.width, stream.pix_fmt = *image.shape[2:], pix_fmt
        change(stream)
        for rgb in image:
            frame = av.VideoFrame.from_ndarray(rgb.permute(1, 2, 0).contiguous().numpy(), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def refused(path, field, match=None):
    start = time.process_time()
    with pytest.raises(InputError, match=match) as caught:
        read_clip(path)
    assert time.process_time() - start < 2
    assert "\n" not in str(caught.value)
    assert caught.value.field == field
    return caught.value


def damaged(path, data):
    path.write_bytes(bytes(data))
    return path


def test_lossless_video_returns_every_bit_and_times_to_a_millisecond(tmp_path):
    image, times = noise(), seconds(7.0, 7.02, 7.08, 7.1004, 7.16)
    write_video(tmp_path / "a.mkv", image, times, lossless=True)
    clip = read_clip(tmp_path / "a.mkv")
    assert torch.equal(clip.image, image)
    torch.testing.assert_close(clip.times, seconds(0, 0.02, 0.08, 0.1, 0.16), atol=1e-9, rtol=0)


def test_mp4_keeps_colours_and_uneven_times(tmp_path):
    image, times = smooth(), seconds(0, 1 / 24, 0.06, 0.5, 1.9)
    write_video(tmp_path / "a.mp4", image, times)
    clip = read_clip(tmp_path / "a.mp4")
    assert (clip.image.int() - image.int()).abs().float().mean() < 2
    torch.testing.assert_close(clip.times, times, atol=0.5 / 90_000 + 1e-9, rtol=0)


def test_mp4_pads_odd_sides_by_repeating_the_edge(tmp_path):
    image = smooth(size=(65, 49))
    write_video(tmp_path / "a.mp4", image, torch.arange(5).double() / 24)
    clip = read_clip(tmp_path / "a.mp4")
    assert clip.size == (66, 50)
    assert (clip.image[:, :, :49, :65].int() - image.int()).abs().float().mean() < 2
    assert (clip.image[:, :, :, 65].int() - clip.image[:, :, :, 64].int()).abs().float().mean() < 3


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_the_same_frames_are_the_same_file(tmp_path, suffix):
    picture = torch.rand(1, 3, 8, 12, generator=torch.Generator().manual_seed(0))
    picture = (torch.nn.functional.interpolate(picture, (148, 404), mode="bicubic")[0].clamp(0, 1) * 255).byte()
    image = torch.stack([picture[:, i : i + 108, 2 * i : 2 * i + 324] for i in range(30)])
    written, kept = set(), []
    for i in range(10):
        kept.append(bytearray(1000 * (i * 7919 % 97)))  # another place in memory each time
        write_video(tmp_path / f"a{suffix}", image, torch.arange(30).double() / 24, lossless=suffix == ".mkv")
        written.add((tmp_path / f"a{suffix}").read_bytes())
    assert len(written) == 1


def test_write_video_leaves_nothing_behind_when_it_fails(tmp_path):
    (tmp_path / "a.mp4").mkdir()
    with pytest.raises(UsageError, match=r"a.mp4: is no regular file"):
        write_video(tmp_path / "a.mp4", smooth(), torch.arange(5).double())
    (tmp_path / "file").touch()
    with pytest.raises(ResourceError, match="cannot be written"):
        write_video(tmp_path / "file" / "b.mp4", smooth(), torch.arange(5).double())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mp4", "file"]


def test_frames_that_would_share_a_millisecond_are_written_one_after_the_other(tmp_path):
    write_video(tmp_path / "a.mkv", noise(5), seconds(0, 0.0004, 0.0008, 0.0333, 0.0667), lossless=True)
    torch.testing.assert_close(read_clip(tmp_path / "a.mkv").times, seconds(0, 0.001, 0.002, 0.033, 0.067))


def test_an_mp4_that_would_last_longer_than_it_can_is_refused(tmp_path):
    with pytest.raises(ResourceError, match=r"a.mp4: times: an mp4 holds 1e\+06 s, got 2e\+06 s \(.*#t=START,END\)"):
        write_video(tmp_path / "a.mp4", noise(2), seconds(0, 2e6))


@pytest.mark.parametrize("last", [1e4, 10_001, 12_500, 23_861, 5e4, 1e6])
@pytest.mark.parametrize("parts", [(0.0, 1.0), (0.0, 0.25, 0.5, 1.0), (0.0, 1e-7, 1.0), (0.0, 1e-6, 2e-6, 3e-6, 1.0)])
def test_videos_keep_what_lasts_for_hours_and_days(tmp_path, parts, last):
    """Of four frames, B-frames among them, an mp4 of 90 kHz had lost all from 12,000 s on."""
    times = last * seconds(*parts)
    for suffix in (".mp4", ".mkv"):
        write_video(tmp_path / f"a{suffix}", noise(len(times)), times, lossless=suffix == ".mkv")
        torch.testing.assert_close(read_clip(tmp_path / f"a{suffix}").times, times, atol=0.003, rtol=0)


@pytest.mark.parametrize("count", [3, 4, 8])
@pytest.mark.parametrize("step", [1e-6, 1e-5, 1e-4, 2e-4, 1e-3])
def test_frames_of_an_mp4_may_be_closer_than_a_millisecond(tmp_path, count, step):
    times = torch.arange(count).double() * step
    write_video(tmp_path / "a.mp4", smooth(count), times)
    torch.testing.assert_close(read_clip(tmp_path / "a.mp4").times, times, atol=count / 90_000, rtol=0)


def test_write_video_refuses_times_that_do_not_increase(tmp_path):
    with pytest.raises(ValueError, match="increase"):
        write_video(tmp_path / "a.mkv", noise(2), seconds(0, 0), lossless=True)
    assert not list(tmp_path.iterdir())


def test_a_part_named_to_a_millisecond_holds_its_first_and_last_frame(tmp_path):
    write_video(tmp_path / "clip.mp4", torch.zeros(7, 3, 16, 16, dtype=torch.uint8), torch.arange(7).double() / 24)
    clip = read_clip(tmp_path / "clip.mp4", span=(0.042, 0.208))  # 1/24 and 5/24, rounded
    assert len(clip) == 5


def test_frames_are_picked_evenly_with_first_and_last(tmp_path):
    image = noise(11)
    write_video(tmp_path / "a.mkv", image, torch.arange(11).double() / 10, lossless=True)
    clip = read_clip(tmp_path / "a.mkv", frames=3)
    assert torch.equal(clip.image, image[[0, 5, 10]])
    torch.testing.assert_close(clip.times, seconds(0, 0.5, 1.0))
    assert len(read_clip(tmp_path / "a.mkv", frames=50)) == 11


def test_large_frames_are_averaged_down_and_small_ones_left_alone(tmp_path):
    image = noise(2, (80, 40))
    write_video(tmp_path / "a.mkv", image, seconds(0, 1), lossless=True)
    clip = read_clip(tmp_path / "a.mkv", max_side=40)
    assert clip.size == (40, 20)
    expected = torch.nn.functional.avg_pool2d(image.float(), 2)
    assert (clip.image.float() - expected).abs().max() <= 1
    assert read_clip(tmp_path / "a.mkv", max_side=81).size == (80, 40)


def test_a_photograph_may_be_larger_than_a_frame_of_a_video(tmp_path):
    photo = np.full((3024, 4032, 3), 90, np.uint8)  # a telephone's twelve megapixels
    cv2.imwrite(str(tmp_path / "photo.jpg"), photo)
    clip = read_clip(tmp_path)
    assert clip.size == (960, 720)
    assert (clip.image.float() - 90).abs().max() <= 2
    video = encode(tmp_path / "a.mkv", torch.zeros(1, 3, 2200, 4032, dtype=torch.uint8), preset="ultrafast")
    refused(video, "size", "at most 8847360 pixels a frame, got 4032x2200")


@pytest.mark.parametrize("size", [(4096, 2160), (2160, 4096)])
def test_a_frame_as_large_as_a_cinema_s_is_read(tmp_path, size):
    image = torch.full((1, 3, size[1], size[0]), 90, dtype=torch.uint8)
    clip = read_clip(encode(tmp_path / "a.mkv", image, pix_fmt="yuv420p", preset="ultrafast"))
    assert max(clip.size) == 960
    assert (clip.image.float() - 90).abs().max() <= 2


@pytest.mark.parametrize("size", [(8001, 8000), (60000, 60000)])
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_an_image_that_only_a_header_makes_huge_is_refused_before_it_is_decoded(tmp_path, suffix, size):
    cv2.imwrite(str(tmp_path / f"a{suffix}"), np.zeros((8, 8, 3), np.uint8))
    data = bytearray((tmp_path / f"a{suffix}").read_bytes())
    if suffix == ".png":
        data[16:24] = struct.pack(">II", *size)
        data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    else:
        at = data.index(b"\xff\xc0") + 5
        data[at : at + 4] = struct.pack(">HH", *size[::-1])
    (tmp_path / f"a{suffix}").write_bytes(data)
    line = f"a{suffix}: size: expected at most 64000000 pixels a frame, got {size[0]}x{size[1]} (make it smaller)"
    with pytest.raises(InputError, match=re.escape(line)):
        read_clip(tmp_path)


def test_features_are_in_zero_to_one(tmp_path):
    write_video(tmp_path / "a.mkv", noise(), torch.arange(5).double(), lossless=True)
    features = read_clip(tmp_path / "a.mkv").features()
    assert features.size == (41, 33)
    assert torch.equal((features.image * 255).round().to(torch.uint8), noise())


@pytest.mark.parametrize(("degrees", "turns"), [(90, 1), (180, 2), (-90, 3)])
def test_rotation_tag_is_honoured(tmp_path, degrees, turns):
    image = smooth()
    path = encode(tmp_path / "a.mp4", image, change=lambda s: s.set_display_rotation(degrees))
    expected = torch.rot90(image, turns, dims=(2, 3))
    clip = read_clip(path)
    assert clip.size == (expected.shape[3], expected.shape[2])
    assert (clip.image.int() - expected.int()).abs().float().mean() < 4


@pytest.mark.parametrize(("degrees", "turns"), [(0, 0), (90, 1), (180, 2), (-90, 3)])
@pytest.mark.parametrize(("hflip", "vflip"), [(True, False), (False, True), (True, True)])
def test_a_mirrored_video_is_shown_so(tmp_path, degrees, turns, hflip, vflip):
    image = smooth()
    path = encode(tmp_path / "a.mp4", image, change=lambda s: s.set_display_rotation(degrees, hflip, vflip))
    expected = torch.rot90(image, turns, dims=(2, 3)).flip([side for side, flip in ((3, hflip), (2, vflip)) if flip])
    assert (read_clip(path).image.int() - expected.int()).abs().float().mean() < 4


@pytest.mark.parametrize("suffix", ["png", "jpg"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_of_an_image_is_honoured(tmp_path, suffix, orientation):
    block = Image.Exif()
    block[0x0112] = orientation
    Image.fromarray(smooth(1)[0].permute(1, 2, 0).numpy()).save(tmp_path / f"0.{suffix}", exif=block)
    expected = np.array(ImageOps.exif_transpose(Image.open(tmp_path / f"0.{suffix}")).convert("RGB"))
    clip = read_clip(tmp_path)
    assert clip.size == expected.shape[1::-1]
    assert np.abs(clip.image[0].permute(1, 2, 0).numpy().astype(int) - expected).mean() < 3


def exif(orientation, kind="<H2x", entries=1, start=8):
    """The bytes of an EXIF that states an orientation, stored as a struct ``kind``, and may be damaged behind it."""
    code = {"<H2x": 3, "<I": 4, "<f": 11}[kind]
    entry = struct.pack("<HHI", 0x0112, code, 1) + struct.pack(kind, orientation)
    return b"Exif\0\0II*\0" + struct.pack("<IH", start, entries) + entry + bytes(4)


@pytest.mark.parametrize("suffix", ["png", "jpg"])
@pytest.mark.parametrize(
    "block",
    [
        b"Exif\0\0no such thing",
        b"Exif\0\0",
        b"Exif\0\0II*\0",
        exif(6, start=9999),
        *(exif(value, "<f") for value in (float("inf"), float("nan"), -1e30, 6.5)),
    ],
)
def test_an_image_whose_exif_cannot_be_read_is_shown_as_it_is_stored(tmp_path, suffix, block):
    expected = smooth(1)
    Image.fromarray(expected[0].permute(1, 2, 0).numpy()).save(tmp_path / f"0.{suffix}", exif=block)
    assert (read_clip(tmp_path).image.int() - expected.int()).abs().float().mean() < 3


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_an_image_that_pillow_does_not_open_is_shown_as_it_is_stored(tmp_path, suffix, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)  # more than twice so many are refused
    image = smooth(1)
    Image.fromarray(image[0].permute(1, 2, 0).numpy()).save(tmp_path / f"0.{suffix}")
    assert (read_clip(tmp_path).image.int() - image.int()).abs().float().mean() < 3


@pytest.mark.parametrize("block", [b"Exif\0\0II*\0", exif(6, start=9999), exif(6, entries=50)])
def test_pillow_does_not_warn_of_an_exif_by_itself(tmp_path, block, recwarn):
    Image.fromarray(smooth(1)[0].permute(1, 2, 0).numpy()).save(tmp_path / "0.jpg", exif=block)
    read_clip(tmp_path)
    assert [str(one.message) for one in recwarn if "PIL" in one.filename] == []


def chunk(name: bytes, data: bytes) -> bytes:
    return len(data).to_bytes(4, "big") + name + data + zlib.crc32(name + data).to_bytes(4, "big")


def test_a_png_of_many_chunks_takes_little_memory_without_those_that_nobody_sees():
    shown = chunk(b"IDAT", b"")
    block = chunk(b"eXIf", b"data")
    data = b"\x89PNG\r\n\x1a\n" + block + shown * 50_000 + block + chunk(b"zTXt", b"a") + shown * 50_000
    tracemalloc.start()
    drawn = drawn_chunks(data)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert drawn == data[:8] + shown * 100_000
    assert most < 3 * len(data)


PEAK = """
import sys
from cltransfer.clips.clip import read_clip
for given in sys.argv[1:]:
    print(*read_clip(given).image.shape)
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def test_text_in_a_png_of_a_folder_or_a_video_is_not_unpacked(tmp_path):
    Image.fromarray(smooth(1)[0].permute(1, 2, 0).numpy()).save(tmp_path / "plain.png")
    plain = (tmp_path / "plain.png").read_bytes()
    packed = zlib.compress(bytes(300_000_000), 1)
    bomb = plain[:33] + b"".join(chunk(b"zTXt", name + b"\0\0" + packed) for name in (b"a", b"b")) + plain[33:]
    folder, video = tmp_path / "bombs", tmp_path / "bombs.mov"
    folder.mkdir()
    for i in range(2):
        (folder / f"{i}.png").write_bytes(bomb)
    with av.open(str(video), "w") as container:
        stream = container.add_stream("png", rate=24)
        stream.width, stream.height, stream.pix_fmt = *smooth(1).shape[:1:-1], "rgb24"
        for i in range(2):
            packet = av.Packet(bomb)
            packet.stream, packet.pts, packet.dts, packet.time_base = stream, i, i, Fraction(1, 24)
            container.mux(packet)
    reading = [sys.executable, "-c", PEAK, str(folder), str(video)]
    *shapes, peak = subprocess.run(reading, capture_output=True, text=True, check=True).stdout.splitlines()
    assert [shape.startswith("2 3 ") for shape in shapes] == [True, True]
    assert int(peak) < 800_000  # [kB]; 300 of it by importing


def test_a_jpeg_that_is_damaged_inside_is_refused(tmp_path):
    coarse = torch.nn.functional.interpolate(noise(1, (16, 12)).float(), (192, 256), mode="bicubic")[0]
    Image.fromarray(coarse.clamp(0, 255).byte().permute(1, 2, 0).numpy()).save(tmp_path / "0.jpg", quality=90)
    data = bytearray((tmp_path / "0.jpg").read_bytes())
    data[len(data) // 2 : -2] = bytes(len(data) - 2 - len(data) // 2)  # its end is there
    refused(damaged(tmp_path / "0.jpg", data), "video")


def test_an_avi_is_as_long_as_the_frames_that_it_has(tmp_path):
    ticks = (0, 1, 2, 3, 7, 8, 9)  # what is missing is an empty chunk in the file, and counted by its header
    with av.open(str(tmp_path / "a.avi"), "w") as container:
        stream = container.add_stream("mjpeg", rate=24)
        stream.height, stream.width, stream.pix_fmt = *smooth(1).shape[2:], "yuvj444p"
        stream.codec_context.time_base = Fraction(1, 24)
        for tick, rgb in zip(ticks, smooth(7)):
            frame = av.VideoFrame.from_ndarray(rgb.permute(1, 2, 0).contiguous().numpy(), format="rgb24")
            frame = frame.reformat(format="yuvj444p")
            frame.pts, frame.time_base = tick, Fraction(1, 24)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    clip = read_clip(tmp_path / "a.avi")
    torch.testing.assert_close(clip.times, seconds(*ticks) / 24, atol=1e-6, rtol=0)
    data = (tmp_path / "a.avi").read_bytes()
    refused(damaged(tmp_path / "cut.avi", data[: len(data) * 3 // 4]), "video")


def test_exif_that_cannot_be_read_is_told_once_a_folder(tmp_path, caplog):
    for name in ("0.jpg", "1.jpg"):
        picture = Image.fromarray(smooth(1)[0].permute(1, 2, 0).numpy())
        picture.save(tmp_path / name, exif=b"Exif\0\0no such thing")
    read_clip(tmp_path)
    said = [record.getMessage() for record in caplog.records]
    assert said == [f"{tmp_path}: EXIF that cannot be read in an image: it is shown as it is stored, and so are others"]


@pytest.mark.parametrize("suffix", ["png", "jpg"])
@pytest.mark.parametrize("orientation", [2, 5, 6])
@pytest.mark.parametrize("change", [{"entries": 50}, {"kind": "<I"}, {"kind": "<f"}])
def test_an_orientation_is_honoured_where_only_what_is_behind_it_is_damaged(tmp_path, suffix, orientation, change):
    block = exif(orientation, **change)
    Image.fromarray(smooth(1)[0].permute(1, 2, 0).numpy()).save(tmp_path / f"0.{suffix}", exif=block)
    expected = np.array(ImageOps.exif_transpose(Image.open(tmp_path / f"0.{suffix}")).convert("RGB"))
    clip = read_clip(tmp_path)
    assert clip.size == expected.shape[1::-1]
    assert np.abs(clip.image[0].permute(1, 2, 0).numpy().astype(int) - expected).mean() < 3


def test_pixels_that_are_not_square_are_made_square(tmp_path):
    def wide(stream):
        stream.codec_context.sample_aspect_ratio = 2

    clip = read_clip(encode(tmp_path / "a.mp4", smooth(size=(64, 48)), change=wide))
    assert clip.size == (128, 48)


@pytest.mark.parametrize(("aspect", "shown"), [(Fraction(4, 3), (320, 135)), (2, (320, 90))])
def test_a_large_frame_whose_pixels_are_not_square_is_held_to_those_that_are_decoded(tmp_path, aspect, shown):
    def anamorphic(stream):
        stream.codec_context.sample_aspect_ratio = aspect

    grey = torch.full((1, 3, 2160, 3840), 128, dtype=torch.uint8)
    path = encode(tmp_path / "a.mp4", grey, "mpeg4", "yuv420p", change=anamorphic)
    assert read_clip(path, max_side=320).size == shown


def test_a_frame_is_not_widened_without_end(tmp_path):
    def absurd(stream):
        stream.codec_context.sample_aspect_ratio = 200

    path = encode(tmp_path / "a.mp4", torch.zeros(1, 3, 480, 640, dtype=torch.uint8), "mpeg4", "yuv420p", change=absurd)
    refused(path, "frame 0", "expected at most 35389440 pixels a frame, got 128000x480")


@pytest.mark.parametrize("name", ["0.jpg", "0.png"])
def test_a_resolution_of_print_is_no_shape_of_pixels(tmp_path, name):
    Image.fromarray(smooth(1)[0].permute(1, 2, 0).numpy()).save(tmp_path / name, dpi=(300, 72))
    assert read_clip(tmp_path).size == (64, 48)


@pytest.mark.parametrize(("name", "codec", "pix_fmt"), [("0.jpg", "mjpeg", "yuvj420p"), ("0.png", "png", "rgb24")])
def test_images_of_a_video_whose_pixels_are_not_square_are_made_square(tmp_path, name, codec, pix_fmt):
    with av.open(str(tmp_path / name), "w", format="image2", options={"update": "1"}) as container:
        stream = container.add_stream(codec, rate=24)
        stream.height, stream.width, stream.pix_fmt = 48, 64, pix_fmt
        stream.codec_context.sample_aspect_ratio = 2
        frame = av.VideoFrame.from_ndarray(smooth(1)[0].permute(1, 2, 0).contiguous().numpy(), format="rgb24")
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    assert read_clip(tmp_path).size == (128, 48)


@pytest.mark.parametrize("pix_fmt", ["yuv420p", "yuv420p10le", "yuv444p", "gray"])
def test_any_pixel_format_is_read(tmp_path, pix_fmt):
    image = smooth(size=(66, 50))
    grey = image.float().mul(torch.tensor([0.299, 0.587, 0.114])[:, None, None]).sum(1, keepdim=True)
    expected = grey.expand(-1, 3, -1, -1) if pix_fmt == "gray" else image.float()
    path = encode(tmp_path / "a.mkv", image, "ffv1", pix_fmt)
    assert (read_clip(path).image.float() - expected).abs().mean() < 2


@pytest.mark.parametrize(
    ("name", "codec"),
    [("a.mov", "libx264"), ("a.webm", "libvpx-vp9"), ("a.avi", "mjpeg"), ("a.ts", "libx264")],
)
def test_usual_containers_are_read_from_time_0(tmp_path, name, codec):
    pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    clip = read_clip(encode(tmp_path / name, smooth(24), codec, pix_fmt))
    torch.testing.assert_close(clip.times, torch.arange(24).double() / 24, atol=1e-3, rtol=0)
    assert (clip.image.float() - smooth(24).float()).abs().mean() < 6


def test_an_edit_list_that_cuts_the_start_is_no_damage(tmp_path):
    path = encode(tmp_path / "a.mp4", smooth(24), g="12", bf="0")
    with av.open(str(path)) as source, av.open(str(tmp_path / "b.mp4"), "w") as cut:
        stream = cut.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.pts, packet.dts = packet.pts - 512 * 6, packet.dts - 512 * 6
                packet.stream = stream
                cut.mux(packet)
    assert len(read_clip(tmp_path / "b.mp4")) == 18


def test_truncated_and_damaged_files_are_refused(tmp_path):
    mp4 = encode(tmp_path / "a.mp4", noise(24, (96, 64)), movflags="faststart").read_bytes()
    write_video(tmp_path / "a.mkv", noise(48, (32, 32)), torch.arange(48).double() / 24, lossless=True)
    mkv = (tmp_path / "a.mkv").read_bytes()
    flipped = bytearray(mp4)
    for index in np.random.default_rng(0).integers(len(mp4) // 5, len(mp4), 400):
        flipped[index] ^= 255
    refused(damaged(tmp_path / "empty.mp4", b""), "size", "is empty")
    refused(damaged(tmp_path / "random.mp4", np.random.default_rng(0).bytes(9999)), "video")
    refused(damaged(tmp_path / "head.mp4", mp4[: len(mp4) // 2]), "video")
    refused(damaged(tmp_path / "head.mkv", mkv[: len(mkv) // 2]), "duration", "the header says")
    with pytest.raises(InputError, match=r"flipped\.mp4: "):
        read_clip(damaged(tmp_path / "flipped.mp4", flipped))


def test_a_cut_media_section_is_refused_though_its_index_is_whole(tmp_path):
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=24, options={"bf": "0"})
        stream.width = stream.height = 64
        stream.pix_fmt = "yuv420p"
        for rgb in noise(24, (64, 64)):
            frame = av.VideoFrame.from_ndarray(rgb.permute(1, 2, 0).contiguous().numpy(), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
    with pytest.raises(InputError):
        read_clip(damaged(tmp_path / "cut.mp4", data[: len(data) * 3 // 4]))


def test_a_header_that_promises_a_billion_frames_is_refused(tmp_path):
    data = bytearray(encode(tmp_path / "a.mp4", smooth()).read_bytes())
    at = data.index(b"stts") + 12
    data[at : at + 4] = struct.pack(">I", 10**9)
    with pytest.raises(InputError):
        read_clip(damaged(tmp_path / "many.mp4", data))
    at = data.index(b"stsz") + 8
    data[at : at + 8] = struct.pack(">II", 10, 10**9)
    refused(damaged(tmp_path / "many.mp4", data), "frames", "10+")


def test_a_frame_of_absurd_size_is_refused_before_it_is_decoded(tmp_path):
    data = bytearray(encode(tmp_path / "a.mp4", smooth()).read_bytes())
    at = data.index(b"avc1", data.index(b"stsd")) + 28
    data[at : at + 4] = struct.pack(">HH", 60000, 60000)
    data = data.replace(b"avcC", b"xvcC")  # else the size of the stream itself counts
    with pytest.raises(InputError):
        read_clip(damaged(tmp_path / "vast.mp4", data))
    header = b"IHDR" + struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    png = cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    bomb = png[:12] + header + struct.pack(">I", zlib.crc32(header)) + png[33:]
    (tmp_path / "frames").mkdir()
    damaged(tmp_path / "frames" / "0.png", bomb)
    assert refused(tmp_path / "frames", "size", "at most 64000000 pixels").where.endswith("0.png")


def test_a_video_that_nothing_here_decodes_is_refused(tmp_path):
    data = encode(tmp_path / "a.mp4", smooth()).read_bytes()
    assert b"avc1" in data
    refused(damaged(tmp_path / "b.mp4", data.replace(b"avc1", b"zzzz")), "video", "of a codec that cannot be decoded")


def test_a_sound_file_has_no_video(tmp_path):
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("aac", rate=48000)
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        sound.rate = 48000
        container.mux(stream.encode(sound))
        container.mux(stream.encode())
    refused(tmp_path / "a.mp4", "video", "no video stream")


def test_playlists_with_the_name_of_a_video_open_nothing(tmp_path):
    real = encode(tmp_path / "real.mp4", smooth())
    hls = f"#EXTM3U\n#EXT-X-TARGETDURATION:5\n#EXTINF:1,\n{real}\n#EXT-X-ENDLIST\n"
    refused(damaged(tmp_path / "hls.mp4", hls.encode()), "video")
    refused(damaged(tmp_path / "concat.mp4", f"ffconcat version 1.0\nfile {real.name}\n".encode()), "video")


@pytest.mark.parametrize("name", ["10:30.mp4", "take:2.mkv", "file:a.mp4", "concat:a.mp4", "%03d.mp4"])
def test_a_name_is_never_taken_for_a_protocol(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    write_video(name, smooth(), torch.arange(5).double(), lossless=name.endswith("mkv"))
    assert len(read_clip(name)) == len(read_clip(tmp_path / name)) == 5


@pytest.mark.parametrize("name", ["shots:1", "file:", "img%d"])
def test_a_folder_is_never_taken_for_a_protocol(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    Path(name).mkdir()
    for i in range(2):
        cv2.imwrite(str(tmp_path / name / f"{i}.png"), smooth(1)[0].permute(1, 2, 0).numpy())
    assert len(read_clip(name)) == 2


def test_other_protocols_stay_closed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_video("a.mp4", smooth(), torch.arange(5).double())
    for name in (
        f"file:{tmp_path}/a.mp4",
        "http://127.0.0.1:9/a.mp4",
        "concat:a.mp4",
        "subfile,,start,0,end,9,,:a.mp4",
    ):
        with pytest.raises(InputError, match="no such file"):
            read_clip(name)
    (tmp_path / "b.mp4").write_text("ffconcat version 1.0\nfile 'a.mp4'\n")
    with pytest.raises(InputError, match="cannot be decoded"):
        read_clip("b.mp4")


def test_more_frames_than_memory_allows_are_refused(tmp_path):
    path = tmp_path / "a.mkv"
    write_video(path, torch.zeros(2001, 3, 2, 2, dtype=torch.uint8), torch.arange(2001).double() / 24, lossless=True)
    refused(path, "frames", "at most 2000")
    assert len(read_clip(path, frames=10)) == 10


@pytest.fixture
def folder(tmp_path):
    for i, rgb in enumerate(noise(12, (20, 10))):
        cv2.imwrite(str(tmp_path / f"f{i}.png"), rgb.permute(1, 2, 0).numpy()[..., ::-1])
    return tmp_path


def test_a_folder_is_read_in_natural_order_at_24_a_second(folder):
    clip = read_clip(folder)
    assert torch.equal(clip.image, noise(12, (20, 10)))
    torch.testing.assert_close(clip.times, torch.arange(12).double() / 24)
    assert torch.equal(read_clip(folder, frames=2).image, noise(12, (20, 10))[[0, 11]])


def test_times_json_sets_the_times_of_a_folder(folder):
    times = [5.0, *np.linspace(5.1, 6, 11).tolist()]
    (folder / "times.json").write_text(json.dumps(times))
    torch.testing.assert_close(read_clip(folder).times, torch.tensor(times, dtype=torch.float64) - 5)
    for foreign in ("[0, 1]", f"[{', '.join(['9' * 400] * 12)}]"):
        (folder / "times.json").write_text(foreign)
        with pytest.raises(InputError, match="expected 12 increasing seconds"):
            read_clip(folder)


@pytest.mark.parametrize(
    ("first", "last", "said"),
    [
        (-1.7e308, 1.7e308, "finite numbers within 1e[+]10 s of 0"),
        (0, 1.0 + 1e-8, "1e-06 s and more between frames, frame 11 is shown 1e-08 s after the one before"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_times_that_are_none_of_frames_are_refused_when_they_are_read(folder, first, last, said):
    (folder / "times.json").write_text(json.dumps([first, *(i / 10 for i in range(1, 11)), last]))
    with pytest.raises(InputError, match=rf"times\.json: expected {said}"):
        read_clip(folder)


def test_a_folder_may_hold_bursts_and_a_time_lapse_of_a_month(folder):
    times = [0, 1e-4, *(i / 10 for i in range(1, 10)), 3e6]
    (folder / "times.json").write_text(json.dumps(times))
    assert read_clip(folder).times.tolist() == times


def test_fps_sets_the_times_of_a_folder_and_of_nothing_that_has_its_own(folder, tmp_path_factory):
    torch.testing.assert_close(read_clip(folder, fps=30).times, torch.arange(12).double() / 30)
    assert len(read_clip(folder, span=(0, 0.1), fps=30)) == 4
    video = encode(tmp_path_factory.mktemp("video") / "a.mp4", smooth())
    with pytest.raises(UsageError, match=r"a\.mp4: #fps: expected a folder of images"):
        read_clip(video, fps=30)
    (folder / "times.json").write_text(json.dumps(list(range(12))))
    with pytest.raises(UsageError, match=r"#fps: expected a folder without times\.json"):
        read_clip(folder, fps=30)
    with pytest.raises(InputError, match="no such file"):
        read_clip(folder / "none", fps=30)
    with pytest.raises(ValueError, match="positive"):
        read_clip(folder, fps=0)


@pytest.mark.parametrize(
    ("names", "field", "reason"),
    [
        (["frame_1_1080p", "frame_2_1080p", "frame_5_1080p"], "number", "follows number 2, expected 3"),
        (["12_30_58", "12_30_59", "12_31_00"], "numbers", "do not count up"),
        (["a1_b9", "a1_b10", "a1_b11"], None, None),
        (["take1_1", "take1_2", "take2_3", "take2_4"], None, None),
        (["a1", "b1"], None, None),
    ],
)
def test_the_number_of_an_image_is_the_last_in_its_name_that_counts(tmp_path, names, field, reason):
    picture = noise(1, (16, 16))[0].permute(1, 2, 0).numpy()
    for name in names:
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture)
    if reason is None:
        assert len(read_clip(tmp_path)) == len(names)
    else:
        told = refused(tmp_path, field)
        assert reason in told.reason
        assert told.hint == "put times.json there, a JSON list of 3 seconds, one per image, or renumber them"
        (tmp_path / "times.json").write_text("[0, 0.5, 1]")
        assert len(read_clip(tmp_path)) == 3


@pytest.mark.parametrize(
    ("names", "foreign"),
    [
        (["frame_0001", "frame_0002", "frame_0004", "thumb"], "thumb"),
        (["frame_0001", "frame_0001 (1)", "frame_0002"], "frame_0001 (1)"),
        (["depth16_0001", "depth16_0002", "rgb_0001", "rgb_0002"], "rgb_0001"),
    ],
)
def test_an_image_that_is_not_numbered_as_the_others_is_no_frame(tmp_path, names, foreign):
    picture = noise(1, (16, 16))[0].permute(1, 2, 0).numpy()
    for name in names:
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture)
    told = refused(tmp_path, "number", "is not numbered as .*_0001.png is")
    assert Path(told.where).stem == foreign
    assert told.hint.endswith("one per image, or take away what is none of its frames")
    (tmp_path / "times.json").write_text(json.dumps(list(range(len(names)))))
    assert len(read_clip(tmp_path)) == len(names)


def test_a_folder_with_a_gap_a_foreign_size_or_a_broken_image_names_the_file(folder):
    whole = (folder / "f7.png").read_bytes()
    (folder / "f7.png").write_bytes(whole[: len(whole) // 2])
    assert refused(folder, "video").where.endswith("f7.png")
    cv2.imwrite(str(folder / "f7.png"), np.zeros((10, 21, 3), np.uint8))
    assert refused(folder, "size", "expected").where.endswith("f7.png")
    (folder / "f7.png").unlink()
    assert refused(folder, "number").where.endswith("f8.png")


def test_what_a_mac_leaves_beside_the_images_is_none_of_them(folder):
    for i in range(12):
        (folder / f"._f{i}.png").write_bytes(b"a Mac has been here")
    assert torch.equal(read_clip(folder).image, noise(12, (20, 10)))


def test_a_link_out_of_the_folder_is_not_followed(folder, tmp_path_factory):
    private = tmp_path_factory.mktemp("private") / "me.png"
    (folder / "f7.png").rename(private)
    (folder / "f7.png").symlink_to(private)
    assert refused(folder, "", "leads out of its folder").where.endswith("f7.png")
    (folder / "f7.png").unlink()
    (folder / "f7.png").symlink_to("f8.png")
    assert len(read_clip(folder)) == 12
    private.with_name("times").write_text(json.dumps(list(range(12))))
    (folder / "times.json").symlink_to(private.with_name("times"))
    assert refused(folder, "", "leads out of its folder").where.endswith("times.json")


def test_a_link_to_itself_is_an_image_that_is_not_there(folder):
    (folder / "times.json").symlink_to("times.json")
    assert len(read_clip(folder)) == 12
    (folder / "f12.png").symlink_to("f12.png")
    assert refused(folder, "", "no such file").where.endswith("f12.png")


@pytest.mark.parametrize("options", [[], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]])
def test_what_lies_behind_a_jpeg_is_none_of_it(tmp_path, options):
    picture = np.random.default_rng(3).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    data = cv2.imencode(".jpg", picture, options)[1].tobytes()
    (tmp_path / "0.jpg").write_bytes(data + b"\xff\xda" * 3)  # as in the film of a motion photo
    assert read_clip(tmp_path).size == (64, 48)
    for share in (0.3, 0.6, 0.95):
        (tmp_path / "0.jpg").write_bytes(data[: int(share * len(data))])
        assert "cut short" in refused(tmp_path, "video").reason


def test_a_jpeg_whose_markers_are_filled_up_is_whole(tmp_path):
    data = cv2.imencode(".jpg", np.zeros((48, 64, 3), np.uint8))[1].tobytes()
    (tmp_path / "0.jpg").write_bytes(data[:2] + b"\xff\xff" + data[2:])
    assert read_clip(tmp_path).size == (64, 48)


def test_a_jpeg_that_ends_early_is_refused(tmp_path):
    picture = noise(1, (64, 64))[0].permute(1, 2, 0).numpy()
    data = cv2.imencode(".jpg", picture)[1].tobytes()
    damaged(tmp_path / "0.jpg", data)
    assert read_clip(tmp_path).size == (64, 64)
    damaged(tmp_path / "0.jpg", data[: len(data) // 2])
    assert "cut short" in refused(tmp_path, "video").reason


def test_missing_files_and_empty_folders_are_named(tmp_path):
    refused(tmp_path / "none.mp4", "", "no such file")
    refused(tmp_path, "images", "found none")


@pytest.mark.needs("video/lp_s20.mp4", "video/intel_asl_walk.mkv", "video/sintel_alley")
def test_real_clips_are_read_whole():
    counts = {"lp_s20.mp4": 297, "intel_asl_walk.mkv": 89, "sintel_alley": 6}
    for name, count in counts.items():
        assert len(read_clip(VIDEOS / name, max_side=96)) == count


def test_a_clip_that_takes_more_than_the_limit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = torch.zeros(4, 3, 8, 8, dtype=torch.uint8)
    write_video(tmp_path / "a.mkv", frames, torch.arange(4.0), lossless=True)
    monkeypatch.setattr(part, "BYTE_LIMIT", 700)
    with pytest.raises(InputError, match="the limit is 700"):
        read_clip(tmp_path / "a.mkv")
