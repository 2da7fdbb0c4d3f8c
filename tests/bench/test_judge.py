"""The judge reads everybody by one rule, and leaving the frame never pays."""

from types import SimpleNamespace

import pytest
import torch

from cltransfer.bench.judge import HELD_OUT, RANDOM_VIEWS, Reader, judge, random_total
from cltransfer.bench.methods import FAITHFUL
from cltransfer.camera import Camera
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import shot


@pytest.fixture(scope="module")
def scene():
    return builtin_scene("room", 4)


@pytest.fixture(scope="module")
def reader() -> Reader:
    return Reader.of("room-4", side=96)


@pytest.fixture(scope="module")
def cameras(scene) -> Camera:
    return shot("boom", scene.subject, (96, 54), 4).camera


@pytest.fixture(scope="module")
def features(scene, reader, cameras):
    return reader.read(scene, cameras)


def test_the_true_cameras_have_no_loss(reader, features):
    verdict = judge(reader.objective, features, features)
    assert float(verdict.totals.abs().max()) < 1e-5
    assert verdict.names == ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")


def test_who_looks_away_pays_every_penalty_and_fails(scene, reader, cameras, features):
    away = Camera.look_at(cameras.center, 2 * cameras.center - scene.subject.anchor, scene.up, 0.7, (96, 54))
    rendered = reader.read(scene, away, features.names())
    verdict = judge(reader.objective, features, rendered)
    assert not bool(torch.isfinite(verdict.terms[:, :2]).any())
    assert bool(torch.isfinite(verdict.priced[1:]).all())
    assert float(verdict.totals.min()) > 10
    shown = reader.shown(scene, away, rendered)
    assert float(shown.label.max()) < 0.5


def test_what_the_reference_lacks_is_priced_at_nothing(reader, features):
    verdict = judge(reader.objective, features, features)
    assert bool(verdict.priced[0, verdict.names.index("camera_movement")].isnan())  # no frame before the first


def test_random_views_are_the_same_for_every_method_and_far_from_a_match(scene, reader, features):
    first, again, other = (random_total(reader, features, scene, seed) for seed in (1, 1, 2))
    assert first == again
    assert first != other
    assert first > 5


class Known:
    """An objective that was told the totals (N, V) of N frames by V views; it keeps the views it is asked about."""

    def __init__(self, totals):
        self.left = list(totals)

    def defined(self, reference):
        return torch.ones(len(reference), 1, dtype=torch.bool)

    def terms(self, reference, held):
        self.held = held
        return self.left.pop(0)[:, None]

    def totals(self, terms, defined):
        return terms[:, 0]


def test_a_clip_has_failed_by_the_median_view_of_all_round_each_held_for_all_its_frames(scene, reader, features):
    frames, views = torch.tensor([0.0, 0.0, 0.0, 400.0]), torch.arange(float(RANDOM_VIEWS)) ** 2
    known = Known(frames[:, None] + views)
    found = random_total(SimpleNamespace(stage=reader.stage, objective=known), features, scene, 1)
    assert found == 100 + (23**2 + 24**2) / 2
    assert bool((known.held.flow == 0).all())  # a view that is held shows no movement
    away = (known.held.camera.center - scene.person.anchor).norm(dim=1) / scene.person.height
    assert 1 <= float(away.min()) < 1.5
    assert 6 < float(away.max()) <= 8


def test_a_held_out_reading_sees_pixels_where_the_judge_sees_the_scene(reader):
    held = Reader.of("room-4", HELD_OUT["dis_flow"], 96)
    names = [[step.name for step in by.parts.plan("scene").steps] for by in (reader, held)]
    assert "scene_flow" in names[0]
    assert "flow_dis" not in names[0]
    assert "flow_dis" in names[1]


def test_a_reading_by_networks_sees_pixels_alone():
    held = Reader.of("room-4", HELD_OUT["networks"], 96).parts
    for shared in (None, frozenset({"keypoints", "subject", "orientation"})):  # reference first, then the render
        plan = held.plan("scene", shared)
        assert [step.name for step in plan.steps] == ["detect_yolox", "pose_blazepose"]  # no scene_joints and the like
        assert plan.buffers == {"image"}
        assert not plan.missing
    assert list(held.losses) == ["shot_size", "framing", "camera_angle"]


def test_the_printed_losses_are_the_same_five():
    printed = Reader.of("room-4", FAITHFUL)
    assert [loss.mode for loss in printed.parts.losses.values()] == ["faithful"] * 5
