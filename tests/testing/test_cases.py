"""A contract case says what it lacks, instead of failing somewhere inside a component."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.drawing import drawn_by
from cltransfer.errors import ModelError
from cltransfer.features import Features
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.testing import ExtractorCase, LossCase, RendererCase, sample_features


@dataclass(frozen=True)
class GazeMatch:
    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("gaze",)
    unit: ClassVar[str] = "rad"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return (rendered.require("gaze") - reference.require("gaze")).abs().sum(1)


class Unaware(LossCase):
    component: ClassVar[Any] = GazeMatch()


class TestGazeMatch(LossCase):
    component = GazeMatch()

    def sample(self, seed: int, batch: int) -> Features:
        gaze = torch.rand(batch, 2, generator=torch.Generator().manual_seed(seed))
        return sample_features(seed, batch).having("gaze", gaze)


@pytest.mark.parametrize("test", ["test_names_what_it_requires", "test_scores_itself_zero", "test_batch_equals_single"])
def test_a_feature_that_the_frames_lack_is_named_with_how_to_give_it(test: str) -> None:
    with pytest.raises(AssertionError, match=r"^sample gives no gaze: override sample\(self, seed, batch\), .*'gaze'"):
        getattr(Unaware(), test)()


@dataclass(frozen=True)
class Careless:
    """How large the person is; of nobody 0, and it writes on what it was given."""

    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("subject",)
    unit: ClassVar[str] = "frame"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        sizes = [side.require("subject").float().mean((1, 2)) for side in (reference, rendered)]
        value = (sizes[1] - sizes[0]).abs().masked_fill(sizes[1] == 0, torch.nan)
        reference.require("subject")[:, 0] = True
        return value


class OfCareless(LossCase):
    component: ClassVar[Any] = Careless()


@pytest.mark.parametrize("test", ["test_nobody_in_the_reference_is_undefined", "test_changes_nothing_in_place"])
def test_a_careless_loss_is_found_out(test: str) -> None:
    with pytest.raises(AssertionError):
        getattr(OfCareless(), test)()


@dataclass(frozen=True)
class Aside:
    """How far the box is from where it should be; its residuals are the careless thing that ``how`` says."""

    how: str = ""
    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("box",)
    unit: ClassVar[str] = "frame"
    penalty: ClassVar[float] = 1.0
    groups: ClassVar[tuple[int, ...]] = (0,)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        wanted, found = (side.require("box")[:, 0] / side.size[0] for side in (reference, rendered))
        rows = len(wanted) if self.how == "of the reference" else len(found)
        apart = (found - wanted)[:rows, None]
        return apart.nan_to_num(0.0) if self.how == "of nobody" else apart

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return replace(self, how="").residuals(reference, rendered)[:, 0].abs()


@pytest.mark.parametrize(
    ("how", "told"), [("of nobody", "NaN in both or in neither"), ("of the reference", r"expected \(3, 1\) of one ref")]
)
def test_residuals_that_a_search_finds_nobody_by_are_found_out(how: str, told: str) -> None:
    class OfAside(LossCase):
        component: ClassVar[Any] = Aside(how)

    OfAside().test_residuals_add_up_to_the_loss()
    with pytest.raises(AssertionError, match=told):
        OfAside().test_residuals_are_undefined_where_it_is()
    OfAside.component = Aside()
    OfAside().test_residuals_are_undefined_where_it_is()


@dataclass(frozen=True)
class Sure(GazeMatch):
    """Counts for less where nobody is sure."""

    uses: ClassVar[tuple[str, ...]] = ("surety",)

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        value = super().__call__(reference, rendered)
        return value * rendered.require("surety") if rendered.has("surety") else value


class TestWhatALossUsesItMayRead(LossCase):
    component = Sure()

    def sample(self, seed: int, batch: int) -> Features:
        drawn = torch.rand(batch, 3, generator=torch.Generator().manual_seed(seed))
        return sample_features(seed, batch).having("gaze", drawn[:, :2]).having("surety", 0.5 + drawn[:, 2])


@dataclass(frozen=True)
class Drift:
    """How far the box has moved since the first frame of the clip."""

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image", "box")
    provides: ClassVar[tuple[str, ...]] = ("drift",)
    whole_clip: ClassVar[bool] = True

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        assert load(0, 1).require("image").shape[0] == 1
        box = found.require("box")
        return found.having("drift", box[:, 0] - box[0, 0])


class TestAnExtractorOfWholeClips(ExtractorCase):
    component = Drift()


@dataclass(frozen=True)
class Alone:
    """Draws nothing, and does not say whom."""

    provides: ClassVar[frozenset[str]] = frozenset({"alpha"})

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        return Features(cameras.size, alpha=torch.zeros(len(cameras), *cameras.size[::-1]), camera=cameras)


class Forgetful(RendererCase):
    component: ClassVar[Any] = Alone()
    scene, points = builtin_scene("plaza"), torch.zeros(1, 3)


def test_a_renderer_that_the_program_refuses_does_not_keep_to_the_contract() -> None:
    with pytest.raises(ModelError, match="expected camera and person beside the buffers, got no person"):
        drawn_by(Alone(), Forgetful.scene, Forgetful().cameras(1), Alone.provides)
    with pytest.raises(AssertionError, match=r"return Features\(\.\.\., camera=cameras, person=scene\.subject\)"):
        Forgetful().test_renders_the_buffers_asked_for_and_no_more()


class Bare(RendererCase):
    component: ClassVar[Any] = GaussianSplats()


@pytest.mark.parametrize("test", [name for name in vars(RendererCase) if name.startswith("test_")])
def test_a_renderer_s_case_without_a_scene_says_what_to_set(test: str) -> None:
    line = r"^the case has no scene and no points: set scene, as builtin_scene\('plaza'\), and points, world points"
    with pytest.raises(AssertionError, match=line):
        getattr(Bare(), test)()


def test_a_renderer_s_case_without_points_says_so() -> None:
    class Pointless(Bare):
        scene = Forgetful.scene

    with pytest.raises(AssertionError, match=r"^the case has no points: set scene"):
        Pointless().test_depth_is_where_the_scene_is()


@dataclass(frozen=True)
class Splats:
    """Draws splats, and tells of a few buffers in a tuple."""

    provides: ClassVar[tuple[str, ...]] = ("alpha", "image")

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        return GaussianSplats().render(scene, cameras, buffers & {"alpha", "image"})


class InATuple(RendererCase):
    component: ClassVar[Any] = Splats()
    scene, points = Forgetful.scene, Forgetful.points


@pytest.mark.parametrize(
    "test",
    [name for name in dir(RendererCase) if name.startswith("test_")],
)
def test_a_renderer_may_tell_what_it_draws_in_a_tuple(test: str) -> None:
    getattr(InATuple(), test)()


@dataclass(frozen=True)
class Cornered:
    """Draws splats' depth, and ``nothing`` in a corner, where nothing is."""

    nothing: float
    provides: ClassVar[frozenset[str]] = frozenset({"expected_depth"})

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        drawn = GaussianSplats().render(scene, cameras, buffers)
        depth = drawn.require("expected_depth").clone()
        depth[:, 0, 0] = self.nothing
        return replace(drawn, expected_depth=depth)


