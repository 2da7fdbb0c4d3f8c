"""The scene as a search needs it: merged to what can be told apart from where it looks, anew when it moves on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

from ..camera import Camera
from ..scenes import Scene
from ..scenes.simplify import working_set

MOVE = 0.25  # of the distance to the subject: farther from where it was built, a working set is built anew
ZOOM = 1.25  # the same for a longer or shorter focal length


@dataclass(frozen=True, eq=False)
class WorkingSet:
    """A scene and the view it is merged for.

    Args:
        full: the scene.
        camera: the view, (1), at the size it is rendered at.
        k: voxel size in pixels, > 0.

    Raises:
        UsageError: on building, the scene is not made of splats.
    """

    full: Scene
    camera: Camera
    k: float

    @cached_property
    def scene(self) -> Scene:
        """The merged scene, built on first use: about a second for 500k Gaussians."""
        return working_set(self.full, self.camera, self.k)

    def about(self, camera: Camera) -> WorkingSet:
        """The working set for a search about ``camera`` (1): this one, or a new one if it is too far from its view."""
        return self if self._covers(camera) else replace(self, camera=camera)

    def _covers(self, camera: Camera) -> bool:
        moved = float((camera.center - self.camera.center).norm())
        zoom = float((camera.focal / self.camera.focal).log())
        return moved <= MOVE * self._distance and abs(zoom) <= math.log(ZOOM)

    @cached_property
    def _distance(self) -> float:
        """From the view to the subject, or to the middle of a scene without one, scene units."""
        subject = self.full.subject
        middle = self.full.geometry.means.double().median(0).values if subject is None else subject.anchor
        return float((self.camera.center[0] - middle).norm())
