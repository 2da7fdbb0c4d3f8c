"""Frames of a clip are read by extractors whose values are ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import torch

from cltransfer.errors import ModelError
from cltransfer.features import Features
from cltransfer.pipeline.plan import make_plan
from cltransfer.reading.frames import clip_features

BOX = np.array([[10.0, 4.0, 20.0, 30.0, 0.9], [40.0, 8.0, 10.0, 20.0, 0.8]], np.float32)
FRAMES = torch.zeros(3, 3, 36, 64, dtype=torch.uint8)


@dataclass(frozen=True)
class Detector:
    """Two persons who stand, in pixels or as parts of the frame."""

    per: tuple[float, float] = (1, 1)
    provides: tuple[str, ...] = ("box",)
    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image",)

    def persons(self, now: Features) -> list[np.ndarray]:
        return [BOX / np.array([*self.per, *self.per, 1], np.float32)] * len(now)

    def __call__(self, now: Features, before: Features | None) -> Features:
        boxes = torch.from_numpy(np.stack(self.persons(now))[:, 0])
        return now.having("box", boxes).having("tall", boxes[:, 3])


@pytest.mark.parametrize("provides", [("box",), ("box", "tall")])  # a mere detector, and one that tells more
def test_persons_as_parts_of_the_frame_are_refused(provides: tuple[str, ...]) -> None:
    def read(detector: Detector) -> Features:
        return clip_features(FRAMES, make_plan(frozenset(provides), {"mine": detector}, frozenset({"image"}), "image"))

    torch.testing.assert_close(
        read(Detector(provides=provides)).require("box")[:, :4], torch.from_numpy(BOX[[0] * 3, :4])
    )
    line = r"^extractor mine: box: expected pixels of a frame of 64 x 36, got .* \(multiply x by the width and"
    with pytest.raises(ModelError, match=line):
        read(Detector((64, 36), provides))


def test_frames_that_show_nobody_have_no_box() -> None:
    class Blind(Detector):
        def persons(self, now: Features) -> list[np.ndarray]:
            return [np.zeros((0, 5), np.float32)] * len(now)

    plan = make_plan(frozenset({"box"}), {"mine": Blind()}, frozenset({"image"}), "image")
    assert bool(clip_features(FRAMES, plan).require("box").isnan().all())
