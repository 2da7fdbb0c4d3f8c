"""Files packed here by the format's own rules read back as the Gaussians they were packed of."""

from __future__ import annotations

import gzip
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import torch

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.errors import InputError, ResourceError
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene, columns, spz
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.splats import Splats
from cltransfer.scenes.spz import read_spz

MAGIC = 0x5053474E


def header(version: int, count: int, degree: int, flags: int = 0, magic: int = MAGIC) -> bytes:
    return struct.pack("<IIIBBBB", magic, version, count, degree, 12, flags, 0)


def packed(splats: Splats, version: int) -> bytes:
    """The stream before compression; y up and z backward."""
    turn = torch.tensor([1.0, -1, -1])
    fixed = (splats.means * turn * 4096).round().int().numpy().astype("<i4")
    means = fixed.view(np.uint8).reshape(-1, 4)[:, :3]
    byte = lambda values: values.round().clamp(0, 255).byte().numpy()  # noqa: E731
    quats = splats.quats * torch.tensor([1.0, 1, -1, -1])
    turned = [1, 2, 4, 7, 9, 11, 12, 14]  # harmonics odd in half a turn about x
    rest = splats.sh[:, 1:].clone()
    rest[:, [k - 1 for k in turned if k <= rest.shape[1]]] *= -1
    parts = [
        means,
        byte(splats.opacity * 255),
        byte((splats.sh[:, 0] * 0.15 + 0.5) * 255),
        byte((splats.scales.log() + 10) * 16),
        first_three(quats) if version == 2 else smallest_three(quats),
        byte(rest * 128 + 128),
    ]
    return header(version, len(splats), splats.degree) + b"".join(part.tobytes() for part in parts)


def first_three(quats: torch.Tensor) -> np.ndarray:
    upper = quats * torch.where(quats[:, :1] < 0, -1, 1)
    return ((upper[:, 1:] + 1) * 127.5).round().clamp(0, 255).byte().numpy()


def smallest_three(quats: torch.Tensor) -> np.ndarray:
    words = []
    for w, x, y, z in quats.double().tolist():
        xyzw = [x, y, z, w]
        largest = max(range(4), key=lambda i: abs(xyzw[i]))
        sign = -1 if xyzw[largest] < 0 else 1
        word = largest
        for i, value in enumerate(xyzw):
            if i != largest:
                word = word << 10 | (sign * value < 0) << 9 | round(511 * abs(value) * 2**0.5)
        words.append(word)
    return np.array(words, "<u4")


def written(folder: Path, stream: bytes) -> Path:
    (folder / "room.spz").write_bytes(gzip.compress(stream))
    return folder / "room.spz"


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_what_is_packed_is_read_back_as_finely_as_it_is_stored(tmp_path, version, degree):
    room = synthetic_room(400, degree=degree)
    got = read_spz(written(tmp_path, packed(room, version)))
    assert got.degree == degree
    torch.testing.assert_close(got.means, room.means, atol=1 / 8192 + 1e-6, rtol=0)
    torch.testing.assert_close(got.scales.log(), room.scales.log(), atol=1 / 32 + 1e-5, rtol=0)
    torch.testing.assert_close(got.opacity, room.opacity, atol=0.5 / 255 + 1e-6, rtol=0)
    torch.testing.assert_close(got.sh[:, 0], room.sh[:, 0], atol=0.5 / 255 / 0.15 + 1e-5, rtol=0)
    torch.testing.assert_close(got.sh[:, 1:], room.sh[:, 1:], atol=1 / 256 + 1e-6, rtol=0)
    same = (got.quats * room.quats).sum(1).abs()
    assert float(same.min()) > (0.99 if version == 2 else 0.99999)  # w of version 2 is what is left


def test_harmonics_are_turned_with_the_axes(tmp_path):
    """Seen from anywhere, colours are those of the scene before it was turned and packed."""
    room = synthetic_room(800, seed=3)
    sh = torch.where(torch.arange(16)[:, None] > 0, room.sh * 4, room.sh).clamp(-0.9, 0.9)
    room = Splats(room.means, room.scales, room.quats, room.opacity, sh, room.label)
    got = read_spz(written(tmp_path, packed(room, 3)))
    cameras = room_cameras(2, (48, 32))
    images = [
        GaussianSplats().render(Scene(s, None, torch.tensor([0.0, 0, 1]), "", ""), cameras, frozenset({"image"})).image
        for s in (room, got)
    ]
    assert float(((images[0] - images[1]) ** 2).mean()) < 1e-4


