"""The scene as a search needs it: merged to what can be told apart from where it looks, anew when it moves on.

The first frame is searched far and wide, where a coarse scene ranks candidates like the whole one; later frames are
searched among neighbours, which a finer one tells apart. Paths are filtered, read back and rendered in the whole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

from ..camera import Camera
from ..scenes import Scene
from ..scenes.simplify import working_set

MOVE = 0.25  # of the distance to the subject: farther from where it was built, a working set is built anew
ZOOM = 1.25  # the same for a longer or shorter focal length
SHARES = (1.0, 0.75, 0.5)  # of k, frame by frame; the last is for all that follow


@dataclass(frozen=True, eq=False)
class WorkingSet:
    """A scene and the view it is merged for.

    Args:
        full: the scene.
        camera: the view, (1), at the size it is rendered at.
        k: voxel size in pixels at its coarsest, > 0.
        frame: of the search, which ``SHARES`` makes finer.

    Raises:
        UsageError: on building, the scene is not made of splats.
        ResourceError: on building, there is not enough memory to merge it.
    """

    full: Scene
    camera: Camera
    k: float
    frame: int = 0

    @cached_property
    def scene(self) -> Scene:
        """The merged scene, built on first use: about a second for 500k Gaussians."""
        return working_set(self.full, self.camera, self.k * SHARES[self.frame])

    def about(self, camera: Camera) -> WorkingSet:
        """The working set for the next frame, about ``camera`` (1).

        It is this one, unless a finer one is due or the camera is too far from the view it was built for.
        """
        frame = min(self.frame + 1, len(SHARES) - 1)
        return self if frame == self.frame and self._covers(camera) else replace(self, camera=camera, frame=frame)

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
