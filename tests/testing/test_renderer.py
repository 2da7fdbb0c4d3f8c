"""A renderer that draws what is not there, or not what is, does not keep to the contract."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import pytest
import torch
import trimesh

from cltransfer.camera import Camera
from cltransfer.drawing import drawn_by
from cltransfer.errors import ModelError
from cltransfer.features import Features
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.renderers.mesh import MeshRenderer
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.testing import RendererCase
from cltransfer.testing.samples import pixel_centres


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
class Learnt:
    """Draws splats, each as far as it has learnt to; ``kept`` draws what somebody else goes back through."""

    kept: bool = False
    share: torch.nn.Parameter = field(default_factory=lambda: torch.nn.Parameter(torch.tensor(1.0)))
    provides: ClassVar[frozenset[str]] = frozenset({"depth"})

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        drawn = GaussianSplats().render(scene, cameras, buffers)
        with torch.set_grad_enabled(self.kept or torch.is_grad_enabled()):
            return replace(drawn, depth=self.share * drawn.require("depth"))


class OfLearnt(RendererCase):
    component: ClassVar[Any] = Learnt()
    scene, points = Forgetful.scene, Forgetful.scene.geometry.means


@pytest.mark.parametrize("test", [name for name in dir(RendererCase) if name.startswith("test_")])
def test_a_renderer_may_draw_by_what_it_has_learnt(test: str) -> None:
    getattr(OfLearnt(), test)()


def test_a_renderer_that_keeps_what_it_draws_by_is_told_to_leave_it() -> None:
    class Kept(OfLearnt):
        component: ClassVar[Any] = Learnt(kept=True)

    with pytest.raises(AssertionError, match=r"^return depth\.detach\(\)"):
        Kept().test_shapes_follow_the_cameras()


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
class Spoilt:
    """Draws splats, and spoils what it has drawn; a ``stale`` one draws the scene it was given first."""

    spoil: Callable[[Features], Features] = lambda drawn: drawn
    stale: bool = False
    first: list[Scene] = field(default_factory=list)
    provides: ClassVar[frozenset[str]] = GaussianSplats.provides

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        self.first.append(scene)
        drawn = GaussianSplats().render(self.first[0] if self.stale else scene, cameras, buffers | {"depth"})
        return self.spoil(drawn).only(buffers | {"camera", "person"})


def mirrored(name: str, along: int = -1) -> Callable[[Features], Features]:
    return lambda drawn: drawn.having(name, drawn.require(name).flip(along)) if drawn.has(name) else drawn


def nobody_s(drawn: Features) -> Features:
    return drawn if drawn.label is None else replace(drawn, label=torch.zeros_like(drawn.label))


def hollow(drawn: Features) -> Features:
    """Without a depth in the left half, where it has drawn something."""
    depth = drawn.require("depth").clone()
    depth[..., :24] = torch.nan
    return replace(drawn, depth=depth)


def along_the_ray(drawn: Features) -> Features:
    x, y = pixel_centres(drawn.size)
    camera = drawn.require("camera")
    pixels = torch.stack([x, y, torch.ones_like(x)], dim=-1).double()
    rays = (pixels.reshape(1, -1, 3) @ camera.K.inverse().mT).norm(dim=-1)  # for 1 along the axis
    return replace(drawn, depth=drawn.require("depth") * rays.reshape(drawn.require("depth").shape).float())


@pytest.mark.parametrize(
    ("component", "test"),
    [
        (Spoilt(mirrored("image")), "test_each_buffer_is_drawn_where_the_cameras_look"),
        (Spoilt(mirrored("image", -2)), "test_each_buffer_is_drawn_where_the_cameras_look"),
        (Spoilt(mirrored("label")), "test_each_buffer_is_drawn_where_the_cameras_look"),
        (Spoilt(mirrored("alpha")), "test_each_buffer_is_drawn_where_the_cameras_look"),
        (Spoilt(hollow), "test_something_is_where_depth_is"),
        (Spoilt(nobody_s), "test_label_is_that_of_the_scene"),
        (Spoilt(nobody_s), "test_label_is_where_the_person_is"),
        (Spoilt(stale=True), "test_label_is_that_of_the_scene"),
        (Spoilt(mirrored("label", -2)), "test_label_is_where_the_person_is"),
        (Spoilt(along_the_ray), "test_depth_is_where_the_scene_is"),
    ],
)
def test_a_renderer_whose_buffers_do_not_tell_of_one_scene_is_found_out(component: Spoilt, test: str) -> None:
    class OfSpoilt(OfLearnt):
        pass

    OfSpoilt.component = replace(component, first=[])
    with pytest.raises(AssertionError):
        getattr(OfSpoilt(), test)()
    OfSpoilt.component = Spoilt()
    getattr(OfSpoilt(), test)()


@dataclass(frozen=True)
class Straight(Spoilt):
    """Draws meshes, and what is along the ray for the depth."""

    provides: ClassVar[frozenset[str]] = frozenset({"depth"})

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        return self.spoil(MeshRenderer().render(scene, cameras, buffers))


@pytest.mark.parametrize("reach", [0.01, 0.7, 50.0])
def test_depth_along_the_ray_is_found_out_in_a_scene_of_any_size_without_a_person(reach: float) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=reach)

    class OfBall(RendererCase):
        component: ClassVar[Any] = Straight(along_the_ray)
        points = torch.tensor(ball.vertices)
        scene = Scene(Mesh.plain(points, torch.tensor(ball.faces)), None, torch.tensor([0.0, 1, 0]), "ball", "")

    with pytest.raises(AssertionError, match="depth is along the optical axis, and no distance along the ray"):
        OfBall().test_depth_is_where_the_scene_is()
    OfBall.component = Straight()
    OfBall().test_depth_is_where_the_scene_is()


def half_seen(drawn: Features) -> Features:
    """Of every other ray, as edges of a mesh are that is drawn by several a pixel."""
    return replace(drawn, alpha=(drawn.require("alpha") >= 0.5) * 0.5) if drawn.has("alpha") else drawn


def test_what_covers_half_of_a_pixel_has_a_depth() -> None:
    class OfHalf(OfLearnt):
        component: ClassVar[Any] = Spoilt(half_seen)

    OfHalf().test_something_is_where_depth_is()
    OfHalf.component = Spoilt(lambda drawn: replace(half_seen(drawn), depth=torch.full_like(drawn.depth, torch.nan)))
    with pytest.raises(AssertionError, match=r"^alpha is 0\.5 or more elsewhere than depth is known"):
        OfHalf().test_something_is_where_depth_is()
