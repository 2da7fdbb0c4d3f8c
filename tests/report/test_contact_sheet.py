"""The contact sheet of a lift says what its colours mean."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from cltransfer.report.contact_sheet import FOUND, GREEN, LEGEND, SEEN, _legend, _tile
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
