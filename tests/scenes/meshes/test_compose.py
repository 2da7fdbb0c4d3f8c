from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.meshes.compose import Part, read_composed

LONG = "f" * 5000
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.delenv("CLTRANSFER_ASSETS", raising=False)
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "tile.obj").write_text(OBJ)
    return tmp_path / "scene"


def write(folder, text):
    (folder / "set.yaml").write_text(text)
    return folder / "set.yaml"


def test_parts_stand_where_the_yaml_says(folder):
    path = write(folder, "parts:\n- {file: tile.obj}\n- {file: tile.obj, label: subject, scale: 2, "
                         "rotate_deg: [0, 90, 0], translate: [10, 0, 0]}\n")  # fmt: skip
    scene = load_scene(path)
    assert scene.name == "set"
    assert scene.up.tolist() == [0, 1, 0]
    assert scene.geometry.label.tolist() == [0, 1]
    expected = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [10, 0, 0], [10, 0, -2], [10, 2, 0]])
    torch.testing.assert_close(scene.geometry.vertices, expected, atol=1e-6, rtol=0)


@pytest.mark.parametrize(("label", "told"), [("scene", 0), ("subject", 1)])
def test_joints_that_name_nobody_are_told_of_the_subject_alone(folder, bar, write_glb, caplog, label, told):
    write_glb(folder / "flag.glb", *bar())
    read_composed(write(folder, f"parts: [{{file: flag.glb, label: {label}}}]\n"))
    assert [message.split(":")[0] for message in caplog.messages] == [str(folder / "flag.glb")] * told


def test_turns_are_about_x_then_y_then_z_of_the_scene():
    turned = Part("a", rotate_deg=(90, 90, 0)).rotation @ torch.tensor([0.0, 1, 0]).double()
    torch.testing.assert_close(turned, torch.tensor([1.0, 0, 0]).double(), atol=1e-9, rtol=0)  # y -> z -> x


def test_up_is_the_yamls_or_the_callers(folder):
    path = write(folder, "up: [0, 0, 2]\nparts: [{file: tile.obj}]\n")
    assert load_scene(path).up.tolist() == [0, 0, 1]
    assert load_scene(path, up=(3, 0, 0)).up.tolist() == [1, 0, 0]


def test_the_digest_follows_every_file(folder):
    path = write(folder, "parts: [{file: tile.obj}]\n")
    first = read_composed(path).digest
    assert read_composed(path).digest == first
    (folder / "tile.obj").write_text(OBJ + "# changed\n")
    second = read_composed(path).digest
    write(folder, "parts: [{file: tile.obj, scale: 2}]\n")
    assert len({first, second, read_composed(path).digest}) == 3


