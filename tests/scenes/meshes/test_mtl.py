from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.mesh import GREY
from cltransfer.scenes.meshes.mtl import LIBRARY_LIMIT
from cltransfer.scenes.meshes.read_mesh import read_mesh

FACE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl dark wood\nf 1/1 2/2 3/3\n"


@pytest.fixture
def stage(tmp_path, image_file):
    """Writes stage.obj, whose one face shows the material "dark wood" of a library; wood.png is an image."""

    def write(library: str, face: str = FACE) -> Path:
        (tmp_path / "wood.png").write_bytes(image_file(np.full((4, 2, 3), 90, np.uint8)))
        (tmp_path / "none.png").write_bytes(b"no picture")
        (tmp_path / "stage.mtl").write_text(library)
        (tmp_path / "stage.obj").write_text("mtllib stage.mtl\n" + face)
        return tmp_path / "stage.obj"

    return write


@pytest.mark.parametrize("line", ["map_Kd none.png", "  MAP_KD   none.png "])
def test_an_image_that_cannot_be_opened_is_named(stage, line):
    path = stage(f"newmtl dark wood\nKd 1 0 0\n{line}\nnewmtl spare\nmap_Kd wood.png\n")
    said = r"stage.mtl: map_Kd: 'none.png' of material 'dark wood' cannot be decoded \(expected PNG, JPEG, WEBP\)"
    with pytest.raises(InputError, match=said):
        read_mesh(path)


def test_an_image_that_no_face_shows_may_be_none(stage):
    mesh = read_mesh(stage("newmtl dark wood\nmap_Kd wood.png\nnewmtl spare\nmap_Kd none.png\n")).mesh
    assert [image.shape for image in mesh.textures] == [(4, 2, 4)]
    mesh = read_mesh(stage("newmtl dark wood\nKd 1 0 0\nmap_Kd\nnewmtl spare\nmap_Kd none.png\n")).mesh
    assert (mesh.textures, mesh.colors.unique(dim=0).tolist()) == ((), [[1, 0, 0]])


def test_of_a_material_that_is_defined_twice_the_last_counts(stage):
    first, last = "newmtl dark wood\nmap_Kd none.png\n", "newmtl dark wood\nKd 1 0 0\n"
    mesh = read_mesh(stage(first + last)).mesh
    assert (mesh.textures, mesh.colors.unique(dim=0).tolist()) == ((), [[1, 0, 0]])
    with pytest.raises(InputError, match=r"'none\.png' of material 'dark wood'"):
        read_mesh(stage(last + first))


def test_where_no_face_has_a_place_in_an_image_none_is_asked_for(stage):
    bare = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl dark wood\nf 1 2 3\n"
    mesh = read_mesh(stage("newmtl dark wood\nKd 1 0 0\nmap_Kd none.png\n", bare)).mesh
    assert (mesh.textures, mesh.colors.unique(dim=0).tolist()) == ((), [[1, 0, 0]])


def test_an_image_of_opacity_is_told_where_it_is_passed_over(stage, caplog):
    leaf = "map_Kd wood.png\nmap_d wood.png\n"
    path = stage(f"newmtl spare\n{leaf}newmtl dark wood\nmap_Kd wood.png\n")
    read_mesh(path)
    assert caplog.messages == []  # no face shows it
    read_mesh(stage(f"newmtl dark wood\n{leaf}"))
    told = "map_d of material 'dark wood': images of opacity are not read, all of it is drawn"
    assert caplog.messages == [f"{path.with_suffix('.mtl')}: {told}"]


TINT = [pytest.approx(51 * level / 255) for level in (5, 1, 4)]


@pytest.mark.parametrize(
    ("said", "color"),
    [
        ("Kd 1 0.2 0.8", TINT),
        ("Kd 0 0 0", [1, 1, 1]),
        ("Kd 0.8 0.8 0.8", [1, 1, 1]),
        ("Kd 0.3 0.3 0.3", [1, 1, 1]),
        ("", [1, 1, 1]),
    ],
)
def test_a_hue_multiplies_the_image_and_a_grey_does_not(stage, said, color):
    mesh = read_mesh(stage(f"newmtl dark wood\n{said}\nmap_Kd wood.png\n")).mesh
    assert mesh.colors.unique(dim=0).tolist() == [color]
    assert mesh.texture.tolist() == [0]


@pytest.mark.parametrize("said", ["Ks 0 0 0", "Kd", "Kd spectral wood.rfl"])
def test_a_material_without_a_colour_is_as_grey_as_what_has_none(stage, said):
    mesh = read_mesh(stage(f"newmtl dark wood\n{said}\n")).mesh
    assert mesh.colors.unique().tolist() == [pytest.approx(GREY)]


