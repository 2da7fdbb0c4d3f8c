"""A description: every frame has a word or a null with a reason, and the sentences say the usual."""

import json
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from matplotlib.figure import Figure

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.describe import sources, strip
from cltransfer.describe.angle import dutch_class, height_class, side_class, staging_class
from cltransfer.describe.description import Description, describe_features
from cltransfer.describe.flow_motion import flow_motion
from cltransfer.describe.motion import PRIMITIVES, Motion
from cltransfer.describe.sources import describe, describe_path, path_features
from cltransfer.describe.strip import write_strip
from cltransfer.errors import InputError
from cltransfer.features import Features
from cltransfer.reading.reference import Reference
from cltransfer.shots import Setup, shot
from cltransfer.subject import Subject
from cltransfer.testing import sample_features, sample_subject, without_person
from cltransfer.trajectory import Trajectory

TIMES = torch.arange(6).double() / 12


def described(features: Features) -> Description:
    return describe_features("sample", features, TIMES, flow_motion(features, TIMES), {"depth": "no depth network"})


def test_staging_that_is_not_told_says_why_by_what_the_clip_itself_told() -> None:
    features = replace(sample_features(0, 6), depth=None, reasons={"depth": "depth_sfm: the camera stands still"})
    told = describe_features("sample", features, TIMES, flow_motion(features, TIMES), {})
    assert "Staging: not told (depth_sfm: the camera stands still)." in told.text()


def test_of_a_person_whom_nobody_sees_every_sentence_says_that_it_is_not_told_and_why() -> None:
    told = described(replace(without_person(sample_features(0, 6)), depth=None)).text()
    assert told.startswith(
        "Shot size: not told (too few joints). Angle: not told (the person's orientation is unknown). Movement: "
    )
    assert told.endswith("Staging: not told (no depth network). The person is read in 0 of 6 frames.")


def angles(yaw: float = 0, pitch: float = 0, roll: float = 0) -> torch.Tensor:
    return torch.deg2rad(torch.tensor([[yaw, pitch, roll]]))


@pytest.mark.parametrize(("pitch", "word"), [(-20, 0), (0, 1), (15, 1), (40, 2), (80, 3)])
def test_height_follows_pitch(pitch: float, word: int) -> None:
    assert int(height_class(angles(pitch=pitch))) == word


@pytest.mark.parametrize(("yaw", "word"), [(0, 0), (-45, 1), (90, 2), (-130, 3), (180, 4), (-179, 4), (350, 0)])
def test_side_follows_yaw_either_way_round(yaw: float, word: int) -> None:
    assert int(side_class(angles(yaw=yaw))) == word


def test_a_canted_camera_is_dutch() -> None:
    assert [int(dutch_class(angles(roll=r))) for r in (0, -20, 20, math.nan)] == [0, 1, 1, -1]


def test_staging_is_the_widest_step_between_layers() -> None:
    features = sample_features(0, 2)
    subject, post = features.layers[:, 1], features.layers[:, 0]

    def staged(before: float, behind: float) -> int:
        depth = torch.where(subject, 2.0, torch.where(post, 2.0 / before, 2.0 * behind))
        return int(staging_class(replace(features, depth=depth))[0])

    assert [staged(1.1, 1.2), staged(1.1, 1.6), staged(1.1, 3.0), staged(3.0, 1.2)] == [0, 1, 2, 2]


def test_the_json_has_null_and_a_reason_and_no_nan() -> None:
    nobody = replace(without_person(sample_features(0, 6)), depth=None)
    value = json.loads(json.dumps(described(nobody).to_json(), allow_nan=False))
    assert value["scale"]["values"] == [None] * 6
    assert value["scale"]["reason"] == "too few joints"
    assert value["staging"]["reason"] == "no depth network"
    assert "no depth network" in value["text"]


@pytest.mark.parametrize(("frames", "reason"), [(1, "one frame does not move"), (4, "no frame's motion could be read")])
def test_motion_that_is_undefined_is_null(frames: int, reason: str) -> None:
    features = sample_features(0, frames)
    features = replace(features, flow=torch.full_like(features.require("flow"), math.nan))
    motion = flow_motion(features, TIMES[:frames])
    value = describe_features("sample", features, TIMES[:frames], motion, {}).to_json()
    moves = json.loads(json.dumps(value, allow_nan=False))["movement"]
    assert (moves["name"], moves["handheld"], moves["shake"], moves["reason"]) == (None, None, None, reason)
    assert set(moves["net"].values()) == {None}


