"""A script that makes the camera in Blender, zoom and all, with a key for each frame.

Blender's USD and glTF importers keep one focal length. The script has numbers of the path in it and nothing that a
scene or clip is called, so that it does the same whoever made the run.
"""

from __future__ import annotations

import math
from pathlib import Path

import torch

from ..storage.files import write_text
from ..trajectory import Trajectory
from .lens import FAR, FULL_FRAME, NEAR, Lens, frame_numbers

FIRST = 1  # frame of Blender's scenes
_SCRIPT = """\
# A camera path of cltransfer. In Blender: Scripting, Open this file, Run Script.
# The scene comes in by Blender's own importers as they are set: {world}

import bpy
from mathutils import Matrix

RATE = {rate!r}  # frames a second
SIZE = {size!r}  # [px]
KEYS = (  # frame, camera to world (x right, y up, z backward), lens [mm], shift x and y
{keys}
)

scene, data = bpy.context.scene, bpy.data.cameras.new("cltransfer")
camera = bpy.data.objects.new("cltransfer", data)
scene.collection.objects.link(camera)
scene.camera = camera
scene.render.resolution_x, scene.render.resolution_y = SIZE
scene.render.pixel_aspect_x = scene.render.pixel_aspect_y = 1
whole = max(1, round(RATE))
scene.render.fps, scene.render.fps_base = whole, whole / RATE
scene.frame_start, scene.frame_end = {first}, {last}
data.sensor_fit, data.sensor_width = "HORIZONTAL", {gate!r}
data.clip_start, data.clip_end = {near!r}, {far!r}
camera.rotation_mode = "QUATERNION"
turned = None
for frame, pose, lens, x, y in KEYS:
    camera.location, turn, _ = Matrix(pose).decompose()
    if turned is not None:
        turn.make_compatible(turned)  # the short way round from the key before
    camera.rotation_quaternion = turned = turn
    data.lens, data.shift_x, data.shift_y = lens, x, y
    for name in ("location", "rotation_quaternion"):
        camera.keyframe_insert(name, frame=frame)
    for name in ("lens", "shift_x", "shift_y"):
        data.keyframe_insert(name, frame=frame)
"""
_TURNED = "y is turned to z, as they turn glTF and OBJ."
_AS_IT_IS = "coordinates are those of the file, as they leave those of PLY."


def write_blender(path: Path, trajectory: Trajectory, rate: float, y_up: bool = False) -> None:
    """Write ``path``, whole or not at all.

    Args:
        path: the ``.py``.
        trajectory: N cameras; Blender leads the camera smoothly from one to the next.
        rate: frames a second, by which its times are numbered.
        y_up: turn y to Blender's z, as it turns the scene's file, a glTF or OBJ; else coordinates stay as they are.

    Raises:
        InputError: pixels are not square.
    """
    poses, lens = trajectory.camera.to_opengl(), Lens.of(trajectory.camera, path)
    if y_up:
        poses = torch.tensor([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=poses.dtype) @ poses
    frames = [FIRST + number for number in frame_numbers(trajectory, rate)]
    rows = zip(frames, poses.tolist(), lens.focal.tolist(), lens.shift.tolist())
    keys = [f"    ({frame!r}, {pose!r}, {mm!r}, {x!r}, {y!r})," for frame, pose, mm, (x, y) in rows]
    script = _SCRIPT.format(
        world=_TURNED if y_up else _AS_IT_IS,
        rate=rate,
        size=trajectory.camera.size,
        keys="\n".join(keys),
        first=FIRST,
        last=math.ceil(frames[-1]),
        gate=FULL_FRAME,
        near=NEAR,
        far=FAR,
    )
    write_text(path, script)