@pytest.mark.parametrize("nothing", [0.0, -1.0, torch.inf])
def test_a_depth_that_every_run_refuses_does_not_keep_to_the_contract(nothing: float) -> None:
    class Deep(InATuple):
        component: ClassVar[Any] = Cornered(nothing)

    with pytest.raises(ModelError, match="expected expected_depth above 0, and NaN where nothing is"):
        drawn_by(Cornered(nothing), Deep.scene, Deep().cameras(2), Cornered.provides)
    with pytest.raises(AssertionError, match="expected expected_depth above 0 and finite, and NaN where nothing is"):
        Deep().test_depth_is_above_zero_or_nan()
    Deep.component = Cornered(torch.nan)
    Deep().test_depth_is_above_zero_or_nan()


@dataclass(frozen=True)
class Flicker:
    """How much brighter a frame is than the one before, which has to be one for each."""

    provides: ClassVar[tuple[str, ...]] = ("flicker",)
    requires: ClassVar[tuple[str, ...]] = ("image",)
    family: ClassVar[str] = "image"
    needs_before: ClassVar[bool] = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        assert before is not None
        pairs = zip(now.require("image"), before.require("image"))
        return now.having("flicker", torch.stack([(a - b).mean() for a, b in pairs])[:, None])


class OneForEach(ExtractorCase):
    component: ClassVar[Any] = Flicker()


def test_an_extractor_that_wants_a_frame_before_for_each_is_told_before_a_search_asks_it() -> None:
    OneForEach().test_batch_equals_single()
    with pytest.raises(Exception, match=r"one number of frames|index 1"):
        OneForEach().test_one_frame_before_serves_a_batch()