def test_a_person_of_a_skeleton_stands_with_its_mesh(data, tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_ASSETS", str(data))
    path = write(tmp_path, "parts:\n- {file: cesium_man.glb, label: subject, time: 0.3, scale: 2, "
                           "rotate_deg: [0, 90, 0], translate: [5, 1, 0]}\n")  # fmt: skip
    moved = read_composed(path)
    write(tmp_path, "parts: [{file: cesium_man.glb, label: subject, time: 0.3}]\n")
    still = read_composed(path)
    turn = torch.tensor([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]).double()
    offset = torch.tensor([5.0, 1, 0]).double()
    torch.testing.assert_close(moved.subject.joints, 2 * still.subject.joints @ turn.T + offset)
    torch.testing.assert_close(moved.subject.facing, turn @ still.subject.facing, atol=1e-6, rtol=0)
    assert moved.subject.height == pytest.approx(2 * still.subject.height)
    inside = moved.geometry.vertices.double()
    assert bool((moved.subject.joints > inside.amin(0) - 0.05).all())
    assert bool((moved.subject.joints < inside.amax(0) + 0.05).all())


def test_a_leaning_person_knows_its_up_from_the_scene(data, tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_ASSETS", str(data))
    path = write(tmp_path, "parts: [{file: cesium_man.glb, label: subject, rotate_deg: [30, 0, 0]}]\n")
    scene = read_composed(path)
    torch.testing.assert_close(scene.subject.up, scene.up)
    assert float(scene.subject.facing @ scene.up) == pytest.approx(0, abs=1e-9)
    assert math.isclose(float(scene.subject.facing.norm()), 1, abs_tol=1e-9)


def test_the_gallery_of_the_configs_composes(data, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_ASSETS", str(data))
    scene = load_scene(Path(__file__).resolve().parents[3] / "configs" / "scenes" / "man_in_gallery.yaml")
    assert len(scene.geometry) == 1930 + 26756
    assert int(scene.geometry.label.sum()) == 26756
    assert scene.subject is None  # to be lifted
    assert (
        abs(float(scene.geometry.vertices[scene.geometry.faces[-26756:].long()].amin((0, 1))[1])) < 0.05
    )  # on the floor


def test_files_come_from_the_yamls_folder_or_the_named_root_and_nowhere_else(folder, tmp_path, monkeypatch):
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "other.obj").write_text(OBJ)
    path = write(folder, "parts: [{file: other.obj}]\n")
    with pytest.raises(InputError, match=r"parts\[0\].file: no such file 'other.obj' \(files lie beside"):
        read_composed(path)
    monkeypatch.setenv("CLTRANSFER_ASSETS", str(tmp_path / "assets"))
    assert len(read_composed(path).geometry) == 1
    for name in ("../assets/other.obj", str(tmp_path / "assets" / "other.obj"), "file:other.obj"):
        write(folder, f"parts: [{{file: '{name}'}}]\n")
        with pytest.raises(InputError, match="expected a file in this folder or below"):
            read_composed(path)
    (folder / "link.obj").symlink_to(tmp_path / "assets" / "other.obj")
    write(folder, "parts: [{file: link.obj}]\n")
    with pytest.raises(InputError, match="is a link out of the folder"):
        read_composed(path)


def test_what_a_yaml_moves_so_far_that_float32_tears_it_is_refused(folder):
    rows = [f"v {x / 10} {y / 10} 0" for x in range(10) for y in range(10)]
    rows += [f"f {i} {i + 1} {i + 11}" for i in range(1, 89)]
    (folder / "man.obj").write_text("\n".join(rows))
    assert len(read_composed(write(folder, "parts: [{file: man.obj, translate: [50, 0, 0]}]")).geometry) == 88
    with pytest.raises(InputError, match=r"set.yaml: lies 5e\+06 units from its origin, .* too coarse for"):
        read_composed(write(folder, "parts: [{file: man.obj, translate: [5000000, 0, 0]}]"))
    with pytest.raises(InputError, match=r"parts\[1\]: expected vertices that float32 can hold, got infinity"):
        read_composed(write(folder, "parts: [{file: tile.obj}, {file: tile.obj, scale: 1.0e+39}]"))


def test_parts_that_fit_in_memory_only_one_by_one_are_refused(folder, monkeypatch):
    monkeypatch.setattr(memory, "free_bytes", lambda: 5000)
    assert len(read_composed(write(folder, "parts: [{file: tile.obj}]")).geometry) == 1
    path = write(folder, f"parts: [{', '.join(['{file: tile.obj}'] * 20)}]")
    with pytest.raises(ResourceError, match=r"set.yaml: memory: 20 faces of its parts need"):
        read_composed(path)


@pytest.mark.parametrize("field", ["file", "label", "translate", "scale", "time", "animation", "x" * 100_000])
def test_a_line_is_short_whatever_a_part_holds(folder, field):
    path = write(folder, f"parts: [{{file: tile.obj, ? {field} : [{'x' * 100_000}]}}]")
    with pytest.raises(InputError, match=field[:40]) as error:
        read_composed(path)
    assert len(str(error.value)) < 5000


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "expected the keys up and parts and no other, got NoneType"),
        ("- 1", "expected the keys up and parts and no other, got list"),
        ("{}", "parts: expected a list"),
        ("parts: []\nparts: [{file: tile.obj}]", "parts: expected each key once"),
        ("parts: [{file: tile.obj, time: 1, time: 2}]", "time: expected each key once"),
        ("parts: [", "not plain YAML"),
        ("parts: []", "parts: expected a list"),
        ("parts: [tile.obj]", r"parts\[0\]: expected a mapping with file"),
        ("parts: [{file: tile.obj, size: 2}]", "unknown: size .known: animation, file"),
        ("parts: [{file: tile.obj, scale: 0}]", "scale must be positive"),
        ("parts: [{file: tile.obj, scale: .nan}]", "scale must be positive"),
        (f"parts: [{{file: tile.obj, scale: 1{'0' * 400}}}]", "scale must be positive"),
        (f"up: [0, 1{'0' * 400}, 0]\nparts: [{{file: tile.obj}}]", "up: expected a direction"),
        ("parts: [{file: tile.obj, label: person}]", "label must be subject or scene"),
        ("parts: [{file: tile.obj, translate: [1, 2]}]", "translate must be three numbers"),
        ("parts: [{file: tile.obj, rotate_deg: abc}]", "rotate_deg must be three numbers"),
        ("parts: [{file: tile.obj, time: soon}]", "time must be seconds"),
        ("parts: [{file: tile.obj, time: 3.5}]", r"parts\[0\].time: tile.obj does not move, only glTF does"),
        ("parts: [{file: tile.obj, animation: Run}]", r"parts\[0\].animation: tile.obj does not move"),
        ("parts: [{file: 3}]", "file must be a name"),
        ("parts: [{file: gone.obj}]", "no such file"),
        ("up: [0, 0, 0]\nparts: [{file: tile.obj}]", "up: expected a direction"),
        ("parts: [{file: tile.obj, label: subject}, {file: tile.obj, label: subject}]", "one subject at most"),
        ("a: !!python/object/apply:os.getcwd []", "not plain YAML"),
        ("parts: [{file: tile.obj}]\nmore: 1", "expected the keys up and parts and no other, got parts, more"),
        ("parts: [{file: tile.obj, translate: &a [0, 0, 1]}]", "expected no anchors and aliases"),
        ("up: &a [0, 1, 0]\nparts: [{file: tile.obj, translate: *a}]", "expected no anchors and aliases"),
        ("parts: [{file: tile.obj, time: 2001-99-99}]", "not plain YAML"),
        ("parts: [{file: !!bool x}]", "not plain YAML: a value is not of the kind that its form or its tag"),
        ("parts: [{file: tile.obj, time: !!int ''}]", "not plain YAML: a value is not of the kind"),
        ('parts: [{file: "\\ud800.obj"}]', r"parts\[0\].file: no such file '\\ud800.obj'"),
        (f"parts: [{{file: tile.obj, scale: {'9' * 300}}}]", "float32 can hold, got infinity at scale 1e\\+300"),
        (f"parts: [{{file: tile.obj, translate: [0, {'9' * 300}, 0]}}]", "vertices that float32 can hold"),
        (f"up: [0x{LONG}, 0, 0]\nparts: [{{file: tile.obj}}]", "at most 8192 bits, got one of 20000"),
        (f"up: [0, 1, 0]\n? 0x{LONG}\n: 1", "at most 8192 bits, got one of 20000"),
        (f"parts: [{{file: tile.obj, ? 0x{LONG} : 1}}]", "at most 8192 bits, got one of 20000"),
        ("up: [1.0e+308, 1.7e+308, 0]\nparts: [{file: tile.obj}]", "up: expected a direction"),
        ("[" * 100_000, "expected at most 64 levels"),
        ("- " * 100_000, "expected at most 64 levels"),
    ],
)
def test_a_bad_yaml_is_one_line(folder, text, reason):
    with pytest.raises(InputError, match=reason) as error:
        read_composed(write(folder, text))
    assert "\n" not in str(error.value)
