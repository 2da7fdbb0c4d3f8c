"""Depth without a network, from the camera's own movement along the clip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import torch

from ..feature_shapes import on_grid
from ..features import Features, OfThisRun
from ..registry import EXTRACTORS
from ..sfm import NoPathError, OutOfTimeError
from ._pixels import to_uint8


@EXTRACTORS.register("depth_sfm")
@dataclass(frozen=True)
class DepthSfm:
    """Depth of what stands still, by structure from motion, up to one scale for the whole clip.

    Where the camera stands still, turns or zooms only, there is no depth, and the reason says so before anything is
    reconstructed. The subject is not relied on for the cameras; it has a depth as far as it stood still. Frames that no
    camera was found for are taken to lie evenly between their neighbours: an extractor is not told when they are shown.
    Needs the extra ``sfm``.

    Args:
        reach: how far from a point its depth is taken to hold [frame widths].
        min_confidence: of a point that counts, in [0, 1]; 0.5 is a relative error of the depth of 0.1.
        lens: focal length [longer sides of the frame] where it is known.
        seconds: COLMAP's mapper may take, over its first guesses of the lens (three; one where ``lens`` is named), each
            at least 1 s; it looks at the clock between frames. Corners and their matches before it, and after it the
            looks whether space is inside out and whether the lens changes, and the points, are not counted: they depend
            on the clip alone.
    """

    requires: ClassVar[tuple[str, ...]] = ("image", "subject")
    provides: ClassVar[tuple[str, ...]] = ("depth", "depth_confidence")
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    whole_clip: ClassVar[bool] = True
    reach: float = 0.1
    min_confidence: float = 0.5
    lens: float | None = None
    seconds: float = 60.0

    def __post_init__(self) -> None:
        if not self.reach > 0 or not self.seconds > 0 or not (self.lens is None or self.lens > 0):
            raise ValueError(f"reach, lens and seconds must be positive, got {self.reach}, {self.lens}, {self.seconds}")
        if not 0 <= self.min_confidence <= 1:
            raise ValueError(f"min_confidence must be in [0, 1], got {self.min_confidence}")

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        """``found`` with ``depth`` and ``depth_confidence``, or with the reason why the clip does not tell.

        Raises:
            ModelError: pycolmap is not installed.
        """
        from ..sfm.depth import spread_depth
        from ..sfm.path import reconstruct_path

        subject = on_grid(found.require("subject"), found.size[::-1])  # a network's may have fewer pixels
        frames = (to_uint8(load(i, i + 1).require("image"))[0] for i in range(len(found)))
        times = torch.arange(len(found), dtype=torch.float64)
        try:
            clip = reconstruct_path(frames, subject, times, lens=self.lens, seconds=self.seconds)
        except OutOfTimeError as error:
            more = f"extractors.depth_sfm.seconds={2 * self.seconds:g}"
            return self._without(found, f"{error.reason} ({more})", OfThisRun)
        except NoPathError as error:
            return self._without(found, f"{error.reason} ({error.hint})")
        depth, confidence = spread_depth(clip.points, subject, self.reach, self.min_confidence)
        if not bool((subject & depth.isfinite()).any()):
            return self._without(found, "no point on the subject stands still (it moves, or shows too little)")
        return replace(found, depth=depth, extras={**found.extras, "depth_confidence": confidence})

    def _without(self, found: Features, reason: str, kind: type[str] = str) -> Features:
        told = dict.fromkeys(self.provides, kind(f"depth_sfm: {reason}"))
        return replace(found, reasons={**found.reasons, **told})
