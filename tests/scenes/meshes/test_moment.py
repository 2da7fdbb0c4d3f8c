from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from cltransfer.errors import InputError, UsageError
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.meshes.moment import Moment, split_moment
from cltransfer.skeleton import JOINTS

MAN = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "mesh" / "cesium_man.glb"
needs_man = pytest.mark.skipif(not MAN.is_file(), reason="shared/data/mesh/cesium_man.glb is not here")


@pytest.mark.parametrize(
    ("source", "moment"),
    [
        ("man.glb", None),
        ("man.glb#t=0.6", Moment(0.6)),
        ("man.glb#animation=Run", Moment(0.0, "Run")),
        ("man.glb#t=2&animation=Run%20fast", Moment(2.0, "Run fast")),
    ],
)
def test_a_moment_stands_behind_the_file(source, moment):
    assert split_moment(source) == (Path("man.glb"), moment)


@pytest.mark.parametrize("text", ["", "soon", "t=", "t=-1", "t=inf", "t=1,2", "t=1&speed=2", "T=1"])
def test_what_is_no_moment_is_refused(text):
    with pytest.raises(UsageError, match=r"is no moment \(expected FILE#t=SECONDS"):
        split_moment(f"man.glb#{text}")


def test_a_file_whose_name_holds_the_mark_is_itself(tmp_path):
    path = tmp_path / "take#3.glb"
    path.touch()
    assert split_moment(path) == (path, None)


def test_a_moment_of_what_does_not_move_is_refused(tmp_path):
    for name in ("room.ply", "man.obj", "two.yaml"):
        with pytest.raises(UsageError, match=r"#t=1: only a .glb or .gltf is looked at in time"):
            load_scene(f"{tmp_path / name}#t=1")


@needs_man
def test_the_man_walks_in_place_under_one_name_and_many_digests():
    first, half, later = (load_scene(f"{MAN}{moment}") for moment in ("", "#t=0.5", "#t=1"))
    assert {scene.name for scene in (first, half, later)} == {"cesium_man"}
    assert len({scene.digest for scene in (first, half, later)}) == 3
    assert load_scene(f"{MAN}#t=0.5").digest == half.digest
    step = (half.subject.joints - first.subject.joints).norm(dim=1)
    known = torch.isfinite(step)
    assert float(step[known].max()) > 0.1 * first.subject.height  # a foot or a hand
    assert float(step[known].min()) < 0.05 * first.subject.height  # the trunk
    assert not torch.equal(half.geometry.vertices, later.geometry.vertices)


@needs_man
def test_an_unknown_animation_and_one_where_there_is_none_are_refused():
    with pytest.raises(InputError, match="no animation 'Dance'"):
        load_scene(f"{MAN}#animation=Dance")
    still = MAN.with_name("pc_house.glb")
    with pytest.raises(InputError, match="holds none to be looked at after 1 s"):
        load_scene(f"{still}#t=1")


@pytest.mark.slow  # tests/test_convert_scene.py bakes by the command line
@needs_man
def test_the_command_line_bakes_the_moment(tmp_path):
    run = [sys.executable, "-m", "cltransfer", "bake", f"{MAN}#t=0.5", "--out", str(tmp_path), "--detail", "2000"]
    told = subprocess.run(run, capture_output=True, text=True, check=True, timeout=120).stdout
    assert told.endswith(f" CLIP --up 0,1,0 --subject {tmp_path / 'subject.json'}\n")
    grid = [*run[:4], f"{MAN}", "--as", "nerf_grid", "--out", str(tmp_path / "grid"), "--detail", "16"]
    told = subprocess.run(grid, capture_output=True, text=True, check=True, timeout=120).stdout
    assert told.endswith(" 'renderer.nerf_grid={}'\n")
    baked = json.loads((tmp_path / "subject.json").read_text())["joints"]["left_ankle"]
    ankle = JOINTS.index("left_ankle")
    at_start, then = (load_scene(f"{MAN}{moment}").subject.joints[ankle].tolist() for moment in ("", "#t=0.5"))
    assert baked == pytest.approx(then, abs=1e-6)
    assert baked != pytest.approx(at_start, abs=1e-2)
