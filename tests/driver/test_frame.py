"""What one frame teaches the next."""

import torch

from cltransfer.driver.frame import SAME, Memory


def test_a_frame_that_begins_as_the_last_one_ended_has_nothing_new() -> None:
    residuals = torch.tensor([0.3, -0.1, 0.0], dtype=torch.float64)
    memory = Memory(settled=residuals)
    assert memory.nothing_new(residuals)
    assert memory.nothing_new(residuals + 0.5 * SAME)
    assert not memory.nothing_new(residuals + torch.tensor([0.0, 0.0, 2 * SAME]))


def test_nothing_is_known_to_be_the_same_where_the_last_frame_could_still_gain() -> None:
    assert not Memory().nothing_new(torch.zeros(3, dtype=torch.float64))