@pytest.mark.parametrize(
    ("moves", "flags"),
    [
        ({"orbit": 0.02}, ("orbit right, or the camera keeps pace with the person: the picture does not tell",)),
        (
            {"dolly": 0.04, "zoom": -0.04},
            ("dolly zoom, or the camera keeps pace with the person: the picture does not tell",),
        ),
        ({"truck": 0.02}, ()),
    ],
)
def test_what_a_camera_beside_a_walking_person_shows_too_is_flagged_where_no_cameras_are_known(
    moves: dict[str, float], flags: tuple[str, ...]
) -> None:
    rates = torch.tensor([moves.get(name, 0.0) for name in PRIMITIVES]).double().expand(6, -1)
    for parallax, expected in ((0.5, flags), (math.nan, ())):
        described = describe_features("sample", sample_features(0, 6), TIMES, Motion(rates, TIMES, parallax), {})
        assert described.flags == expected


def test_a_whole_person_before_the_camera_is_a_long_shot_from_the_front(tmp_path: Path) -> None:
    person = sample_subject()
    shot("push_in", person, (160, 90), 12, setup=Setup(azimuth=0.0)).save(tmp_path / "trajectory.json")
    person.save(tmp_path / "subject.json")
    text = describe_path(tmp_path / "trajectory.json").text()
    assert "long shot" in text
    assert "eye level, from the front" in text
    assert "push in" in text
    assert "a camera path has no depth" in text


def test_of_a_path_as_many_frames_are_read_as_asked_for(tmp_path: Path) -> None:
    person = sample_subject()
    shot("push_in", person, (160, 90), 12).save(tmp_path / "trajectory.json")
    person.save(tmp_path / "subject.json")
    whole, few = (describe(str(tmp_path), load_config(overrides=asked))[0] for asked in ([], ["frames=3"]))
    assert (len(whole.times), len(few.times)) == (12, 3)
    assert (few.times[0], few.times[-1]) == (whole.times[0], whole.times[-1])


def test_meanwhile_threads_are_the_config_s() -> None:
    cv2.setNumThreads(3)
    config, during = load_config(overrides=["threads=1", "frames=2", "output_side=64"]), set[int]()
    describe("builtin:push_in", config, None, lambda step, done, of: during.add(cv2.getNumThreads()))
    assert (during, cv2.getNumThreads()) == ({1}, 3)


def test_the_exact_yaw_of_a_path_is_not_turned_back(tmp_path: Path) -> None:
    person = sample_subject()
    over = torch.cat([crane(person, 0.0, 8), crane(person, math.pi, 4)])
    path = Trajectory(Camera.look_at(over, person.anchor[None], person.up, 0.6, (640, 360)), torch.arange(12) / 24)
    path.save(tmp_path / "p.json")
    person.save(tmp_path / "s.json")
    exact = path_features(path, person).require("orientation").double()
    described = describe_path(tmp_path / "p.json", tmp_path / "s.json")
    torch.testing.assert_close(described.orientation, exact)
    assert described.tracks["side"].words() == ["front"] * 8 + ["back"] * 4


def crane(person: Subject, azimuth: float, count: int) -> torch.Tensor:
    """Places (``count``, 3) high above one side of a person."""
    level = math.cos(azimuth) * person.facing + math.sin(azimuth) * person.left
    rise = torch.linspace(50, 80, count, dtype=torch.float64).deg2rad()[:, None]
    return person.anchor + 3 * person.height * (torch.cos(rise) * level + torch.sin(rise) * person.up)


def test_the_yaw_that_a_network_read_is_turned_back_and_that_of_a_scene_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    features, used = sample_features(0, 6), []
    flipped = features.require("orientation").clone()
    flipped[2, 0] += math.pi
    for family in ("image", "scene"):
        read = Reference(replace(features, orientation=flipped), TIMES, None, "c", "", family, {})
        monkeypatch.setattr(sources, "read_reference", lambda *_, read=read: read)
        used.append(sources.describe("c.safetensors", load_config())[0].orientation)
    torch.testing.assert_close(used[1], flipped.double())
    assert (used[0][2, 0] - flipped[2, 0]).cos() == pytest.approx(-1)


def test_a_path_without_a_person_says_what_to_name(tmp_path: Path) -> None:
    shot("pan", sample_subject(), (160, 90), 3).save(tmp_path / "trajectory.json")
    with pytest.raises(InputError, match="--subject"):
        describe_path(tmp_path / "trajectory.json")


