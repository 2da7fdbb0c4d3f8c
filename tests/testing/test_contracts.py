"""Every registered loss, extractor and renderer passes the case that a plugin would inherit."""

from functools import cache
from pathlib import Path

import pytest
import torch
import trimesh

from cltransfer.clips.clip import read_clip
from cltransfer.features import Features
from cltransfer.registry import EXTRACTORS, LOSSES, RENDERERS
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.testing import ExtractorCase, LossCase, RendererCase, sample_features

OUR_LOSSES = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")
LOSS_MODES = [(name, mode) for name in OUR_LOSSES for mode in ("robust", "faithful")]
OTHER_LOSSES = [(name, None) for name in LOSSES.names() if name not in OUR_LOSSES]
GEOMETRIC = [name for name in EXTRACTORS.names() if EXTRACTORS.get(name).family != "image"]
IMAGE = [name for name in EXTRACTORS.names() if EXTRACTORS.get(name).family == "image"]
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
SAMPLE = sample_features(0, 1).names()
ROWS = {"flow_deep": {"height": 48}, "flow_dis": {"height": 96}}  # less than usual: 38 flows each


def needs_more(requires: tuple[str, ...]) -> None:
    lacking = sorted(set(requires) - SAMPLE)
    if lacking:
        pytest.skip(f"needs {', '.join(lacking)}, which sample features lack; a test of its own can override sample")


class TestLosses(LossCase):
    @pytest.fixture(autouse=True, params=LOSS_MODES + OTHER_LOSSES, ids=lambda p: "-".join(filter(None, p)))
    def use(self, request: pytest.FixtureRequest) -> None:
        name, mode = request.param
        self.component = LOSSES.build(name, {"mode": mode} if mode else {})
        needs_more(self.component.requires)


class TestGeometricExtractors(ExtractorCase):
    @pytest.fixture(autouse=True, params=GEOMETRIC)
    def use(self, request: pytest.FixtureRequest) -> None:
        self.component = EXTRACTORS.build(request.param)
        needs_more(self.component.requires)


@cache
def juggler() -> Features:
    """Frames of a real clip with the person's box, 240 px high."""
    clip = read_clip(DATA / "video" / "sav_05_juggle.mp4", frames=10, max_side=426).features()
    return EXTRACTORS.build("detect_yolox")(clip, None)


class TestImageExtractors(ExtractorCase):
    @pytest.fixture(autouse=True, params=IMAGE)
    def use(self, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
        if "???" in EXTRACTORS.options(request.param).values():
            pytest.skip("needs a network that the user names")
        if getattr(EXTRACTORS.get(request.param), "whole_clip", False):
            pytest.skip("reads whole clips; tested on its own")
        if not (DATA / "models").is_dir() or not (DATA / "video").is_dir():
            pytest.skip("needs the models and clips of shared/data")
        monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
        self.component = EXTRACTORS.build(request.param, ROWS.get(request.param))
        lacking = set(self.component.requires) - juggler().names()
        if lacking:
            pytest.skip(f"needs {', '.join(sorted(lacking))}, which a clip does not give")

    def sample(self, seed: int, batch: int) -> Features:
        frames = juggler()
        return frames[[(seed + i) % len(frames) for i in range(batch)]]


class TestGaussianSplats(RendererCase):
    component = RENDERERS.build("gaussian_splats")
    scene = builtin_scene("courtyard")
    points = scene.geometry.means


class TestMesh(RendererCase):
    component = RENDERERS.build("mesh")
    ball = trimesh.creation.icosphere(subdivisions=3)
    points = torch.tensor(ball.vertices)
    scene = Scene(Mesh.plain(points, torch.tensor(ball.faces)), None, torch.tensor([0.0, 1.0, 0.0]), "ball", "0" * 64)


def test_all_five_losses_and_five_scene_extractors_are_there() -> None:
    assert set(OUR_LOSSES) <= set(LOSSES.names())
    assert {"scene_joints", "scene_subject", "layers", "scene_flow", "scene_orientation"} <= set(GEOMETRIC)
