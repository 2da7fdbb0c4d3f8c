"""The view that somebody names by --init."""

from __future__ import annotations

import json
import logging
import math
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera, resized
from cltransfer.config import load_config
from cltransfer.errors import InputError, UsageError
from cltransfer.progress import silent
from cltransfer.run.initial import given_view
from cltransfer.run.inputs import Inputs
from cltransfer.run.preparation import Clock, Job, prepare
from cltransfer.scenes.load import load_scene
from cltransfer.testing.samples import sample_cameras
from cltransfer.trajectory import Trajectory

TINY = ["preset=fast", "frames=2", "search_side=48", "output_side=48"]


def test_the_first_camera_of_a_trajectory_keeps_its_field_of_view(tmp_path: Path) -> None:
    cameras = sample_cameras(0, 2)
    Trajectory(cameras, torch.tensor([0.0, 1.0], dtype=torch.float64)).save(tmp_path / "view.json")
    view = resized(given_view(str(tmp_path / "view.json")), (320, 200))
    assert view.size == (320, 200)
    torch.testing.assert_close(view.w2c, cameras[0].w2c)
    torch.testing.assert_close(view.vertical_fov, cameras[0].vertical_fov)


def test_a_camera_of_a_posed_set_is_named_by_its_index(tmp_path: Path) -> None:
    cameras = sample_cameras(0, 3)
    frames = [
        {"file_path": f"{i}.png", "transform_matrix": pose.tolist()} for i, pose in enumerate(cameras.to_opengl())
    ]
    data = {"w": 64, "h": 36, "fl_x": float(cameras.focal[0]), "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(data))
    view = given_view(f"{tmp_path}:1")
    torch.testing.assert_close(view.w2c, cameras[1].w2c)
    torch.testing.assert_close(view.vertical_fov, cameras[1].vertical_fov)
    with pytest.raises(UsageError, match="--init: expected 0 to 2, got 3"):
        given_view(f"{tmp_path}:3")
    with pytest.raises(InputError, match="no such file or folder"):
        given_view(f"{tmp_path / 'gone'}:0")
    (tmp_path / "a set").mkdir()
    (tmp_path / "a set" / "transforms.json").write_text(json.dumps(data))
    for path in (tmp_path, tmp_path / "transforms.json", tmp_path / "a set"):
        first, last = (shlex.quote(f"{path}:{index}") for index in (0, 2))
        line = f"{path}: --init: expected SET:INDEX, it has 3 cameras, {first} to {last}"
        with pytest.raises(UsageError, match=f"^{re.escape(line)}$"):
            given_view(str(path))
    with pytest.raises(InputError, match="expected a file, got a folder"):
        given_view(str(tmp_path.parent))


@pytest.mark.parametrize(("aside", "told"), [(0.0, False), (0.004, False), (-0.25, True)])
def test_a_principal_point_that_no_search_keeps_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, aside: float, told: bool
) -> None:
    cameras = sample_cameras(0, 1)
    K = cameras.K.clone()
    K[:, 0, 2] += aside * cameras.size[0]
    path = tmp_path / "view.json"
    Trajectory(replace(cameras, K=K), torch.tensor([0.0], dtype=torch.float64)).save(path)
    with caplog.at_level(logging.WARNING, "cltransfer"):
        given_view(str(path))
    where = "expected it in the middle, got -25.0% of the width and +0.0% of the height beside"
    assert caplog.messages == [f"--init {path}: principal point: {where}; the search begins as if it were there"] * int(
        told
    )


@pytest.mark.parametrize(("wider", "told"), [(1.0, False), (1.004, False), (1.5, True)])
def test_pixels_that_are_not_square_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, wider: float, told: bool
) -> None:
    cameras = sample_cameras(0, 1)
    K = cameras.K.clone()
    K[:, 0, 0] = wider * 100.0
    K[:, 1, 1] = 100.0
    path = tmp_path / "view.json"
    Trajectory(replace(cameras, K=K), torch.tensor([0.0], dtype=torch.float64)).save(path)
    with caplog.at_level(logging.WARNING, "cltransfer"):
        given_view(str(path))
    line = f"--init {path}: focal length: expected fx as fy, got 150 and 100; the search begins with fy alone"
    assert caplog.messages == [line] * int(told)


