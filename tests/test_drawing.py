"""Anybody's renderer: what it raises, or gives instead of buffers, is told with its name wherever a scene is drawn."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.drawing import drawn_by
from cltransfer.errors import ModelError, ResourceError
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.reading.reference import Reading, read_reference
from cltransfer.registry import RENDERERS
from cltransfer.run.readback import render_frames
from cltransfer.scenes import Scene
from cltransfer.scenes.bake import bake_grid, bake_splats
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.shots import builtin_reference
from cltransfer.testing.samples import sample_cameras

SIZE = (32, 18)


@dataclass(frozen=True)
class Odd:
    """A renderer that does as it is told."""

    give: Callable[[Camera], Any]
    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth"})

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        return self.give(cameras)


def box(form: str) -> Scene:
    corners = torch.tensor([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    mesh = Mesh.plain(corners, torch.combinations(torch.arange(8), 3))
    forms = {"mesh": lambda: mesh, "splats": lambda: bake_splats(mesh, 50), "grid": lambda: bake_grid(mesh, 4)}
    return Scene(forms[form](), None, torch.tensor([0.0, 1, 0]).double(), "box", "")


@pytest.mark.parametrize(("name", "form"), [("gaussian_splats", "splats"), ("mesh", "mesh"), ("nerf_grid", "grid")])
def test_frames_that_no_memory_is_left_for_are_refused_before_they_are_drawn(
    name: str, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = box(form)
    monkeypatch.setenv("CLTRANSFER_MEMORY", "1")  # MB, less than this process takes
    cameras, buffers = sample_cameras(0, 2).at_size((8000, 6000)), frozenset({"image", "depth"})
    line = r"^box: memory: the pixels of 2 frames of 8000x6000 need 1465 MB, 0 MB are free"
    with pytest.raises(ResourceError, match=line):
        drawn_by(RENDERERS.build(name), scene, cameras, buffers)
    drawn_by(RENDERERS.build(name), scene, sample_cameras(0, 1), buffers)  # little is not asked for


def raising(cameras: Camera) -> Features:
    raise KeyError("sky")


GIVEN = [
    (raising, "image, it raised KeyError: 'sky'"),
    (lambda cameras: None, "image, got NoneType (return Features from render)"),
]


@pytest.mark.parametrize(("give", "line"), GIVEN)
def test_a_renderer_that_fails_is_named_where_a_scene_is_drawn(give: Callable[[Camera], Any], line: str) -> None:
    _, path = builtin_reference("static", SIZE, 2)
    parts = Components(Odd(give), {}, load_config().build("losses"))
    with pytest.raises(ModelError, match=f"^renderer Odd: expected .*{re.escape(line)}"):
        render_frames(builtin_scene("courtyard"), parts, path.camera)
    with pytest.raises(ModelError, match=f"^renderer Odd: expected .*{re.escape(line)}"):
        read_reference("builtin:static", parts, Reading(2, 32))


def test_a_buffer_that_was_asked_for_and_is_not_given_is_named() -> None:
    _, path = builtin_reference("static", SIZE, 1)
    odd = Odd(lambda cameras: Features(SIZE, image=torch.zeros(1, 3, 18, 32)))
    with pytest.raises(ModelError, match="renderer Odd: expected depth, image, got no depth"):
        drawn_by(odd, builtin_scene("courtyard"), path.camera, frozenset({"image", "depth"}))


def test_what_a_renderer_has_learnt_is_drawn_without_a_gradient() -> None:
    """A view that is remembered would hold all that it was made of."""
    learnt = torch.nn.Parameter(torch.tensor(2.0))
    odd = Odd(lambda cameras: Features(SIZE, depth=learnt * torch.ones(1, 18, 32), camera=cameras))
    cameras, scene = builtin_reference("static", SIZE, 1)[1].camera, replace(builtin_scene("courtyard"), subject=None)
    drawn = drawn_by(odd, scene, cameras, frozenset({"depth"})).require("depth")
    assert (float(drawn.mean()), drawn.requires_grad) == (2.0, False)
    assert odd.render(scene, cameras, frozenset({"depth"})).require("depth").requires_grad  # for who wants it


def test_who_looks_and_who_is_there_are_asked_for_by_name() -> None:
    scene, path = builtin_scene("courtyard"), builtin_reference("static", SIZE, 1)[1]
    image = Features(SIZE, image=torch.zeros(1, 3, 18, 32))
    hint = re.escape("(return Features(..., camera=cameras, person=scene.subject))")
    with pytest.raises(ModelError, match=f"^renderer Odd: expected camera and person .*got no camera {hint}$"):
        drawn_by(Odd(lambda cameras: image), scene, path.camera, frozenset({"image"}))
    seen = Odd(lambda cameras: replace(image, camera=cameras))
    with pytest.raises(ModelError, match="got no person"):
        drawn_by(seen, scene, path.camera, frozenset({"image"}))
    assert drawn_by(seen, replace(scene, subject=None), path.camera, frozenset({"image"})).has("image")


@pytest.mark.parametrize(
    ("shape", "line"),
    [
        (
            (1, 3, 18, 32),
            r"image, it raised ValueError: features must have one number of frames, got 1 in image and 2 ",
        ),
        ((2, 3, 7, 7), r"image of shape \(2, 3, 18, 32\), got "),
    ],
    ids=["too few", "too small"],
)
def test_views_of_another_number_or_size_are_named(shape: tuple[int, ...], line: str) -> None:
    scene, path = builtin_reference("static", SIZE, 2)
    odd = Odd(lambda cameras: Features(SIZE, image=torch.zeros(shape), camera=cameras, person=scene.subject))
    with pytest.raises(ModelError, match=f"^renderer Odd: expected {line}"):
        drawn_by(odd, builtin_scene("courtyard"), path.camera, frozenset({"image"}))


NOT_ALL = r"\(draw every camera, at cameras.size, and return camera=cameras\)$"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"size": (64, 36)}, rf"expected 2 frames of 32x18, got 2 frames of 64x36 {NOT_ALL}"),
        ({"camera": sample_cameras(0, 2, (64, 36))}, rf"expected 2 frames of 32x18, got 2 frames of 64x36 {NOT_ALL}"),
        (
            {"image": None, "camera": sample_cameras(0, 1, SIZE)},
            rf"expected 2 frames of 32x18, got 1 frame .*{NOT_ALL}",
        ),
        (
            {"camera": torch.eye(4)[None].repeat(2, 1, 1)},
            "expected the cameras that it was given, got Tensor .*camera=",
        ),
        (
            {"image": torch.zeros(2, 3, 18, 32).byte()},
            r"expected image, .* image must be RGB in \[0, 1\], got torch.uint8;",
        ),
        ({"depth": torch.zeros(2, 18, 32).int()}, r"expected depth in floating point, .* \(return depth.float\(\)\)$"),
        (
            {"image": torch.full((2, 3, 18, 32), torch.nan)},
            r"expected image in \[0, 1\], got NaN \(0 where nothing is\)$",
        ),
        (
            {"depth": torch.zeros(2, 18, 32, device="meta")},
            r"expected depth on the CPU, got meta \(return depth.cpu\(\)\)$",
        ),
    ],
    ids=["size", "size of the cameras", "one camera of two", "no camera", "bytes", "integers", "nowhere", "elsewhere"],
)
def test_what_is_no_frame_of_the_cameras_is_refused_under_the_name_that_a_config_has(
    change: dict[str, Any], line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(RENDERERS._classes, "odd_one", Odd)
    scene, path = builtin_scene("courtyard"), builtin_reference("static", SIZE, 2)[1]
    given = {"size": SIZE, "image": torch.zeros(2, 3, 18, 32), "camera": path.camera, "person": scene.subject, **change}
    buffers = frozenset(given.keys() & {"image", "depth"} if given["image"] is not None else ())
    with pytest.raises(ModelError, match=f"^renderer odd_one: {line}"):
        drawn_by(Odd(lambda cameras: Features(**given)), scene, path.camera, buffers)


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("image", 255.0, r"image in \[0, 1\], got 0.5 to 255 \(return image.clamp\(0, 1\), or image / 255 of bytes\)"),
        ("label", -0.25, r"label in \[0, 1\], got -0.25 to 0.5 \("),
        ("alpha", torch.nan, r"alpha in \[0, 1\], got NaN \(0 where nothing is\)"),
        ("depth", -2.0, "depth above 0, and NaN where nothing is, got -2$"),
        ("depth", 0.0, "depth above 0, and NaN where nothing is, got 0$"),
        ("expected_depth", torch.inf, "expected_depth above 0, and NaN where nothing is, got inf$"),
    ],
)
def test_values_that_no_camera_sees_are_refused_though_one_pixel_alone_has_them(
    name: str, value: float, line: str
) -> None:
    scene, path = builtin_scene("courtyard"), builtin_reference("static", SIZE, 2)[1]
    given = torch.full((2, 3, 18, 32) if name == "image" else (2, 18, 32), 0.5)
    odd = Odd(lambda cameras: Features(SIZE, **{name: given}, camera=cameras, person=scene.subject))
    drawn_by(odd, scene, path.camera, frozenset({name}))
    given[1, ..., 3, 4] = value
    with pytest.raises(ModelError, match=f"^renderer Odd: expected {line}"):
        drawn_by(odd, scene, path.camera, frozenset({name}))


def test_what_rounding_leaves_and_a_depth_where_nothing_is_are_taken() -> None:
    scene, path = builtin_scene("courtyard"), builtin_reference("static", SIZE, 1)[1]
    depth, label = torch.full((1, 18, 32), torch.nan), torch.full((1, 18, 32), 1.0005)
    odd = Odd(lambda cameras: Features(SIZE, depth=depth, label=label, camera=cameras, person=scene.subject))
    assert drawn_by(odd, scene, path.camera, frozenset({"depth", "label"})).depth is depth