@pytest.mark.parametrize(
    ("said", "color"),
    [
        ("Kd 0.2", [0.2] * 3),
        ("Kd 0", [0] * 3),
        ("Kd 0.2 0.4", [GREY] * 3),
        ("Kd 1 0.2 0 # rust", [1, 0.2, 0]),
        ("Kd 1 0 0 1 1", [1, 0, 0]),
        ("Ka 1\nKs 0.5\nNs 1 2\nKd 1 0 0", [1, 0, 0]),
    ],
)
def test_a_colour_of_other_than_three_numbers_costs_no_material(stage, said, color):
    solid = "usemtl solid\nf 1/1 3/3 2/2\n"
    mesh = read_mesh(stage(f"newmtl dark wood\n{said}\nnewmtl solid\nKd 0 1 0\n", FACE + solid)).mesh
    colors = torch.tensor([color, [0, 1, 0]]).unique(dim=0)
    torch.testing.assert_close(mesh.colors.unique(dim=0), colors.float())


def test_the_light_of_a_material_multiplies_its_image_grey_or_not(stage, caplog):
    mesh = read_mesh(stage("newmtl dark wood\nKd 0 0 0\nKe 0.4 0.4 0.4\nmap_Ke wood.png\n")).mesh
    assert mesh.colors.unique(dim=0).tolist() == [[pytest.approx(0.4)] * 3]
    assert caplog.messages == []


@pytest.mark.parametrize("grey", ["0 0 0", "0.8 0.8 0.8", "0.640000 0.640000 0.640000", "0.588235 0.588235 0.588235"])
def test_a_grey_beside_an_image_is_told_where_no_program_writes_it_by_habit(stage, caplog, grey):
    read_mesh(stage(f"newmtl dark wood\nKd {grey}\nmap_Kd wood.png\nnewmtl spare\nKd 0.3 0.3 0.3\nmap_Kd wood.png\n"))
    assert caplog.messages == []
    path = stage("newmtl dark wood\nKd 0.3 0.3 0.3\nmap_Kd wood.png\n")
    read_mesh(path)
    told = "Kd of material 'dark wood': a grey beside map_Kd is not read, its image is drawn as it is"
    assert caplog.messages == [f"{path.with_suffix('.mtl')}: {told}"]


def test_a_library_of_any_size_is_not_read(stage):
    path = stage("newmtl dark wood\nKd 1 0 0\n" + "#" * LIBRARY_LIMIT)
    with pytest.raises(InputError, match=rf"stage.mtl: expected at most {LIBRARY_LIMIT} bytes, got "):
        read_mesh(path)
    assert len(read_mesh(stage("newmtl dark wood\nmap_Kd wood.png\n")).mesh.textures) == 1


