"""Curves of the terms: every value has a place, and only what is undefined has none."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure

from cltransfer.pipeline.scores import Term
from cltransfer.report.figures import _curves

NAN = float("nan")


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ([0.0, 0.5, 0.01, 1.0], ", log scale from 0.01"),
        ([0.02, 0.5, 0.01, 1.0], ", log scale"),
        ([0.0, 0.5, 0.3, 1.0], ""),
        ([NAN, 0.0, 0.001, 1.0], ", log scale from 0.001"),
    ],
)
def test_a_loss_of_nothing_is_drawn_on_a_log_scale_too(values: list[float], told: str) -> None:
    ax = Figure().subplots()
    _curves(ax, np.arange(4.0), Term("framing", "frame", 1.0, torch.tensor(values)), None, "transfer")
    places = ax.transData.transform(ax.lines[0].get_xydata())[:, 1]
    assert np.isfinite(places).tolist() == np.isfinite(values).tolist()
    low, high = ax.transAxes.transform([(0, 0), (0, 1)])[:, 1]
    known = places[np.isfinite(places)]
    assert low - 1e-6 <= known.min() <= known.max() <= high + 1e-6
    assert ax.get_title(loc="left") + ax.get_title() == f"framing [frame]{told}"
