"""Rounds: what one of them tells the next."""

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from cltransfer.driver.closed_form import Guide
from cltransfer.run.correct import Bias
from cltransfer.run.rounds import Round, _guide

FRAMES = 3


@pytest.mark.parametrize("off", [0.0, 0.02])  # that the round before was aimed off by, and its guide
def test_a_frame_that_was_not_reached_is_as_high_in_the_next_round_as_it_was_read_less_the_bias(off: float) -> None:
    x = torch.rand(FRAMES, 7, dtype=torch.float64)
    read = Guide(x - 5, torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64) - off)
    take: Any = SimpleNamespace(clip=SimpleNamespace(about=lambda home, path: path + 1), x=x, guide=read)
    nothing: Any = None
    now = Round(take, nothing, nothing, torch.full((FRAMES,), off, dtype=torch.float64))
    angles = torch.zeros(FRAMES, 3, dtype=torch.float64)
    angles[:, 1] = torch.tensor([0.0, 0.05, -0.05], dtype=torch.float64)
    found = _guide(now, nothing, Bias(torch.zeros(FRAMES, 14, 2), angles))
    torch.testing.assert_close(found.x, x + 1)
    torch.testing.assert_close(found.pitch, torch.tensor([0.1, 0.15, 0.35], dtype=torch.float64))
