"""The bench of descriptions: what it is asked, what is true of it, and what is counted as right."""

from __future__ import annotations

import math
from typing import cast

import pytest
import torch

from cltransfer.bench.describe import (
    FRAMED_FRAMES,
    FRAMES,
    NAMES,
    SCENES,
    Answer,
    _answers,
    _clips,
    _read,
    accuracy,
    confusion,
    framed,
    report_lines,
    run_describe,
    true_scale,
)
from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.describe.shot_scale import SCALES, shot_scale
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import SHOTS, shot
from cltransfer.testing import sample_subject
from cltransfer.trajectory import Trajectory

SIZE = (96, 54)
PERSON = sample_subject()
SCENE = Scene(synthetic_room(100), PERSON, PERSON.up, "room", "0" * 64)
HERE = Answer("", "geometry", "courtyard", 3, "", "")
TOLD = [  # (what, reader, truth, said)
    *([("scale", "geometry", "MS", "MS")] * 2),
    *([("scale", "geometry", "MS", "MLS"), ("scale", "geometry", "LS", "LS"), ("scale", "geometry", "LS", "nothing")]),
    *([("movement", "geometry", "pan right", "pan left"), ("scale", "networks", "CU", "nothing")]),
]
ANSWERS = [Answer(what, reader, "plaza", 1, truth, said) for what, reader, truth, said in TOLD]


def level(top: float, bottom: float) -> Camera:
    """A camera before the person that sees from ``top`` down to ``bottom`` where the person stands [body heights]."""
    height = PERSON.height * (top + bottom) / 2
    eye, target = torch.tensor([[[0.0, y, height]] for y in (4.0, 0.0)], dtype=torch.float64)
    return Camera.look_at(eye, target, PERSON.up, 2 * math.atan(PERSON.height * (top - bottom) / 2 / 4), SIZE)


def shown(path: Trajectory) -> Features:
    """What the frames of ``path`` show of the person's joints, all of it known."""
    pixels, _ = path.camera.project(PERSON.joints)
    inside = ((pixels >= 0) & (pixels <= torch.tensor(path.camera.size))).all(-1, keepdim=True)
    return Features(path.camera.size, keypoints=torch.cat([pixels, inside.double()], -1))


def flowing(frames: int, right: float) -> Features:
    """Frames of nobody, in which all moves by ``right`` [frame widths] from one to the next."""
    flow = torch.zeros(frames, 2, SIZE[1], SIZE[0])
    flow[:, 0] = -right * SIZE[0]
    flow[0] = float("nan")
    layers = torch.zeros(frames, 3, SIZE[1], SIZE[0], dtype=torch.bool)
    layers[:, 2] = True
    return Features(SIZE, flow=flow, layers=layers, keypoints=torch.full((frames, 14, 3), float("nan")))


def test_a_seed_that_is_named_twice_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltransfer.bench.describe._clips", lambda scene, seed, size: ())
    told: list[str] = []
    run_describe([1, 1, 2], ["geometry"], cast(Components, None), told.append)
    assert told == [f"seed {seed}, {name}, geometry" for seed in (1, 2) for name in SCENES]


@pytest.mark.parametrize(
    ("top", "bottom", "scale"),
    [(1.02, 0.92, "ECU"), (1.05, 0.82, "CU"), (1.05, 0.7, "MCU"), (1.1, 0.55, "MS"), (1.1, 0.3, "MLS"),
     (1.1, 0.1, "LS"), (1.3, -0.2, "LS"), (2.2, -1.7, "LS"), (2.4, -1.8, "ELS"), (0.6, 0.2, "MS")],
)  # fmt: skip
def test_the_true_scale_is_what_a_level_frame_holds_of_the_body(top: float, bottom: float, scale: str) -> None:
    assert [SCALES[i] for i in true_scale(level(top, bottom), PERSON).tolist()] == [scale]


