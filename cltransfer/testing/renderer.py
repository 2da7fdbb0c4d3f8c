"""What a renderer keeps to."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import torch
from scipy.spatial import KDTree
from torch import Tensor

from ..camera import Camera
from ..features import Features
from ..scenes import Scene
from .cases import ComponentCase
from .samples import pixel_centres

SPACING = 0.15  # of the radius that is looked about, if a case tells no spacing
ABOUT = 0.3  # of that radius, that a primitive of the person may reach beyond its place
ASIDE = math.radians(25)  # that cameras are turned by: in the middle the distance along a ray is the depth
SHIFT = (6, 3)  # px to the right and down
UNLIKE = 0.05  # of what a buffer varies by, that it may change by where it is shifted
MOST = 0.9  # of the pixels have to be right: one at an edge may be either side's


class RendererCase(ComponentCase):
    """What a renderer keeps to.

    A test sets ``scene`` and ``points``: world points (P, 3) on its surfaces, at most ``spacing`` [scene units] apart,
    if not told otherwise 0.15 of the person's height, or of how far the points reach where the scene has no person.
    """

    scene: ClassVar[Scene]
    points: ClassVar[Tensor]  # (P, 3)
    spacing: ClassVar[float | None] = None

    def cameras(self, batch: int) -> Camera:
        """Cameras on a ring about the person, or about ``points`` where the scene has none."""
        up, (middle, radius) = self.scene.up.double(), self._about()
        aside = torch.linalg.cross(up, torch.eye(3, dtype=up.dtype)[up.abs().argmin()])
        aside = aside / aside.norm()
        angle = torch.linspace(0, 2 * math.pi, batch + 1, dtype=torch.float64)[:-1, None]
        ring = angle.cos() * aside + angle.sin() * torch.linalg.cross(up, aside) + 0.3 * up
        return Camera.look_at(middle + 3 * radius * ring, middle[None], up, math.radians(50), (48, 27))

    def _about(self) -> tuple[Tensor, float]:
        """What is looked at, (3,), and its radius: the person, or ``points`` where the scene has none."""
        points, person = self.points.double(), self.scene.subject
        if person is not None:
            return person.anchor, person.height
        middle = points.mean(0)
        return middle, float((points - middle).norm(dim=1).max())

    def _check_set(self) -> None:
        lacking = [name for name in ("scene", "points") if not hasattr(self, name)]
        how = "scene, as builtin_scene('plaza'), and points, world points (P, 3) on its surfaces"
        assert not lacking, f"the case has no {' and no '.join(lacking)}: set {how}"

    def render(self, batch: int, buffers: frozenset[str]) -> Features:
        """``batch`` frames of the scene."""
        self._check_set()
        return self._drawn(self.scene, self.cameras(batch), buffers)

    def _drawn(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """What the renderer draws where nobody asks for a gradient, as in a run."""
        with torch.no_grad():
            features: Features = self.component.render(scene, cameras, buffers)
        return features

    def test_renders_the_buffers_asked_for_and_no_more(self) -> None:
        self._check_set()
        beside = {"camera"} if self.scene.subject is None else {"camera", "person"}
        for buffer in self.component.provides:
            got = self.render(1, frozenset({buffer})).names()
            assert got - {"camera", "person"} == {buffer}
            assert beside <= got, "return Features(..., camera=cameras, person=scene.subject)"

    def test_shapes_follow_the_cameras(self) -> None:
        features = self.render(2, frozenset(self.component.provides))
        assert features.size == (48, 27)
        for buffer in self.component.provides:
            assert features.require(buffer).shape == ((2, 3, 27, 48) if buffer == "image" else (2, 27, 48))
            assert features.require(buffer).device.type == "cpu", f"return {buffer}.cpu()"
            assert not features.require(buffer).requires_grad, f"return {buffer}.detach()"

    def test_batch_equals_single(self) -> None:
        together = self.render(3, frozenset(self.component.provides))
        for i in range(3):
            alone = self._drawn(self.scene, self.cameras(3)[i], frozenset(self.component.provides))
            for buffer in self.component.provides:
                torch.testing.assert_close(
                    together[i].require(buffer), alone.require(buffer), atol=1e-4, rtol=1e-4, equal_nan=True
                )

    def test_coverage_and_colour_are_parts_of_one(self) -> None:
        features = self.render(2, frozenset(self.component.provides))
        for buffer in {"alpha", "label", "image"}.intersection(self.component.provides):
            values = features.require(buffer)
            assert bool(((values >= 0) & (values <= 1 + 1e-5)).all())

    def test_depth_is_above_zero_or_nan(self) -> None:
        features = self.render(2, frozenset(self.component.provides))
        for buffer in {"depth", "expected_depth"}.intersection(self.component.provides):
            values = features.require(buffer)
            fits = ((values > 0) & values.isfinite()) | values.isnan()
            assert bool(fits.all()), f"expected {buffer} above 0 and finite, and NaN where nothing is"

    def test_depth_is_where_the_scene_is(self) -> None:
        """Nine in ten pixels with a depth unproject to within ``spacing`` of a surface point; where it draws one."""
        if "depth" not in self.component.provides:
            return
        self._check_set()
        features = self._drawn(self.scene, _turned(self.cameras(2)), frozenset({"depth"}))
        seen = features.require("depth").isfinite()
        assert bool(seen.flatten(1).any(1).all())
        distance, _ = KDTree(self.points.numpy()).query(_places(features)[seen].numpy())
        spacing = SPACING * self._about()[1] if self.spacing is None else self.spacing
        share, hint = (distance < spacing).mean(), "depth is along the optical axis, and no distance along the ray"
        assert share > MOST, f"{share:.0%} of the pixels are within {spacing:.3g} of a surface point: {hint}"

    def test_something_is_where_depth_is(self) -> None:
        """Nine in ten pixels that the scene covers by half or more have a depth, and no others."""
        if not {"alpha", "depth"} <= set(self.component.provides):
            return
        features = self.render(2, frozenset({"alpha", "depth"}))
        covered, known = features.require("alpha") >= 0.5, features.require("depth").isfinite()
        assert float((covered & known).sum()) >= MOST * float((covered | known).sum()), (
            "alpha is 0.5 or more elsewhere than depth is known"
        )

    def test_each_buffer_is_drawn_where_the_cameras_look(self) -> None:
        """A lens that is shifted shifts all that is drawn; what is mirrored goes the other way."""
        self._check_set()
        cameras, (right, down), buffers = self.cameras(2), SHIFT, frozenset(self.component.provides)
        K = cameras.K.clone()
        K[:, 0, 2] += right
        K[:, 1, 2] += down
        first, second = (self._drawn(self.scene, c, buffers) for c in (cameras, replace(cameras, K=K)))
        for buffer in sorted(buffers):
            wanted = first.require(buffer).nan_to_num(0.0)[..., :-down, :-right]
            apart = float((second.require(buffer).nan_to_num(0.0)[..., down:, right:] - wanted).abs().mean())
            varies = float((wanted - wanted.median()).abs().mean())
            told = f"a lens shifted by {SHIFT} px shifts {buffer} otherwise: is it mirrored, or K not heeded?"
            assert apart <= UNLIKE * varies + 1e-3 * float(wanted.abs().max()), told

    def test_label_is_that_of_the_scene(self) -> None:
        """Whoever is drawn first: nobody where nothing is marked, all that is there where everything is."""
        if not {"alpha", "label"} <= set(self.component.provides):
            return
        self.render(2, frozenset({"label"}))
        geometry = self.scene.geometry
        for marked in (0.0, 1.0):
            scene = replace(self.scene, geometry=geometry.with_label(torch.full((len(geometry),), marked)))
            features = self._drawn(scene, self.cameras(2), frozenset({"alpha", "label"}))
            label, covered = features.require("label") > 0.5, features.require("alpha") > 0.5
            wanted = covered if marked else torch.zeros_like(covered)
            told = (
                f"where scene.geometry.label is {marked:g} throughout expected label to be {'alpha' if marked else '0'}"
            )
            assert float((label & wanted).sum()) >= MOST * float((label | wanted).sum()), told

    def test_label_is_where_the_person_is(self) -> None:
        """Nine in ten pixels of the person unproject to about the primitives that are the person's."""
        if not {"depth", "label"} <= set(self.component.provides):
            return
        features, geometry = self.render(4, frozenset({"depth", "label"})), self.scene.geometry
        if geometry.label.shape != (len(geometry),) or not bool((geometry.label > 0.5).any()):
            return
        shown = (features.require("label") > 0.5) & features.require("depth").isfinite()
        assert bool(shown.any()), "no view shows label above 0.5, though scene.geometry.label is somewhere"
        person, beyond = geometry.means[geometry.label > 0.5].double(), ABOUT * self._about()[1]
        places = _places(features)[shown]
        near = ((places > person.amin(0) - beyond) & (places < person.amax(0) + beyond)).all(1)
        assert float(near.double().mean()) > MOST, "label is above 0.5 elsewhere than the primitives marked by it are"


def _turned(cameras: Camera) -> Camera:
    """The same, each turned to its side."""
    turn = torch.eye(4, dtype=torch.float64)
    turn[0, 0] = turn[2, 2] = math.cos(ASIDE)
    turn[0, 2], turn[2, 0] = math.sin(ASIDE), -math.sin(ASIDE)
    return replace(cameras, w2c=turn @ cameras.w2c)


def _places(features: Features) -> Tensor:
    """Where in the world the depth of each pixel is, (B, H, W, 3); NaN where there is none."""
    depth, (x, y) = features.require("depth"), pixel_centres(features.size)
    pixels = torch.stack([x, y], dim=-1).reshape(1, -1, 2).expand(len(depth), -1, 2)
    places: Tensor = features.require("camera").unproject(pixels, depth.flatten(1))
    return places.unflatten(1, depth.shape[1:])