@pytest.mark.parametrize(("degrees", "told"), [(60, False), (120, True)])
def test_a_view_that_looks_away_from_the_person_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, degrees: float, told: bool
) -> None:
    subject, path = load_scene("builtin:plaza").subject, tmp_path / "view.json"
    assert subject is not None
    eye, turn = subject.anchor + 3 * subject.facing, math.radians(degrees)
    ahead = eye - math.cos(turn) * subject.facing + math.sin(turn) * subject.left
    view = Camera.look_at(eye[None], ahead[None], subject.up, 0.7, (96, 54))
    Trajectory(view, torch.zeros(1, dtype=torch.float64)).save(path)
    config = load_config(overrides=TINY)
    with caplog.at_level(logging.WARNING, "cltransfer"):
        prepare(Inputs("builtin:plaza", "builtin:static", str(path)), config, Clock(), silent, None)
    line = (
        f"--init {path}: expected a view towards the person, who is behind this camera;"
        " the search begins there too, but turned to the person"
    )
    assert caplog.messages == [line] * int(told)


def test_a_view_from_within_the_middle_of_the_person_is_refused(tmp_path: Path) -> None:
    """From there every direction is as good, and rounding would tell one."""
    person, path = load_scene("builtin:plaza").person, tmp_path / "view.json"

    def begin(heights: float, *overrides: str) -> Job:
        eye = person.anchor + heights * person.height * person.facing
        view = Camera.look_at(eye[None], (eye - person.facing)[None], person.up, 0.7, (96, 54))
        Trajectory(view, torch.zeros(1, dtype=torch.float64)).save(path)
        config = load_config(overrides=[*TINY, *overrides])
        return prepare(Inputs("builtin:plaza", "builtin:static", str(path)), config, Clock(), silent, None)

    with pytest.raises(InputError, match=r"view.json: expected a camera beside the person, got one at the middle"):
        begin(0.0)
    assert begin(0.05).starting.view is not None
    assert begin(0.0, "search.paper_box={}").starting.view is not None  # which is not about the person


@pytest.mark.parametrize(
    ("size", "wider", "got"),
    [((96, 54), 1, ""), ((320, 181), 1, ""), ((72, 54), 4 / 3, ""),  # of pixels a third wider than high
     ((54, 96), 1, "got 54 x 96; {} 65.2 degrees, and 97.4 across instead of 39.6"),
     ((128, 54), 1, "got 128 x 54; {} 65.2 degrees, and 97.4 across instead of 113")],
)  # fmt: skip
def test_a_lens_for_a_frame_of_another_shape_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, size: tuple[int, int], wider: float, got: str
) -> None:
    subject, path = load_scene("builtin:plaza").subject, tmp_path / "view.json"
    assert subject is not None
    eye, fov = subject.anchor + 3 * subject.facing, 2 * math.atan(0.64)
    view = Camera.look_at(eye[None], subject.anchor[None], subject.up, fov, size)
    K = view.K.clone()
    K[:, 0, 0] /= wider
    Trajectory(replace(view, K=K), torch.zeros(1, dtype=torch.float64)).save(path)
    config = load_config(overrides=["preset=fast", "frames=2", "search_side=48", "output_side=96"])
    with caplog.at_level(logging.WARNING, "cltransfer"):
        prepare(Inputs("builtin:plaza", "builtin:static", str(path)), config, Clock(), silent, None)
    lens = "the search begins with a lens that is as high as that one,"
    line = f"--init {path}: frame: expected 96 x 54 as the reference, {got.format(lens)}"
    assert [told for told in caplog.messages if "frame:" in told] == [line] * bool(got)
