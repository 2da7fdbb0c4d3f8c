from __future__ import annotations

import hashlib

import pytest
import torch

from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.errors import InputError, UsageError
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.ply import write_splats


def test_a_ply_becomes_a_scene_named_and_keyed_by_its_file(tmp_path):
    path = tmp_path / "stage.ply"
    write_splats(path, synthetic_room(200))
    scene = load_scene(str(path))
    assert (scene.name, scene.subject) == ("stage", None)
    assert len(scene.geometry) == 200
    assert scene.up.tolist() == [0, -1, 0]
    assert scene.digest == hashlib.sha256(path.read_bytes()).hexdigest()
    with pytest.raises(ValueError, match="expected a scene with a person, stage has none"):
        _ = scene.person


def test_up_is_made_a_unit_vector(tmp_path):
    path = tmp_path / "stage.ply"
    write_splats(path, synthetic_room(200))
    assert load_scene(path, up=(0, 0, 5)).up.tolist() == [0, 0, 1]
    for up in ((0, 0, 0), (0, float("nan"), 1)):
        with pytest.raises(UsageError, match="up: expected a direction"):
            load_scene(path, up=up)


@pytest.mark.parametrize(
    ("remark", "up"), [("Vertical Axis: z", (0, 0, 1)), ("vertical axis: Z", (0, 0, 1)), ("Vertical Axis: y", None)]
)
def test_up_of_a_splat_is_what_its_header_calls_vertical(tmp_path, caplog, remark, up):
    path = tmp_path / "stage.ply"
    write_splats(path, synthetic_room(200))
    data = path.read_bytes().replace(b"element", f"comment by Nerfstudio 1.1.5\ncomment {remark}\nelement".encode(), 1)
    path.write_bytes(data)
    assert load_scene(path).up.tolist() == list(up or (0, -1, 0))
    told = f"{path}: up is taken as 0,0,1, since its header says that z is vertical (otherwise: --up X,Y,Z)"
    assert caplog.messages == ([told] if up else [])
    caplog.clear()
    assert load_scene(path, up=(0, 1, 0)).up.tolist() == [0, 1, 0]
    assert caplog.messages == []


def test_an_unknown_suffix_and_a_missing_file_are_named(tmp_path):
    with pytest.raises(InputError, match=r"scene.xyz: no scene has the suffix '.xyz'"):
        load_scene(tmp_path / "scene.xyz")
    with pytest.raises(InputError, match="no such file"):
        load_scene(tmp_path / "scene.ply")
    with pytest.raises(InputError, match=r"is a folder, expected the file of a scene \(\.ply, .*NAME\)"):
        load_scene(tmp_path)


def test_a_builtin_scene_has_its_own_up():
    scene = load_scene("builtin:courtyard")
    assert scene.subject is not None
    assert torch.equal(load_scene("builtin:courtyard", up=(0, 0, 2)).up, scene.up)
    with pytest.raises(UsageError, match="leave it out"):
        load_scene("builtin:courtyard", up=(1, 0, 0))
    with pytest.raises(UsageError):
        load_scene("builtin:nowhere")


def test_meshes_are_told_from_splats_by_what_the_file_holds(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    rows = "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    (tmp_path / "scan.ply").write_text(header + "element face 1\nproperty list uchar int vertex_indices\n" + rows)
    scene = load_scene(tmp_path / "scan.ply")
    assert (type(scene.geometry).__name__, len(scene.geometry)) == ("Mesh", 1)
    assert scene.up.tolist() == [0, 1, 0]
    (tmp_path / "stage.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = load_scene(tmp_path / "stage.obj", up=(0, 0, 3))
    assert (scene.name, scene.subject, scene.up.tolist()) == ("stage", None, [0, 0, 1])
    assert scene.digest == hashlib.sha256((tmp_path / "stage.obj").read_bytes()).hexdigest()