def test_it_loads_as_a_scene_that_stands_like_any_splats(tmp_path):
    scene = load_scene(written(tmp_path, packed(synthetic_room(200), 3)))
    assert len(scene.geometry) == 200
    assert scene.up.tolist() == [0, -1, 0]


def test_only_the_harmonics_that_fit_are_kept(tmp_path, monkeypatch):
    room = synthetic_room(300)
    path = written(tmp_path, packed(room, 3))
    whole = read_spz(path)
    stored = 300 * 65
    monkeypatch.setattr(columns, "free_bytes", lambda: stored + columns.needed_bytes(300, 1))
    assert torch.equal(read_spz(path).sh, whole.sh[:, :4])
    monkeypatch.setattr(columns, "free_bytes", lambda: 0)
    with pytest.raises(ResourceError, match="300 Gaussians need"):
        read_spz(path)


@pytest.mark.parametrize("kept", [0, 1, 3])
def test_reading_takes_no_more_memory_than_is_asked_for(tmp_path, monkeypatch, kept):
    count = 20_000
    noise = np.random.default_rng(0).integers(0, 256, 64 * count, np.uint8)
    path = written(tmp_path, header(2, count, 3) + noise.tobytes())
    asked = []
    monkeypatch.setattr(spz, "affordable_degree", lambda path, count, degree, stored=0: asked.append(stored) or kept)
    tracemalloc.start()
    assert read_spz(path).degree == kept
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most <= columns.needed_bytes(count, kept) - columns.RESERVE + asked[0]


@pytest.mark.parametrize(
    ("stream", "says"),
    [
        (b"", "header: cut off"),
        (header(3, 1, 0)[:9], "header: cut off"),
        (header(3, 1, 0, magic=7), "magic: expected 0x5053474e, got 0x7"),
        (header(1, 1, 0), r"version 1 is not read \(convert it: splat-transform room.spz room.ply\)"),
        (header(9, 1, 0), "version 9 is not read"),
        (header(3, 1, 0, flags=2), "extensions are not read"),
        (header(3, 0, 0), "expected 1 to 20000000 Gaussians, got 0"),
        (header(3, 2**32 - 1, 0), "expected 1 to 20000000 Gaussians"),
        (header(3, 1, 4), "expected degree 0 to 3"),
        (header(3, 2, 0) + bytes(20), "body: expected 40 bytes, got 20"),
        (header(3, 1, 0) + bytes(21), "body: expected 20 bytes, got more than 20"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, stream, says):
    with pytest.raises(InputError, match=says):
        read_spz(written(tmp_path, stream))


def test_a_name_in_a_command_to_copy_is_quoted(tmp_path):
    path = written(tmp_path, header(1, 1, 0)).rename(tmp_path / "`room`.spz")
    with pytest.raises(InputError) as caught:
        read_spz(path)
    assert str(caught.value).endswith("(convert it: splat-transform '`room`.spz' '`room`.ply')")


def test_a_stream_that_grows_beyond_its_header_is_not_unpacked(tmp_path):
    path = written(tmp_path, header(3, 1, 0) + bytes(30 * 2**20))  # 30 kB on disk
    assert path.stat().st_size < 2**17
    with pytest.raises(InputError, match="got more than 20"):
        read_spz(path)


def test_of_a_file_no_more_is_read_than_its_header_says(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, 2**23, np.uint8)
    path = written(tmp_path, header(3, 1, 0) + noise.tobytes())
    assert path.stat().st_size > 2**23
    tracemalloc.start()
    with pytest.raises(InputError, match="got more than 20"):
        read_spz(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2**21


def test_a_file_that_is_cut_off_is_refused(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, 20 * 50_000, np.uint8)
    path = written(tmp_path, header(3, 50_000, 0) + noise.tobytes())
    path.write_bytes(path.read_bytes()[:600_000])
    with pytest.raises(InputError, match=r"body: expected 1000000 bytes, got 599\d\d\d"):
        read_spz(path)


def test_what_is_no_gzip_is_refused(tmp_path):
    (tmp_path / "room.spz").write_bytes(b"NGSP" + bytes(60))
    with pytest.raises(InputError, match="not readable as gzip"):
        read_spz(tmp_path / "room.spz")
    with pytest.raises(InputError, match="no such file"):
        read_spz(tmp_path / "none.spz")
