"""OpenUSD's text format, ``.usda``: one camera over time, for what reads USD.

A camera looks along -z, y up; matrices act on rows; gate and focal length are in tenths of a scene unit, here a metre
(https://openusd.org/release/api/class_usd_geom_camera.html). Blender's importer keeps the first focal length of a zoom:
:mod:`.blender`. Maya's takes both as millimetres whatever the unit (maya-usd, translatorCamera.cpp).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..storage.files import write_text
from ..trajectory import Trajectory
from .lens import FAR, FULL_FRAME, NEAR, Lens, frame_numbers

MM = 0.01  # tenths of a metre
AXES = "Coordinates are those of the scene's file; upAxis says how programs take them, not where its up is."


def write_usd(path: Path, trajectory: Trajectory, rate: float, y_up: bool = False) -> None:
    """Write ``path``, whole or not at all.

    Args:
        path: the ``.usda``.
        trajectory: N cameras; programs go straight from one to the next.
        rate: frames a second, by which its times are numbered.
        y_up: tell that y is up, so that programs turn the camera as they turn the scene's file, a glTF or OBJ; else
            that z is, by which they leave coordinates as they are.

    Raises:
        InputError: pixels are not square.
    """
    camera, frames = trajectory.camera, frame_numbers(trajectory, rate)
    lens, (width, height) = Lens.of(camera, path), camera.size
    gate = FULL_FRAME * MM
    attributes = [
        *_sampled("float focalLength", frames, [_number(mm * MM) for mm in lens.focal.tolist()]),
        f"    float horizontalAperture = {_number(gate)}",
        *_sampled("float horizontalApertureOffset", frames, [_number(x * gate) for x, _ in lens.shift.tolist()]),
        f"    float verticalAperture = {_number(gate * height / width)}",
        *_sampled("float verticalApertureOffset", frames, [_number(y * gate) for _, y in lens.shift.tolist()]),
        *_sampled("matrix4d xformOp:transform", frames, [_matrix(pose) for pose in camera.to_opengl().mT.tolist()]),
    ]
    lines = [
        "#usda 1.0",
        "(",
        '    defaultPrim = "camera"',
        f'    doc = "Camera path of cltransfer. {AXES}"',
        f"    endTimeCode = {_number(frames[-1])}",
        f"    framesPerSecond = {_number(rate)}",
        "    metersPerUnit = 1",
        "    startTimeCode = 0",
        f"    timeCodesPerSecond = {_number(rate)}",
        f'    upAxis = "{"Y" if y_up else "Z"}"',
        ")",
        "",
        'def Camera "camera"',
        "{",
        f"    float2 clippingRange = ({_number(NEAR)}, {_number(FAR)})",
        *attributes,
        '    uniform token[] xformOpOrder = ["xformOp:transform"]',
        "}",
    ]
    write_text(path, "\n".join(lines) + "\n")


def _sampled(name: str, frames: Sequence[float], values: Sequence[str]) -> list[str]:
    """Lines of an attribute over time, of one value where it does not change."""
    if len(set(values)) == 1:
        return [f"    {name} = {values[0]}"]
    samples = [f"        {_number(frame)}: {value}," for frame, value in zip(frames, values)]
    return [f"    {name}.timeSamples = {{", *samples, "    }"]


def _matrix(rows: Sequence[Sequence[float]]) -> str:
    return "(" + ", ".join(f"({', '.join(map(_number, row))})" for row in rows) + ")"


def _number(value: float) -> str:
    """``value`` to twelve digits; more than 32 bits hold, and the bits of -0 and of a sum of thirds left out."""
    return f"{value + 0.0:.12g}"
