"""The contact sheet of a lift says what its colours mean."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.report.contact_sheet import FOUND, GREEN, LEGEND, SEEN, TINT, _legend, _tile, write_contact_sheet
from cltransfer.testing.samples import sample_cameras, sample_features, sample_subject


def test_a_mask_of_fewer_pixels_tints_those_that_it_means() -> None:
    features = sample_features(1, 1)
    width, height = features.size
    image = torch.zeros(3, height, width)
    tiles = []
    for step in (1, 2):
        seen = features.having("subject", features.require("subject")[:, ::step, ::step])
        found: Any = SimpleNamespace(features=seen, cameras=sample_cameras(1, 1), subject=sample_subject())
        tiles.append(_tile(image, found, 0).any(-1))
    assert (tiles[0] == tiles[1]).mean() > 0.95


@pytest.mark.parametrize("width", [320, 640, 2560])
def test_the_legend_is_a_line_in_the_colours_that_it_explains_and_fits(width: int) -> None:
    line = _legend(width)
    assert line.shape == (LEGEND, width, 3)
    assert not line[:, -4:].any()
    for colour in (GREEN, SEEN, FOUND):
        assert float(np.abs(line.reshape(-1, 3).astype(int) - colour).sum(1).min()) < 120


def one_view(confidence: float, turned: float, masked: bool) -> Any:
    """A lift of one view, which looks at the person, or from there ``turned`` away from it (-1)."""
    features, ahead = sample_features(1, 1), sample_cameras(1, 1)
    keypoints = features.require("keypoints").clone()
    keypoints[..., 2] = confidence
    subject = torch.full_like(features.require("subject"), masked)
    camera = Camera.look_at(
        ahead.center, ahead.center - turned * ahead.center, torch.tensor([0.0, 0, 1]), 0.7, (64, 36)
    )
    seen = features.having("keypoints", keypoints).having("subject", subject)
    return SimpleNamespace(features=seen, cameras=camera, subject=sample_subject())


@pytest.mark.parametrize(
    ("confidence", "turned", "coloured"), [(0.1, -1.0, False), (0.9, -1.0, True), (0.1, 1.0, True)]
)
def test_joints_that_no_network_saw_or_that_lie_behind_the_camera_are_not_drawn(
    confidence: float, turned: float, coloured: bool
) -> None:
    tile = _tile(torch.zeros(3, 36, 64), one_view(confidence, turned, False), 0)
    assert bool((tile != tile[..., :1]).any()) == coloured  # all else is the black frame, and white text


def test_a_sheet_has_the_colours_of_its_legend(tmp_path: Path) -> None:
    write_contact_sheet(tmp_path / "lift.png", torch.zeros(1, 3, 36, 64), one_view(0.0, -1.0, True))
    sheet = cv2.imread(str(tmp_path / "lift.png"))
    assert sheet is not None
    assert np.median(sheet[LEGEND:, :64].reshape(-1, 3), axis=0).tolist() == (0.4 * TINT).tolist()
