"""The script for Blender: what stands in it, and what Blender itself then sees where it is installed."""

import ast
import json
import subprocess
import sys
from types import SimpleNamespace

import pytest

from cltransfer.errors import InputError
from cltransfer.export.blender import write_blender

LOOK = """
import json, runpy, sys
import bpy
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

bpy.ops.wm.read_factory_settings(use_empty=True)
runpy.run_path(sys.argv[1])
scene, asked = bpy.context.scene, json.loads(sys.argv[2])
found = []
for frame, points in asked:
    scene.frame_set(int(frame // 1), subframe=frame % 1)
    camera = scene.camera.evaluated_get(bpy.context.evaluated_depsgraph_get())
    found.append([list(world_to_camera_view(scene, camera, Vector(point)))[:2] for point in points])
render = scene.render
told = (render.resolution_x, render.resolution_y, render.fps / render.fps_base, scene.frame_start, scene.frame_end)
print("told", json.dumps([found, told]))
"""


def assigned(text, name):
    """The literal that the script gives to ``name``."""
    lines = [node for node in ast.parse(text).body if isinstance(node, ast.Assign)]
    return ast.literal_eval(next(line.value for line in lines if ast.unparse(line.targets[0]) == name))


def test_one_camera_worked_out_by_hand(tmp_path, still):
    write_blender(tmp_path / "shot.py", still, 24)
    text = (tmp_path / "shot.py").read_text()
    assert assigned(text, "SIZE") == (200, 100)
    assert assigned(text, "RATE") == 24
    ((frame, pose, lens, x, y),) = assigned(text, "KEYS")
    assert (frame, lens, x, y) == (1, pytest.approx(9), 0, 0)
    assert pose == [[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3], [0, 0, 0, 1]]


def test_a_lens_off_the_middle_worked_out_by_hand(tmp_path, path):
    write_blender(tmp_path / "shot.py", path, 20)
    for _, _, _, x, y in assigned((tmp_path / "shot.py").read_text(), "KEYS"):
        # the axis is 40 px right of the middle and 25 above it: the gate lies to its left and below
        assert (x, y) == (pytest.approx(-40 / 1280), pytest.approx(-25 / 1280))


def test_what_blender_turns_is_turned(tmp_path, path):
    for name, y_up in (("as_it_is", False), ("turned", True)):
        write_blender(tmp_path / f"{name}.py", path, 20, y_up)
    before, after = (assigned((tmp_path / f"{name}.py").read_text(), "KEYS") for name in ("as_it_is", "turned"))
    for (_, was, *lens), (_, pose, *same) in zip(before, after):
        assert pose == [was[0], [-value for value in was[2]], was[1], [0, 0, 0, 1]]
        assert lens == same


@pytest.mark.parametrize("rate", [0.4, 23.976, 240])
def test_a_rate_is_two_numbers_that_blender_takes(tmp_path, still, rate):
    write_blender(tmp_path / "shot.py", still, rate)
    lines = (tmp_path / "shot.py").read_text().splitlines()
    given = {"RATE": rate, "scene": SimpleNamespace(render=SimpleNamespace())}
    exec("\n".join(line for line in lines if line.startswith(("whole", "scene.render.fps"))), given)
    render = given["scene"].render
    assert isinstance(render.fps, int)
    assert render.fps >= 1
    assert render.fps / render.fps_base == pytest.approx(rate)


def test_cameras_stand_at_their_times_from_frame_one_on(tmp_path, path):
    write_blender(tmp_path / "shot.py", path, 20)
    assert [key[0] for key in assigned((tmp_path / "shot.py").read_text(), "KEYS")] == [1, 1.8, 3, 3.6, 5]


@pytest.mark.parametrize(("rate", "last"), [(20, 5), (18, 5), (22, 6)])
def test_a_scene_ends_no_earlier_than_its_last_camera(tmp_path, path, rate, last):
    write_blender(tmp_path / "shot.py", path, rate)
    assert f"\nscene.frame_start, scene.frame_end = 1, {last}\n" in (tmp_path / "shot.py").read_text()


def test_pixels_that_are_not_square_are_refused(tmp_path, path):
    path.camera.K[:, 0, 0] *= 1.1
    with pytest.raises(InputError, match="expected square pixels"):
        write_blender(tmp_path / "shot.py", path, 20)
    assert not (tmp_path / "shot.py").exists()


@pytest.mark.parametrize("y_up", [False, True])
def test_blender_sees_what_we_see(tmp_path, path, seen, y_up):
    if subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode:
        pytest.skip("Blender is not installed as a module: pip install bpy")
    write_blender(tmp_path / "shot.py", path, 20, y_up)
    frames = [1 + 20 * time for time in path.times.tolist()]
    turned = [[[p[0], -p[2], p[1]] if y_up else p for p, _ in points] for points in seen]
    words = [sys.executable, "-c", LOOK, str(tmp_path / "shot.py"), json.dumps(list(zip(frames, turned)))]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    found, told = json.loads(said.partition("told ")[2])
    assert told == [1280, 720, 20, 1, 5]
    for row, points in zip(found, seen):
        for (x, y), (_, pixel) in zip(row, points):
            assert (x * 1280, (1 - y) * 720) == pytest.approx(pixel, abs=1e-2)  # Blender has 32 bits
