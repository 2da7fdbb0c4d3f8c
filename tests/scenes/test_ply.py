"""Reading splats: good files to the last bit of their format, bad ones with one line that names file and field."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.camera import Camera
from cltransfer.errors import InputError
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene, columns, ply_header
from cltransfer.scenes.columns import MIN_SCALE, needed_bytes
from cltransfer.scenes.ply import read_splats, write_splats
from cltransfer.scenes.splats import Splats

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "splat"
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


def compressed(
    words: list[tuple[int, int, int, int]], colors: bool = True, harmonics: list[list[int]] | None = None
) -> bytes:
    """One chunk: position in [-1, 3], log scale in [-4, 0], colour in [0, 2]."""
    axes = [f"{end}_{axis}" for end in ("min", "max") for axis in "xyz"]
    axes += [f"{end}_scale_{axis}" for end in ("min", "max") for axis in "xyz"]
    values = [-1.0] * 3 + [3.0] * 3 + [-4.0] * 3 + [0.0] * 3
    if colors:
        axes += [f"{end}_{channel}" for end in ("min", "max") for channel in "rgb"]
        values += [0.0] * 3 + [2.0] * 3
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "element chunk 1",
        *(f"property float {a}" for a in axes),
    ]
    lines += [f"element vertex {len(words)}"]
    lines += [f"property uint packed_{part}" for part in ("position", "rotation", "scale", "color")]
    tail = b""
    if harmonics is not None:
        lines += [
            f"element sh {len(harmonics)}",
            *(f"property uchar f_rest_{i}" for i in range(len(harmonics[0]))),
        ]
        tail = np.array(harmonics, np.uint8).tobytes()
    header = "\n".join([*lines, "end_header", ""]).encode()
    return header + np.array(values, "<f4").tobytes() + np.array(words, "<u4").tobytes() + tail


def read(tmp_path: Path, data: bytes) -> Splats:
    path = tmp_path / "scene.ply"
    path.write_bytes(data)
    return read_splats(path)


def test_only_the_columns_of_the_compressed_layout_are_kept(tmp_path, monkeypatch):
    plain = compressed([(7, 8, 9, 255)] * 3, harmonics=[[130] * 9] * 3)
    wide = plain.replace(b"end_header\n", b"element junk 5\nproperty double a\nend_header\n") + bytes(40)
    wide = wide.replace(b"packed_color\n", b"packed_color\n" + b"".join(b"property double p%d\n" % i for i in range(9)))
    start = wide.index(b"end_header\n") + 11 + 18 * 4
    rows = [wide[at : at + 16] for at in range(start, start + 48, 16)]
    wide = wide[:start] + b"".join(row + bytes(72) for row in rows) + wide[start + 48 :]
    read_rows, asked = ply_header.read_rows, []
    monkeypatch.setattr(ply_header, "read_rows", lambda *a: asked.append(a[2:]) or read_rows(*a))
    monkeypatch.setattr(ply_header, "BLOCK", 2)
    got, expected = read(tmp_path, wide), read(tmp_path, plain)
    for name in ("means", "scales", "quats", "opacity", "sh"):
        assert torch.equal(getattr(got, name), getattr(expected, name))
    assert asked[:5] == [("vertex", 0, 2), ("vertex", 2, 2), ("chunk", 0, 2), ("sh", 0, 2), ("sh", 2, 2)]


def test_the_compressed_layout_is_held_against_the_memory_as_it_is_stored(tmp_path, monkeypatch):
    data = compressed([(7, 8, 9, 255)] * 200, harmonics=[[130] * 9] * 200)
    stored = 200 * (16 + 9) + 18 * 4
    monkeypatch.setattr(columns, "free_bytes", lambda: needed_bytes(200, 1) + stored)
    assert read(tmp_path, data).degree == 1
    monkeypatch.setattr(columns, "free_bytes", lambda: needed_bytes(200, 1) + stored - 1)
    assert read(tmp_path, data).degree == 0


def test_the_trained_layout_is_decoded(tmp_path):
    got = read(tmp_path, trained([GOOD_ROW]))
    assert got.means.tolist() == [[1, 2, 3]]
    assert got.scales[0].tolist() == pytest.approx([math.exp(-3), math.exp(-2), math.exp(-1)])
    assert got.quats.tolist() == [[1, 0, 0, 0]]
    assert got.opacity.tolist() == pytest.approx([1 / (1 + math.exp(-0.5))])
    assert got.sh[0, 0].tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert got.label.tolist() == [0]
    assert all(getattr(got, n).dtype == torch.float32 for n in ("means", "scales", "quats", "opacity", "sh", "label"))


def test_the_filter_that_gaussians_were_trained_under_makes_them_wider_and_thinner(tmp_path):
    plain = read(tmp_path, trained([GOOD_ROW]))
    for width in (0.0, 0.2):
        found = read(tmp_path, trained([(*GOOD_ROW, width)], (*NAMES, "filter_3D")))
        wider = (plain.scales**2 + width**2).sqrt()
        torch.testing.assert_close(found.scales, wider)
        torch.testing.assert_close(found.opacity * wider.prod(1), plain.opacity * plain.scales.prod(1))
    refused = trained([(*GOOD_ROW, math.nan)], (*NAMES, "filter_3D"))
    with pytest.raises(InputError, match="not finite"):
        read(tmp_path, refused)


def test_properties_are_found_by_name_in_any_order_among_others(tmp_path):
    names, row = ("nx", *reversed(NAMES), "confidence"), (9.0, *reversed(GOOD_ROW), 9.0)
    assert torch.equal(read(tmp_path, trained([row], names)).means, torch.tensor([[1.0, 2, 3]]))
    assert torch.equal(read(tmp_path, trained([row], names, "double")).means, torch.tensor([[1.0, 2, 3]]))


@pytest.mark.parametrize(("degree", "rest"), [(1, 9), (2, 24), (3, 45)])
def test_harmonics_are_stored_channel_by_channel(tmp_path, degree, rest):
    names = (*NAMES, *(f"f_rest_{i}" for i in range(rest)))
    got = read(tmp_path, trained([(*GOOD_ROW, *range(rest))], names))
    assert got.degree == degree
    assert got.sh[0, 1:].T.reshape(-1).tolist() == list(range(rest))


def test_of_harmonics_of_degree_4_the_first_three_degrees_are_read_and_that_is_told(tmp_path, caplog):
    names = (*NAMES, *(f"f_rest_{i}" for i in range(72)))
    got = read(tmp_path, trained([(*GOOD_ROW, *range(72))], names))
    assert got.degree == 3
    assert got.sh[0, 1:].T.tolist() == [[*range(first, first + 15)] for first in (0, 24, 48)]
    told = "harmonics of degree 4 are left out, those of degree 0 to 3 are read"
    assert caplog.messages == [f"{tmp_path / 'scene.ply'}: {told}"]


def test_gaussians_of_two_scales_are_flat_across_their_third_axis(tmp_path):
    names = tuple(name for name in NAMES if name != "scale_2")
    row = (*GOOD_ROW[:9], *GOOD_ROW[10:])
    got, plain = read(tmp_path, trained([row] * 2, names)), read(tmp_path, trained([GOOD_ROW]))
    assert got.scales.tolist() == [[*plain.scales[0, :2].tolist(), pytest.approx(MIN_SCALE)]] * 2
    for name in ("means", "quats", "opacity", "sh"):
        assert torch.equal(getattr(got, name)[:1], getattr(plain, name))
    wider = read(tmp_path, trained([(*row, 0.2)], (*names, "filter_3D")))
    assert wider.scales[0].tolist() == pytest.approx([*(plain.scales[0, :2] ** 2 + 0.04).sqrt().tolist(), MIN_SCALE])
    assert float(wider.opacity / plain.opacity) == pytest.approx(
        float((plain.scales[0, :2] / wider.scales[0, :2]).prod())
    )


@pytest.mark.parametrize("missing", ["scale_0", "scale_1"])
def test_gaussians_without_another_scale_are_refused(tmp_path, missing):
    names = tuple(name for name in NAMES if name != missing)
    with pytest.raises(InputError, match=f"property {missing}: is missing"):
        read(tmp_path, trained([GOOD_ROW[1:]], names))


def test_a_flat_gaussian_is_drawn(tmp_path):
    names = tuple(name for name in NAMES if name != "scale_2")
    row = (0.0, 0.0, 4.0, *GOOD_ROW[3:6], 5.0, -1.0, -1.0, *GOOD_ROW[10:])
    scene = Scene(read(tmp_path, trained([row], names)), None, torch.tensor([0.0, -1, 0]), "disc", "0" * 64)
    camera = Camera(torch.eye(4)[None], torch.tensor([[[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]]), (40, 40))
    alpha = GaussianSplats(threads=1).render(scene, camera, frozenset({"alpha"})).alpha
    assert float(alpha[0, 20, 20]) > 0.9
    assert float(alpha[0, 0, 0]) < 0.01


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_what_is_written_is_read_back(tmp_path, degree):
    room = synthetic_room(500, degree=degree)
    write_splats(tmp_path / "room.ply", room)
    got = read_splats(tmp_path / "room.ply")
    for name in ("means", "scales", "quats", "opacity", "sh"):
        torch.testing.assert_close(getattr(got, name), getattr(room, name), rtol=1e-5, atol=1e-6)
    assert list(tmp_path.iterdir()) == [tmp_path / "room.ply"]


def test_fully_opaque_and_fully_clear_gaussians_can_be_written(tmp_path):
    room = replace(synthetic_room(200), opacity=torch.tensor([0.0, 1.0]).repeat(100))
    write_splats(tmp_path / "room.ply", room)
    got = read_splats(tmp_path / "room.ply")
    torch.testing.assert_close(got.opacity, room.opacity, atol=1e-6, rtol=0)


def test_the_compressed_layout_is_decoded(tmp_path):
    position = 2047 << 21 | 0 << 11 | 1024  # x at its greatest, y at its least, z at 1024 / 2047
    rotation = 2 << 30 | 1023 << 20 | 512 << 10 | 0  # y is largest; w, x, z follow
    scale = 0 << 21 | 1023 << 11 | 2047
    color = 255 << 24 | 0 << 16 | 51 << 8 | 204
    got = read(tmp_path, compressed([(position, rotation, scale, color)]))
    assert got.means[0].tolist() == pytest.approx([3, -1, -1 + 4 * 1024 / 2047])
    assert got.scales[0].tolist() == pytest.approx([math.exp(-4), 1, 1])
    w, x, z = (value * math.sqrt(0.5) for value in (1, 1024 / 1023 - 1, -1))
    y = math.sqrt(max(0, 1 - w * w - x * x - z * z))
    assert got.quats[0].tolist() == pytest.approx([w, x, y, z], abs=1e-3)
    rgb = got.sh[0, 0] * 0.28209479177387814 + 0.5
    assert rgb.tolist() == pytest.approx([2, 0, 0.4], abs=1e-6)
    assert got.opacity.tolist() == pytest.approx([0.8])
    plain = read(tmp_path, compressed([(position, rotation, scale, color)], colors=False))
    assert (plain.sh[0, 0] * 0.28209479177387814 + 0.5).tolist() == pytest.approx([1, 0, 0.2], abs=1e-6)


def test_each_component_of_a_compressed_rotation_can_be_the_largest(tmp_path):
    middle = 511.5
    for largest in range(4):
        word = largest << 30 | 700 << 20 | 300 << 10 | 512
        got = read(tmp_path, compressed([(0, word, 0, 255)])).quats[0].tolist()
        small = [(value - middle) / middle * math.sqrt(0.5) for value in (700, 300, 512)]
        small.insert(largest, math.sqrt(1 - sum(v * v for v in small)))
        assert got == pytest.approx(small, abs=1e-5)


def test_compressed_harmonics_are_decoded(tmp_path):
    got = read(tmp_path, compressed([(0, 0, 0, 255)], harmonics=[[0, 255, 51, 0, 0, 0, 255, 255, 255]]))
    assert got.degree == 1
    assert got.sh[0, 1:].T.tolist()[0] == pytest.approx([-4, 4, -2.4], abs=1e-6)
    assert got.sh[0, 1:].T.tolist()[2] == pytest.approx([4, 4, 4])


@pytest.mark.parametrize("count", [1, 9])
def test_columns_that_a_compressed_file_has_beyond_its_layout_are_no_harmonics(tmp_path, count):
    stray = b"".join(b"property float f_rest_%d\n" % i for i in range(count))
    data = compressed([(0, 0, 0, 255)])
    color = b"property uint packed_color\n"
    assert data.count(color) == 1
    got = read(tmp_path, data.replace(color, color + stray) + bytes(4 * count))
    assert (len(got), got.degree) == (1, 0)


PACKED = compressed([(0, 0, 0, 255)] * 4)
BAD_PACKED = {
    "packed without chunks": (PACKED.replace(b"element chunk", b"element chonk"), "element chunk"),
    "packed with a float": (
        PACKED.replace(b"uint packed_color", b"float packed_color"),
        "property packed_color",
    ),
    "packed without a column": (PACKED.replace(b"packed_scale", b"packed_scole"), "property packed_scale"),
    "packed without a range": (PACKED.replace(b"max_scale_y", b"max_scole_y"), "property max_scale_y"),
    "packed with too few chunks": (compressed([(0, 0, 0, 255)] * 257), "element chunk"),
    "packed with too few harmonics": (compressed([(0, 0, 0, 255)] * 2, harmonics=[[0] * 9]), "element sh"),
}


@pytest.mark.parametrize("kind", BAD_PACKED)
def test_a_bad_compressed_file_names_file_and_field(tmp_path, kind):
    data, field = BAD_PACKED[kind]
    with pytest.raises(InputError) as caught:
        read(tmp_path, data)
    assert str(caught.value).startswith(f"{tmp_path / 'scene.ply'}: {field}: ")


def broken_rows(bad: int, good: int, column: int, value: float) -> list[tuple[float, ...]]:
    row = list(GOOD_ROW)
    row[column] = value
    return [GOOD_ROW] * 7 + [tuple(row)] * bad + [GOOD_ROW] * (good - 7)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("column", range(14))
def test_a_value_that_is_not_finite_is_left_out_and_counted(tmp_path, caplog, column, value):
    usable = value == value if column == 6 else 7 <= column <= 9 and value < 0
    if not usable:
        got = read(tmp_path, trained(broken_rows(1, 199, column, value)))
        assert len(got) == 199
        assert [": 1 of 200 Gaussians are left out, " in line for line in caplog.messages] == [True]
        with pytest.raises(InputError, match=r"in Gaussian 7; 3 of 202 are unusable"):
            read(tmp_path, trained(broken_rows(3, 199, column, value)))
    else:  # an infinite logit is opacity 0 or 1, a scale of e^-inf is a flat Gaussian
        got = read(tmp_path, trained(broken_rows(1, 199, column, value)))
        assert (len(got), caplog.messages) == (200, [])
        assert got.opacity.isfinite().all()
        assert (got.scales > 0).all()


def test_overflowing_scales_and_zero_rotations_are_left_out_and_huge_opacities_are_not(tmp_path):
    zero = (*GOOD_ROW[:10], 0.0, 0.0, 0.0, 0.0)
    assert len(read(tmp_path, trained([GOOD_ROW] * 150 + [zero]))) == 150
    for scale in (25.0, 100.0, 1e30):
        assert len(read(tmp_path, trained(broken_rows(1, 150, 8, scale)))) == 150
    for logit, opacity in ((1e30, 1.0), (-1e30, 0.0)):
        assert float(read(tmp_path, trained(broken_rows(1, 150, 6, logit))).opacity[7]) == opacity


@pytest.mark.parametrize("column", [0, 1, 2])
def test_places_far_beyond_any_scene_are_left_out(tmp_path, column):
    for place, kept in ((1e9, 151), (-1e9, 151), (1.1e9, 150), (-3.4e38, 150)):
        assert len(read(tmp_path, trained(broken_rows(1, 150, column, place)))) == kept


def test_little_endian_on_the_label_but_not_in_the_file_is_refused(tmp_path):
    rng = np.random.default_rng(0)
    rows = rng.normal(0, 2, (2000, 14)).astype(">f4")
    header = trained([GOOD_ROW] * 2000).split(b"end_header\n")[0] + b"end_header\n"
    with pytest.raises(InputError, match="unusable"):
        read(tmp_path, header + rows.tobytes())


def data_file(name: str) -> Path:
    if not (DATA / name).exists():
        pytest.skip(f"{name} is not in {DATA}")
    return DATA / name


def test_the_scanned_man_is_the_same_in_both_layouts():
    packed, scene = (
        read_splats(data_file("biker.compressed.ply")),
        read_splats(data_file("biker_on_lawn.ply")),
    )
    man = slice(0, 152_746)
    torch.testing.assert_close(packed.opacity, scene.opacity[man], atol=5e-3, rtol=0)
    torch.testing.assert_close(packed.sh[:, 0], scene.sh[man, 0], atol=1e-3, rtol=0)
    ratio = scene.scales[man] / packed.scales  # the scene was composed by a similarity
    torch.testing.assert_close(ratio, torch.full_like(ratio, float(ratio.median())), rtol=1e-3, atol=0)


def test_the_scanned_man_stands_upright_where_he_should():
    splats = read_splats(data_file("biker_on_lawn.ply"))
    label = torch.zeros(len(splats))
    label[:152_746] = 1
    scene = Scene(splats.with_label(label), None, torch.tensor([0.0, -1, 0]), "biker", "0" * 64)
    camera = Camera.look_at(torch.tensor([[-4.0, -0.9, 0]]), torch.tensor([[0.0, -0.9, 0]]), scene.up, 0.9, (96, 96))
    got = GaussianSplats().render(scene, camera, frozenset({"label", "depth"}))
    rows = torch.nonzero((got.label[0] > 0.5).any(1))[:, 0]
    height = float(rows.max() - rows.min() + 1) * 4 / float(camera.focal)
    assert height == pytest.approx(1.8, abs=0.1)
    assert float(got.depth[0, 48, 48]) == pytest.approx(4.0, abs=0.35)


def test_the_robot_changes_colour_with_the_view():
    splats = read_splats(data_file("playbot_lod3_sh.ply"))
    assert splats.degree == 2
    scene = Scene(splats, None, torch.tensor([0.0, -1, 0]), "robot", "0" * 64)
    plain = replace(scene, geometry=replace(splats, sh=splats.sh[:, :1]))
    camera = Camera.look_at(torch.tensor([[-2.0, -0.8, 0]]), torch.tensor([[0.0, -0.4, 0]]), scene.up, 0.9, (96, 54))
    images = [GaussianSplats().render(s, camera, frozenset({"image"})).image for s in (scene, plain)]
    assert float((images[0] - images[1]).abs().max()) > 0.05


def test_a_damaged_range_of_a_chunk_is_an_error_without_warnings(tmp_path, recwarn):
    data = compressed([(0, 0, 0, 255)] * 4)
    start = data.index(b"end_header\n") + 11
    for value in (math.nan, math.inf):
        damaged = data[:start] + np.float32(value).tobytes() + data[start + 4 :]
        with pytest.raises(InputError, match="property x, y, z: not finite"):
            read(tmp_path, damaged)
    assert len(recwarn) == 0
