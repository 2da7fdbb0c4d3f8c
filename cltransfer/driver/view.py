"""What cameras see: looked at when somebody wants it, since a journal may have answered what was asked of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ..camera import Camera
from ..features import Features


@dataclass(eq=False)
class View:
    """Features of B cameras that are looked at together. Another object is another view, though it may look the same.

    Args:
        cameras: B.
        look: gives their features; called once, when they are wanted.
        before: the view before, which ``look`` compares with; None where there is none.
    """

    cameras: Camera
    look: Callable[[], Features] | None
    before: View | None
    _features: Features | None = field(default=None, repr=False)
    _parts: dict[int, View] = field(default_factory=dict, repr=False)

    @property
    def features(self) -> Features:
        """What is seen, (B,)."""
        self.settle()
        assert self._features is not None
        return self._features

    def settle(self) -> None:
        """Look now, so that nothing is held that looking takes."""
        waiting, view = list[View](), self
        while view.look is not None:
            waiting.append(view)
            if view.before is None:
                break
            view = view.before
        while waiting:  # the oldest first: a path may be longer than calls may be nested
            waiting.pop()._look()

    def _look(self) -> None:
        if self.look is not None:
            self._features = self.look()
            self.look = self.before = None  # and whatever they hold

    def part(self, index: int) -> View:
        """The view of one of the cameras, the same object each time; of a single one it is this one."""
        if len(self.cameras) == 1:
            return self
        if index not in self._parts:
            self._parts[index] = View(self.cameras[index], lambda: self.features[index], self.before)
        return self._parts[index]