@pytest.mark.parametrize("frames", [2, 6, 40])
def test_thumbnails_keep_their_shape_however_few_frames_there_are(frames: int, tmp_path: Path) -> None:
    """Of an upright clip the row has room for 13; six frames drawn over it would be twice as wide as they are."""
    ax = Figure().subplots()
    strip._thumbnails(ax, torch.arange(frames).double(), torch.zeros(frames, 3, 320, 180, dtype=torch.uint8))
    assert ax.images[0].get_array().shape == (strip.HIGH, round(strip.WIDE * 320 / 180) * (strip.HIGH * 180 // 320), 3)


def test_a_yaw_that_goes_round_the_back_is_broken_there_and_keeps_every_dot() -> None:
    ax, shown = Figure().subplots(), described(sample_features(0, 6))
    yaw = torch.tensor([170.0, 178.0, -174.0, -166.0, -158.0, -150.0])
    turned = replace(shown, orientation=torch.deg2rad(torch.stack([yaw, 0 * yaw, 0 * yaw], dim=1)).double())
    strip._angle(ax, turned)
    line = ax.lines[0].get_ydata()
    assert line[np.isfinite(line)] == pytest.approx(yaw.numpy(), abs=1e-4)
    assert np.flatnonzero(np.isnan(line)).tolist() == [2]


@pytest.mark.parametrize("count", [2, 8])
def test_the_legend_of_the_movement_stands_beside_its_words(count: int) -> None:
    figure = Figure(figsize=(9, 3))
    ax, shown = figure.subplots(), described(sample_features(0, 6))
    rates = torch.zeros_like(shown.motion.rates)
    rates[1:, :count] = 0.1
    strip._movement(ax, replace(shown, motion=replace(shown.motion, rates=rates)))
    figure.draw_without_rendering()
    assert ax.get_legend().get_window_extent().x0 >= ax.get_window_extent().x1 - 1


def test_a_thumbnail_stands_at_its_own_time_however_unevenly_frames_follow() -> None:
    ax = Figure().subplots()
    grey = 50 * torch.arange(5, dtype=torch.uint8)
    strip._thumbnails(ax, torch.tensor([0.0, 0.1, 0.2, 0.3, 4.0]), grey[:, None, None, None].expand(5, 3, 32, 32))
    (row,) = ax.images
    left, right, *_ = row.get_extent()
    shades = row.get_array()[0, :, 0]

    def shade(time: float) -> int:
        return int(shades[min(int((time - left) / (right - left) * len(shades)), len(shades) - 1)])

    assert [shade(time) for time in (0.0, 1.9, 2.5, 4.0)] == [0, 150, 200, 200]


def test_the_strip_is_the_same_twice(tmp_path: Path) -> None:
    features = sample_features(1, 6)
    shown = described(features)
    image = (features.image * 255).byte()
    write_strip(tmp_path / "a.svg", shown, image)
    write_strip(tmp_path / "b.svg", shown, image)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert "shot size" in (tmp_path / "a.svg").read_text()


def test_one_frame_is_a_dot_in_the_strip(tmp_path: Path) -> None:
    drawn = []
    for nothing in (False, True):
        features = sample_features(1, 1)
        orientation = features.require("orientation") * (torch.nan if nothing else 1.0)
        motion = flow_motion(features, TIMES[:1])
        alone = replace(features, orientation=orientation)
        write_strip(tmp_path / "a.svg", describe_features("one", alone, TIMES[:1], motion, {}), None)
        drawn.append((tmp_path / "a.svg").read_text().count("<use "))
    assert drawn[0] == drawn[1] + 3  # yaw, pitch and roll


@pytest.mark.parametrize("pictures", [True, False])
def test_one_frame_stands_in_the_middle_of_the_strip_at_its_own_time(pictures: bool) -> None:
    figure = Figure()
    features, times = sample_features(1, 1), torch.tensor([2.5]).double()
    shown = describe_features("one", features, times, flow_motion(features, times), {})
    rows = [1.0] * (3 + pictures)
    strip._draw(figure, rows, shown, (features.image * 255).byte() if pictures else None)
    assert [ax.get_xlim() for ax in figure.axes] == [(2.0, 3.0)] * len(rows)
    assert [label.get_text() for label in figure.axes[-1].get_xticklabels()] == ["2.50"]
    assert [image.get_extent()[:2] for ax in figure.axes for image in ax.images] == [[2.0, 3.0]] * pictures
