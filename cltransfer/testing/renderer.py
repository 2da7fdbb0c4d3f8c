"""What a renderer keeps to."""

from __future__ import annotations

import math
from typing import ClassVar

import torch
from scipy.spatial import KDTree
from torch import Tensor

from ..camera import Camera
from ..features import Features
from ..scenes import Scene
from .cases import ComponentCase
from .samples import pixel_centres


class RendererCase(ComponentCase):
    """What a renderer keeps to.

    A test sets ``scene`` and ``points``: world points (P, 3) on its surfaces, at most ``spacing`` apart.
    """

    scene: ClassVar[Scene]
    points: ClassVar[Tensor]  # (P, 3)
    spacing: ClassVar[float] = 0.2

    def cameras(self, batch: int) -> Camera:
        """Cameras on a ring about the person, or about ``points`` where the scene has none."""
        points, up, person = self.points.double(), self.scene.up.double(), self.scene.subject
        middle = points.mean(0) if person is None else person.anchor
        radius = (points - middle).norm(dim=1).max() if person is None else torch.tensor(person.height)
        aside = torch.linalg.cross(up, torch.eye(3, dtype=up.dtype)[up.abs().argmin()])
        aside = aside / aside.norm()
        angle = torch.linspace(0, 2 * math.pi, batch + 1, dtype=torch.float64)[:-1, None]
        ring = angle.cos() * aside + angle.sin() * torch.linalg.cross(up, aside) + 0.3 * up
        return Camera.look_at(middle + 3 * radius * ring, middle[None], up, math.radians(50), (48, 27))

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
        features = self.render(2, frozenset({"depth"}))
        x, y = pixel_centres(features.size)
        pixels = torch.stack([x, y], dim=-1).reshape(1, -1, 2).expand(2, -1, 2)
        depth = features.require("depth").flatten(1)
        seen = depth.isfinite()
        assert bool(seen.any(1).all())
        world = features.require("camera").unproject(pixels, depth)[seen]
        distance, _ = KDTree(self.points.numpy()).query(world.numpy())
        assert (distance < self.spacing).mean() > 0.9
