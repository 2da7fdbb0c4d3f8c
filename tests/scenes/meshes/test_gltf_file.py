from __future__ import annotations

import pytest

from cltransfer.scenes import asset_files
from cltransfer.scenes.asset_files import Beside
from cltransfer.scenes.gltf_file import read_gltf


@pytest.fixture
def opened(monkeypatch):
    """Names of the files that were read."""
    names: list[str] = []
    read = asset_files.read_limited
    monkeypatch.setattr(asset_files, "read_limited", lambda path, *most: names.append(path.name) or read(path, *most))
    return names


def test_a_file_of_many_buffers_is_read_once_and_no_longer_than_it_is_to_be(bar, write_gltf, tmp_path, opened):
    tree, blob = bar()
    (tmp_path / "big.bin").write_bytes(blob + bytes(1000))
    path = write_gltf(tmp_path / "bar.gltf", tree, blob, "big.bin")
    text = path.read_text()
    buffer = text[text.index('"buffers": [') + 12 : -2]
    more = "".join(f", {buffer.replace('big.bin', name)}" for name in ("big.bin", "./big.bin", "%62ig.bin"))
    path.write_text(text.replace(buffer, buffer + more))
    gltf = read_gltf(path, Beside(path))
    assert [len(data) for data in gltf.buffers] == [len(blob)] * 4
    assert opened == ["big.bin"]
    assert len(gltf.to_glb()) < 4 * len(blob) + 5000


def test_an_image_that_is_named_is_looked_for_but_not_read(bar, write_gltf, tmp_path, opened):
    tree, blob = bar()
    tree["images"] = [{"uri": "normals.png"}]
    (tmp_path / "normals.png").write_bytes(b"not looked at")
    path = write_gltf(tmp_path / "bar.gltf", tree, blob)
    files = Beside(path)
    read_gltf(path, files)
    assert (files.given, opened) == ([tmp_path / "normals.png"], [])
