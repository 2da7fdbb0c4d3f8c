"""Files that are not what they say: one line that names file and field, within a second."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cltransfer.errors import InputError
from cltransfer.scenes.ply import read_splats
from cltransfer.scenes.splats import Splats

NAMES = (
    "x",
    "y",
    "z",
    "f_dc_0",
    "f_dc_1",
    "f_dc_2",
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
)
GOOD_ROW = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.5, -3.0, -2.0, -1.0, 2.0, 0.0, 0.0, 0.0)


def trained(rows: list[tuple[float, ...]], names: tuple[str, ...] = NAMES, kind: str = "float") -> bytes:
    header = [f"property {kind} {name}" for name in names]
    text = "\n".join(
        ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}", *header, "end_header", ""]
    )
    return text.encode() + np.array(rows, "<f8" if kind == "double" else "<f4").tobytes()


def read(tmp_path: Path, data: bytes) -> Splats:
    path = tmp_path / "scene.ply"
    path.write_bytes(data)
    return read_splats(path)


GOOD = trained([GOOD_ROW] * 4)


def without(data: bytes, name: str) -> bytes:
    names = tuple(n for n in NAMES if n != name)
    return trained([GOOD_ROW[: len(names)]] * 4, names)


BAD = {
    "empty": (b"", "header"),
    "only magic": (b"ply\n", "header"),
    "cut header": (GOOD[:100], "header"),
    "no magic": (b"PK\x03\x04" + GOOD, "magic"),
    "text": (b"hello world\n" * 100, "magic"),
    "crlf": (
        GOOD[: GOOD.index(b"end_header")].replace(b"\n", b"\r\n") + b"end_header\r\n" + GOOD[-56 * 4 :],
        "header",
    ),
    "body cut in half": (GOOD[:-112], "body"),
    "one byte short": (GOOD[:-1], "body"),
    "trailing bytes": (GOOD + b"\0", "body"),
    "count negative": (GOOD.replace(b"vertex 4", b"vertex -5"), "element vertex"),
    "count huge": (GOOD.replace(b"vertex 4", b"vertex 1000000000000"), "element vertex"),
    "count beyond any integer": (GOOD.replace(b"vertex 4", b"vertex " + b"9" * 5000), "element vertex"),
    "count below the limit and far above the file": (GOOD.replace(b"vertex 4", b"vertex 19999999"), "body"),
    "count not a number": (GOOD.replace(b"vertex 4", b"vertex many"), "element vertex"),
    "count zero": (trained([]), "element vertex"),
    "unknown type": (GOOD.replace(b"float opacity", b"quark opacity"), "property opacity"),
    "integer type": (GOOD.replace(b"float opacity", b"int opacity"), "property opacity"),
    "duplicate property": (GOOD.replace(b"float opacity", b"float x"), "property x"),
    "duplicate element": (GOOD.replace(b"end_header", b"element vertex 1\nend_header"), "element vertex"),
    "list": (
        GOOD.replace(b"end_header", b"element face 1\nproperty list uchar int vertex_indices\nend_header"),
        "element face",
    ),
    "points": (trained([(0.0, 0.0, 0.0)] * 3, ("x", "y", "z")), "element vertex"),
    "no vertex": (GOOD.replace(b"element vertex", b"element vortex"), "element vertex"),
    "big endian": (GOOD.replace(b"little", b"big"), "format"),
    "ascii": (GOOD.replace(b"binary_little_endian", b"ascii"), "format"),
    "no format": (GOOD.replace(b"format binary_little_endian 1.0\n", b""), "format"),
    "property before element": (
        GOOD.replace(b"element vertex", b"property float a\nelement vertex"),
        "property float a",
    ),
    "two million comments": (GOOD.replace(b"element", b"comment\n" * 2_000_000 + b"element"), "header"),
    "many properties": (trained([tuple([0.0] * 300)], tuple(f"p{i}" for i in range(300))), "property p256"),
    "binary header": (GOOD.replace(b"element", b"\xff\xfe element"), "header"),
    "unknown line": (GOOD.replace(b"element", b"surprise\nelement"), "header"),
    "odd harmonics": (trained([(*GOOD_ROW, 1.0)], (*NAMES, "f_rest_0")), "property f_rest"),
    "harmonics with a hole": (
        trained([(*GOOD_ROW, *[1.0] * 9)], (*NAMES, *(f"f_rest_{i}" for i in range(1, 10)))),
        "property f_rest_0",
    ),
    **{f"no {name}": (without(GOOD, name), f"property {name}") for name in NAMES if name != "scale_2"},
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_gives_one_line_that_names_file_and_field_within_a_second(tmp_path, kind):
    data, field = BAD[kind]
    (tmp_path / "scene.ply").write_bytes(data)
    start = time.process_time()
    with pytest.raises(InputError) as caught:
        read_splats(tmp_path / "scene.ply")
    assert time.process_time() - start < 1
    assert caught.value.field == field
    assert str(caught.value).startswith(f"{tmp_path / 'scene.ply'}: {field}: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(tmp_path))


@pytest.mark.parametrize("written", ["ascii 1.0", "binary_little_endian 1.0", "binary_big_endian 1.0"])
def test_points_are_told_to_be_no_splats_however_they_are_written(tmp_path, written):
    rows = "0 0 0 9\n1 0 0 9\n" if written == "ascii 1.0" else "\0" * 32
    columns = [f"property float {name}" for name in ("x", "y", "z", "i")]
    lines = ["ply", f"format {written}", "element vertex 2", *columns, "end_header", rows]
    (tmp_path / "scene.ply").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"expected splats or a mesh, got a point cloud, which is neither \(`"):
        read_splats(tmp_path / "scene.ply")


def test_splats_that_are_written_as_text_are_told_how_to_be_saved(tmp_path):
    data, _ = BAD["ascii"]
    with pytest.raises(InputError, match=r"got 'ascii 1\.0' \(save it as binary little endian\)$"):
        read(tmp_path, data)


def test_faces_of_which_there_are_none_are_no_fault(tmp_path):
    faces = b"element face 0\nproperty list uchar int vertex_indices\nend_header"
    (tmp_path / "scene.ply").write_bytes(GOOD.replace(b"end_header", faces))
    assert len(read_splats(tmp_path / "scene.ply")) == 4


@pytest.mark.parametrize("word", [b"comment", b"obj_info"])
@pytest.mark.parametrize(
    "text", ["café 東京".encode(), "café".encode("latin-1"), "a\u2028b\x85c\x0bd".encode(), b"\xff\xfe"]
)
def test_a_comment_may_hold_anything(tmp_path, word, text):
    assert len(read(tmp_path, GOOD.replace(b"element", word + b" " + text + b"\nelement"))) == 4


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    for path, reason in ((tmp_path / "no.ply", "no such file"), (tmp_path, "expected a file, got a folder")):
        with pytest.raises(InputError, match=reason):
            read_splats(path)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_a_damaged_file_is_read_or_refused_and_nothing_else(tmp_path_factory, data):
    damaged = bytearray(GOOD)
    for _ in range(data.draw(st.integers(1, 8))):
        damaged[data.draw(st.integers(0, len(GOOD) - 1))] = data.draw(st.integers(0, 255))
    try:
        read(tmp_path_factory.mktemp("damaged"), bytes(damaged))
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - reading it well is as good
