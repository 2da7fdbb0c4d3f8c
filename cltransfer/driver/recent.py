"""Views that were seen last: what a search settles on it has seen already, as a candidate."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from ..camera import Camera
from ..feature_values import same_values
from ..features import Features
from .view import View

PIXELS, MOST = 1_500_000, 8_000_000  # of all views that are remembered; the maps of one take 30 to 60 bytes a pixel
PATHS = 1.25  # of a clip: one, and candidates about its frames; of 150 frames 1.05 spare as many renders as 3 do


@dataclass(frozen=True)
class Context:
    """What features depend on beside the camera. The same objects, not equal ones.

    Args:
        scene, renderer, plan: what is looked at, by what, and what reads the renders.
        guarded: whether the scene's own depth is kept beside what they read.
        size: (W, H) of the renders [px].
        before: the view of the frame before.
    """

    scene: Any
    renderer: Any
    plan: Any
    guarded: bool
    size: tuple[int, int]
    before: View | None

    @property
    def key(self) -> tuple[object, ...]:
        """Of these objects, as long as they are held."""
        return id(self.scene), id(self.renderer), id(self.plan), self.guarded, self.size, id(self.before)


@dataclass(frozen=True, eq=False)
class _Batch:
    context: Context
    view: View


@dataclass
class Recent:
    """The last batches of views, as many as ``pixels`` allow; a larger one is not remembered.

    A view that is found is a part of the batch that it was seen in, the same object each time. Where a journal answered
    for that batch it is looked at now, whole, so that a run that is gone on with has the same bits.
    """

    pixels: int = PIXELS
    _batches: deque[tuple[_Batch, list[tuple[object, ...]]]] = field(default_factory=deque)
    _views: dict[tuple[object, ...], tuple[_Batch, int]] = field(default_factory=dict)
    _held: int = 0

    @classmethod
    def of(cls, frames: int, size: tuple[int, int]) -> Recent:
        """Room for a clip of so many frames of ``size`` (W, H) [px].

        A path for which :data:`MOST` is too little is drawn anew each time: a part of it would be forgotten just before
        it is walked again. What is free is not asked: a run that is gone on with finds what it found at first.
        """
        room = max(PIXELS, math.ceil(PATHS * frames * size[0] * size[1]))
        return cls(room if room <= MOST else PIXELS)

    def add(self, context: Context, view: View) -> None:
        """Remember a view of B cameras."""
        size = len(view.cameras) * context.size[0] * context.size[1]
        if size > self.pixels:
            return
        batch, keys = _Batch(context, view), [(*context.key, *one) for one in _views(view.cameras)]
        self._batches.append((batch, keys))
        self._views |= {key: (batch, index) for index, key in enumerate(keys)}
        self._held += size
        while self._held > self.pixels:
            self._forget()

    def find(self, context: Context, camera: Camera) -> View | None:
        """The view of ``camera`` (1), None where it is not remembered."""
        batch, index = self._views.get((*context.key, *_views(camera)[0]), (None, 0))
        return None if batch is None else batch.view.part(index)

    def _forget(self) -> None:
        batch, keys = self._batches.popleft()
        self._held -= len(batch.view.cameras) * batch.context.size[0] * batch.context.size[1]
        for key in keys:
            if key in self._views and self._views[key][0] is batch:
                del self._views[key]


def standing(view: View, before: View | None) -> View:
    """The view ``before`` where this one, of one camera, is the same to the bit; else itself."""
    if before is None or len(view.cameras) > 1 or _views(view.cameras) != _views(before.cameras):
        return view
    return before if _alike(view.features, before.features) else view


def _alike(a: Features, b: Features) -> bool:
    names = a.names()
    if names != b.names() or a.size != b.size or a.reasons != b.reasons or a.person is not b.person:
        return False
    return all(same_values(a.require(name), b.require(name)) for name in names - {"camera", "person"})


def moving(cameras: Camera) -> int:
    """How many of B cameras differ from the one before them, from the first on, at least that one.

    What stands is to be seen frame by frame, since it need not be rendered as often.
    """
    views = _views(cameras)
    return next((i for i in range(1, len(views)) if views[i] == views[i - 1]), len(views))


def _views(cameras: Camera) -> list[tuple[object, ...]]:
    """The numbers of B cameras."""
    return [(cameras.size, w2c.tobytes(), K.tobytes()) for w2c, K in zip(cameras.w2c.numpy(), cameras.K.numpy())]
