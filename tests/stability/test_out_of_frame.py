"""The person leaves the frame, is cut by it, or fills it."""

from collections.abc import Callable
from typing import Any

import pytest
import torch

from cltransfer.losses.shot_size import degenerate
from cltransfer.run.flags import run_flags


@pytest.mark.parametrize("offset", [(0.45, 0.0), (0.0, 0.4)], ids=["right", "down"])
def test_a_person_cut_by_the_edge_stays_cut_by_the_edge(
    filmed: Callable[..., Any], solve: Callable[..., Any], sound: Callable[..., None], offset: tuple[float, float]
) -> None:
    reference, _ = filmed("push_in", frames=3, offset=offset)
    found = solve(reference)
    sound(found)
    assert float(found.verified.term("framing").values.max()) < 0.03


def test_a_person_who_leaves_the_frame_leaves_the_search_sound(
    filmed: Callable[..., Any], solve: Callable[..., Any], sound: Callable[..., None]
) -> None:
    reference, _ = filmed("pan", frames=5, coverage=1.6, offset=(0.3, 0.0))
    found = solve(reference)
    sound(found)
    seen = found.reference.features.require("subject").flatten(1).any(1)
    assert not bool(seen.all())  # the shot does what it is here for
    assert bool(seen.any())


def test_a_close_up_with_less_than_two_joints_is_flagged(
    filmed: Callable[..., Any], solve: Callable[..., Any], sound: Callable[..., None]
) -> None:
    reference, _ = filmed("static", frames=2, coverage=9.0)
    found = solve(reference)
    sound(found)
    assert bool(degenerate(found.reference.features).all())
    assert torch.isfinite(found.verified.term("shot_size").values).all()  # by the mask
    few = "fewer than two key joints in the reference: the size is that of the mask, and not certain"
    told = [(flag.frame, flag.reason) for flag in run_flags(found)]
    assert {(0, few), (1, few)} <= set(told)
    assert any(reason.startswith("degenerate: ") for _, reason in told)


def test_a_close_up_has_no_size_in_the_words_of_the_paper(
    filmed: Callable[..., Any], solve: Callable[..., Any], sound: Callable[..., None]
) -> None:
    reference, _ = filmed("static", frames=2, coverage=9.0)
    found = solve(reference, "losses.shot_size.mode=faithful")
    sound(found)
    assert found.verified.term("shot_size").defined == 0
    assert found.verified.term("shot_size").reason