def test_a_library_that_is_spelt_in_many_ways_is_read_once(stage):
    many = "".join(f"mtllib {'./' * i}stage.mtl\n" for i in range(40))
    path = stage("newmtl dark wood\nKd 1 0 0\n" + "#" * (LIBRARY_LIMIT * 2 // 3) + "\n", many + FACE)
    assert read_mesh(path).mesh.colors.unique(dim=0).tolist() == [[1, 0, 0]]


def test_libraries_are_read_no_further_than_they_may_go(stage):
    half = "#" * (LIBRARY_LIMIT // 2) + "\n"
    path = stage(half, "mtllib b.mtl\nmtllib c.mtl\n" + FACE)
    for name, library in (("b", half), ("c", 3 * half)):
        path.with_name(f"{name}.mtl").write_text(library)
    with pytest.raises(InputError, match=f"stage.obj: mtllib: expected at most {LIBRARY_LIMIT} bytes, got"):
        read_mesh(path)


def test_an_image_may_be_larger_than_a_library(stage, image_file):
    path = stage("newmtl dark wood\nmap_Kd wood.png\n")
    noise = np.random.default_rng(0).integers(0, 256, (1200, 1200, 3), np.uint8)
    assert path.with_name("wood.png").write_bytes(image_file(noise)) > LIBRARY_LIMIT
    assert read_mesh(path).mesh.textures[0].shape == (1200, 1200, 4)


# The triangle's places in the image from its top left are (0, 1), (1, 1) and (0, 0) where nothing moves them.
@pytest.mark.parametrize(
    ("options", "places", "wrap"),
    [
        ("-s 1 1 1", [[0, 1], [1, 1], [0, 0]], "repeat"),
        ("-o 0.5 -.25", [[0.5, 1.25], [1.5, 1.25], [0.5, 0.25]], "repeat"),
        ("-s 3 2 1", [[0, 1], [3, 1], [0, -1]], "repeat"),
        ("-s 2 -mm 0 1.5 -bm 1 -O .5 .5", [[0.5, 0.5], [2.5, 0.5], [0.5, -0.5]], "repeat"),
        ("-clamp on -texres 256", [[0, 1], [1, 1], [0, 0]], "clamp"),
        ("-BlendU off -imfchan m", [[0, 1], [1, 1], [0, 0]], "repeat"),
        ("-clamp off -t 1 1 1", [[0, 1], [1, 1], [0, 0]], "repeat"),
    ],
)
def test_options_before_the_name_of_an_image_place_it(stage, options, places, wrap):
    path = stage(f"newmtl dark wood\nmap_Kd {options} wood.png\n")
    file = read_mesh(path)
    assert [image.shape for image in file.mesh.textures] == [(4, 2, 4)]
    assert file.files[-1] == path.with_name("wood.png")
    torch.testing.assert_close(file.mesh.uv, torch.tensor(places).float())
    assert file.mesh.wraps == ((wrap, wrap),)


@pytest.mark.parametrize("options", ["-s 1e30", "-o 1e30 0 0"])
def test_an_image_may_not_be_moved_out_of_reach(stage, options):
    path = stage(f"newmtl dark wood\nmap_Kd {options} wood.png\n")
    with pytest.raises(
        InputError, match=r"stage.obj: texture coordinates: expected at most 1e\+06 in size, got 1e\+30"
    ):
        read_mesh(path)


@pytest.mark.parametrize("said", ["d 0.4", "d -halo 0.2", "Tr 0.8", "d 0.1\nTr 0.1", "map_Kd wood.png\nd 0"])
def test_what_is_less_than_half_opaque_is_not_drawn(stage, said):
    solid = "usemtl solid\nf 1/1 3/3 2/2\n"
    assert len(read_mesh(stage(f"newmtl dark wood\n{said}\nnewmtl solid\nKd 1 0 0\n", FACE + solid)).mesh) == 1
    with pytest.raises(InputError, match=r"holds no faces .*all transparent"):
        read_mesh(stage(f"newmtl dark wood\n{said}\n"))


@pytest.mark.parametrize("said", ["d 0.6", "d 1\nTr 1", "Tr 0.3", "d glass", "Kd 1 0 0"])
def test_what_is_half_opaque_is_drawn(stage, said):
    assert len(read_mesh(stage(f"newmtl dark wood\n{said}\n")).mesh) == 1


def test_an_image_whose_name_begins_as_options_do_is_taken(stage, image_file):
    path = stage("newmtl dark wood\nmap_Kd -s 1 2.png\n")
    path.with_name("-s 1 2.png").write_bytes(image_file(np.zeros((1, 1, 3), np.uint8)))
    assert read_mesh(path).mesh.textures[0].shape == (1, 1, 4)


def test_a_name_that_was_written_on_windows_is_found(stage):
    path = stage("newmtl dark wood\nmap_Kd -s 1 1 1 maps\\wood.png\n")
    path.with_name("maps").mkdir()
    path.with_name("wood.png").rename(path.with_name("maps") / "wood.png")
    assert read_mesh(path).mesh.textures[0].shape == (4, 2, 4)
    path.with_name("maps\\wood.png").write_bytes(b"no picture")  # which is a name elsewhere
    with pytest.raises(InputError, match=r"map_Kd: .*wood.png' of material 'dark wood' cannot be decoded"):
        read_mesh(path)


@pytest.mark.parametrize(
    "name",
    ["..\\wood.png", "-s 1 1 1 ..\\wood.png", "maps\\..\\..\\wood.png", "\\wood.png", "C:\\wood.png", "-bm 1 /w.png"],
)
def test_no_name_leads_out_of_the_folder(stage, tmp_path, name):
    path = stage(f"newmtl dark wood\nmap_Kd {name}\n")
    with pytest.raises(InputError, match=r"stage.obj: uri: names .*expected a file in this folder or below"):
        read_mesh(path)


def test_a_link_that_leads_out_of_the_folder_is_not_followed_by_a_backslash(stage, tmp_path):
    path = stage("newmtl dark wood\nmap_Kd maps\\wood.png\n")
    inner = tmp_path / "inner"
    inner.mkdir()
    for name in ("stage.obj", "stage.mtl"):
        path.with_name(name).rename(inner / name)
    (inner / "maps").symlink_to(tmp_path)
    with pytest.raises(InputError, match="is a link out of the folder"):
        read_mesh(inner / "stage.obj")


@pytest.mark.parametrize(
    "library", ["newmtl dark wood\nnewmtl\nKd 1 0 0\n", "newmtl dark wood\nd 0\nNEWMTL dark  wood\nKd 1 0 0"]
)
def test_faces_with_and_without_places_show_one_material(stage, library):
    mesh = read_mesh(stage(library, FACE + "f 1 3 2\n")).mesh
    assert (len(mesh), mesh.colors.unique(dim=0).tolist()) == (2, [[1, 0, 0]])
