"""Every registered loss and scene extractor passes the case that a plugin would inherit."""

import pytest

from cltransfer.registry import EXTRACTORS, LOSSES
from cltransfer.testing import ExtractorCase, LossCase, sample_features

OUR_LOSSES = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")
LOSS_MODES = [(name, mode) for name in OUR_LOSSES for mode in ("robust", "faithful")]
OTHER_LOSSES = [(name, None) for name in LOSSES.names() if name not in OUR_LOSSES]
GEOMETRIC = [name for name in EXTRACTORS.names() if EXTRACTORS.get(name).family != "image"]
SAMPLE = sample_features(0, 1).names()


def needs_more(requires: tuple[str, ...]) -> None:
    lacking = sorted(set(requires) - SAMPLE)
    if lacking:
        pytest.skip(f"needs {', '.join(lacking)}, which sample features lack; its own test inherits the case")


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


def test_all_five_losses_and_five_scene_extractors_are_there() -> None:
    assert set(OUR_LOSSES) <= set(LOSSES.names())
    assert {"scene_joints", "scene_subject", "layers", "scene_flow", "scene_orientation"} <= set(GEOMETRIC)