@pytest.mark.parametrize("scale", SCALES)
def test_a_framed_person_is_filmed_in_that_scale_with_the_head_inside(scale: str) -> None:
    random = torch.Generator().manual_seed(5)
    for _ in range(8):
        camera = shot("static", PERSON, SIZE, 1, setup=framed(scale, random, 5)).camera
        assert SCALES[int(true_scale(camera, PERSON))] == scale
        head = camera.project(PERSON.joints[12:13])[0][0, 0] / torch.tensor(SIZE)
        assert 0 < float(head[1]) < 0.6
        assert 0.2 < float(head[0]) < 0.8


@pytest.mark.parametrize("scale", SCALES)
def test_a_framed_person_is_read_as_the_scale_that_it_is(scale: str) -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    path = shot("static", scene.subject, SIZE, 1, setup=framed(scale, torch.Generator().manual_seed(1), 1))
    features = _read(scene, path, "geometry", Components.build(load_config()))
    assert list(_answers(scale, path, features, scene, HERE)) == [
        Answer("scale", "geometry", "courtyard", 3, scale, scale)
    ]


def test_a_seed_is_asked_every_shot_and_every_scale_from_places_of_its_own() -> None:
    clips, again, others = (list(_clips(SCENE, seed, SIZE)) for seed in (3, 3, 4))
    assert [label for label, _ in clips] == [*SHOTS, *SCALES]
    assert set(NAMES) == set(SHOTS)
    assert [len(path) for _, path in clips] == [FRAMES] * len(SHOTS) + [FRAMED_FRAMES] * len(SCALES)
    eyes = [[path.camera.center[0] for _, path in drawn] for drawn in (clips, again, others)]
    assert all(torch.equal(one, two) for one, two in zip(*eyes[:2]))
    assert not any(torch.allclose(one, two) for one, two in zip(eyes[0], eyes[2]))


def test_the_truth_is_the_camera_s_whatever_was_read() -> None:
    random = torch.Generator().manual_seed(0)
    close, far = (shot("static", PERSON, SIZE, 2, setup=framed(scale, random, 0)) for scale in ("CU", "LS"))
    assert [SCALES[i] for i in shot_scale(shown(far)).tolist()] == ["LS", "LS"]
    misread = list(_answers("CU", close, shown(far), SCENE, HERE))
    assert misread == [Answer("scale", "geometry", "courtyard", 3, "CU", "LS")] * 2
    untold = list(_answers("CU", close, flowing(2, 0.0), SCENE, HERE))
    assert untold == [Answer("scale", "geometry", "courtyard", 3, "CU", "nothing")] * 2


@pytest.mark.parametrize(("right", "said"), [(-0.01, "pan right"), (0.01, "pan left"), (math.nan, "nothing")])
def test_a_clip_of_a_shot_is_asked_for_its_movement_too(right: float, said: str) -> None:
    path = shot("pan", PERSON, SIZE, 8)
    first, *frames = _answers("pan", path, flowing(8, right), SCENE, HERE)
    assert first == Answer("movement", "geometry", "courtyard", 3, "pan right", said)
    assert [(answer.what, answer.said) for answer in frames] == [("scale", "nothing")] * 8


def test_only_what_is_said_rightly_is_right() -> None:
    assert accuracy(ANSWERS) == [
        ["scale", "geometry", "3", "5", "60.0", "1"],
        ["movement", "geometry", "0", "1", "0.0", "0"],
        ["scale", "networks", "0", "1", "0.0", "1"],
    ]


def test_a_matrix_has_a_row_for_each_truth_and_a_column_for_each_word_said() -> None:
    of_geometry = [a for a in ANSWERS if (a.what, a.reader) == ("scale", "geometry")]
    matrix = [
        "| truth, said | MS | MLS | LS | nothing |",
        "| --- | --- | --- | --- | --- |",
        "| MS | 2 | 1 |  |  |",
        "| LS |  |  | 1 | 1 |",
    ]
    assert confusion(of_geometry, SCALES) == matrix
    report = "\n".join(report_lines(ANSWERS))
    assert "\n".join(["scale, read by geometry:", "", *matrix, ""]) in report
    assert "| truth, said | nothing |\n| --- | --- |\n| CU | 1 |" in report
    assert "| truth, said | pan left |\n| --- | --- |\n| pan right | 1 |" in report
