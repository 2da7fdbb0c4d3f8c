from __future__ import annotations

import struct
from pathlib import Path

import pytest
import torch

from cltransfer.errors import InputError
from cltransfer.scenes.dot_splat import read_dot_splat
from cltransfer.scenes.load import load_scene

RECORD = struct.pack("<6f8B", 1, 2, 3, 0.1, 0.2, 0.4, 255, 0, 51, 204, 128, 255, 128, 128)


def written(folder: Path, data: bytes) -> Path:
    (folder / "scene.splat").write_bytes(data)
    return folder / "scene.splat"


def test_a_record_of_32_bytes_is_decoded(tmp_path: Path) -> None:
    got = read_dot_splat(written(tmp_path, RECORD))
    assert got.means.tolist() == [[1, 2, 3]]
    assert got.scales[0].tolist() == pytest.approx([0.1, 0.2, 0.4])
    assert got.quats.tolist() == [[0, 1, 0, 0]]
    assert got.opacity.tolist() == pytest.approx([0.8])
    assert (got.sh[0, 0] * 0.28209479 + 0.5).tolist() == pytest.approx([1, 0, 0.2], abs=1e-6)
    assert all(getattr(got, n).dtype == torch.float32 for n in ("means", "scales", "quats", "opacity", "sh", "label"))


def test_it_loads_as_a_scene(tmp_path: Path) -> None:
    scene = load_scene(written(tmp_path, RECORD * 5))
    assert len(scene.geometry) == 5
    assert scene.up.tolist() == [0, -1, 0]


def test_what_is_not_finite_is_counted_and_too_much_of_it_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bad = struct.pack("<6f8B", float("nan"), 2, 3, 0.1, 0.2, 0.4, 255, 0, 51, 204, 128, 255, 128, 128)
    negative = struct.pack("<6f8B", 1, 2, 3, -0.1, 0.2, 0.4, 255, 0, 51, 204, 128, 255, 128, 128)
    assert len(read_dot_splat(written(tmp_path, RECORD * 300 + bad + negative))) == 300
    assert [": 2 of 302 Gaussians are left out, " in line for line in caplog.messages] == [True]
    with pytest.raises(InputError, match="x, y, z: not finite"):
        read_dot_splat(written(tmp_path, RECORD + bad))


@pytest.mark.parametrize("data", [b"", RECORD[:-1], RECORD + b"\0"])
def test_a_size_that_is_no_whole_number_of_records_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(InputError, match=rf"size: expected records of 32 bytes, got {len(data)} bytes"):
        read_dot_splat(written(tmp_path, data))


@pytest.mark.parametrize("suffix", [".sog", ".ksplat"])
def test_other_packed_formats_name_their_converter(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"lawn{suffix}"
    path.write_bytes(b"1")
    with pytest.raises(InputError, match=rf"is not read \(convert it: splat-transform lawn{suffix} lawn.ply\)"):
        load_scene(path)
    strange = path.rename(tmp_path / f"$(lawn) 1{suffix}")
    with pytest.raises(InputError) as caught:
        load_scene(strange)
    assert str(caught.value).endswith(f"(convert it: splat-transform '$(lawn) 1{suffix}' '$(lawn) 1.ply')")
