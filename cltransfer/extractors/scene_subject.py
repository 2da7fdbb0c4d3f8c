"""The person's pixels, read from the scene's labels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from ..features import Features
from ..registry import EXTRACTORS


@EXTRACTORS.register("scene_subject")
@dataclass(frozen=True)
class SceneSubject:
    """Pixels that the subject covers by more than ``threshold``, in [0, 1)."""

    threshold: float = 0.5

    requires: ClassVar[tuple[str, ...]] = ("label",)
    provides: ClassVar[tuple[str, ...]] = ("subject",)
    family: ClassVar[Literal["image", "scene", "both"]] = "scene"

    def __post_init__(self) -> None:
        if not 0 <= self.threshold < 1:
            raise ValueError(f"threshold must be in [0, 1), got {self.threshold}")

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` with ``subject``."""
        return replace(now, subject=now.require("label") > self.threshold)
