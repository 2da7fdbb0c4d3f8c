"""Splats that are larger than memory: fewer harmonics, told of, or refused with the need."""

from __future__ import annotations

import logging
import subprocess
import sys

import numpy as np
import pytest
import torch

from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.errors import ResourceError
from cltransfer.scenes import columns
from cltransfer.scenes.columns import affordable_degree, needed_bytes
from cltransfer.scenes.ply import read_splats, write_splats

NAMES = (
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"),
    *(f"f_rest_{i}" for i in range(45)),
    *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)


def header(count: int) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    return "\n".join([*lines, *(f"property float {name}" for name in NAMES), "end_header", ""]).encode()


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_only_the_harmonics_that_fit_are_read_and_the_log_says_so(tmp_path, monkeypatch, caplog, degree):
    room = synthetic_room(500)
    write_splats(tmp_path / "room.ply", room)
    monkeypatch.setattr(columns, "free_bytes", lambda: needed_bytes(500, degree))
    with caplog.at_level(logging.WARNING, "cltransfer"):
        got = read_splats(tmp_path / "room.ply")
    assert got.degree == degree
    torch.testing.assert_close(got.sh, room.sh[:, : (degree + 1) ** 2])
    (line,) = caplog.messages
    assert line.startswith(f"{tmp_path / 'room.ply'}: read with harmonics of degree {degree} of 3: all need ")
    assert "\n" not in line


def test_where_all_fits_nothing_is_said(tmp_path, monkeypatch, caplog):
    write_splats(tmp_path / "room.ply", synthetic_room(500))
    for free in (None, needed_bytes(500, 3)):
        monkeypatch.setattr(columns, "free_bytes", lambda free=free: free)
        assert read_splats(tmp_path / "room.ply").degree == 3
    assert caplog.messages == []


def test_a_gaussian_of_which_the_colour_would_overflow_is_left_out_and_told(tmp_path, caplog):
    room = synthetic_room(500)
    room.sh[7, 1:] = 3e38
    write_splats(tmp_path / "room.ply", room)
    got = read_splats(tmp_path / "room.ply")
    assert len(got) == 499
    told = "1 of 500 Gaussians are left out, not finite or out of range: f_dc, f_rest"
    assert caplog.messages == [f"{tmp_path / 'room.ply'}: {told}"]


def test_what_does_not_fit_at_all_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "huge.ply"
    with path.open("wb") as stream:  # takes no room on the disk
        stream.write(header(10_000_000))
        stream.truncate(stream.tell() + 10_000_000 * 4 * len(NAMES))
    monkeypatch.setattr(columns, "free_bytes", lambda: 2**30)
    with pytest.raises(ResourceError) as caught:
        read_splats(path)
    need = round(needed_bytes(10_000_000, 0) / 2**20)
    said = f"huge.ply: memory: 10000000 Gaussians need {need} MB without harmonics, 1024 MB are free"
    assert said in str(caught.value)
    assert caught.value.exit_code == 5


def test_the_command_line_says_it_in_one_line_on_stderr(command, tmp_path, monkeypatch):
    write_splats(tmp_path / "room.ply", synthetic_room(2000))
    monkeypatch.setenv("CLTRANSFER_MEMORY", "100")
    refused = command("lift", tmp_path / "room.ply", "--out", tmp_path / "lift")
    assert (refused.code, refused.err.count("\n")) == (5, 1)
    assert "Gaussians need" in refused.err


def test_a_need_grows_with_the_harmonics():
    assert [needed_bytes(10**6, d) - needed_bytes(0, d) for d in (0, 3)] == [234 * 10**6, 594 * 10**6]


def test_a_degree_that_fits_is_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(columns, "free_bytes", lambda: needed_bytes(10, 2))
    assert [affordable_degree(tmp_path, 10, degree) for degree in (0, 1, 2)] == [0, 1, 2]


_UNDER_A_CAP = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30,) * 2)
import torch
import cltransfer.transfer
from cltransfer.camera import Camera
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes.load import load_scene
scene = load_scene(sys.argv[1])
camera = Camera.look_at(torch.tensor([[0.0, 0, -8]]), torch.zeros(1, 3), scene.up, 0.8, (160, 90))
drawn = GaussianSplats().render(scene, camera, GaussianSplats.provides)
print(len(scene.geometry), scene.geometry.degree, float(drawn.alpha.mean()))
"""


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_ten_million_gaussians_are_drawn_under_a_cap_of_4_gb(tmp_path):
    path, random = tmp_path / "ten.ply", np.random.Generator(np.random.PCG64(0))
    with path.open("wb") as stream:
        stream.write(header(10_000_000))
        for _ in range(100):
            rows = random.normal(0, 0.1, (100_000, len(NAMES))).astype("<f4")
            rows[:, :3] = random.uniform(-3, 3, (100_000, 3))
            rows[:, -7:-4], rows[:, -4] = -5, 1
            stream.write(rows.tobytes())
    run = subprocess.run([sys.executable, "-c", _UNDER_A_CAP, str(path)], capture_output=True, text=True, check=True)
    count, degree, alpha = run.stdout.split()
    assert (count, degree) == ("10000000", "0")
    assert float(alpha) > 0.5
    assert "read with harmonics of degree 0 of 3" in run.stderr
