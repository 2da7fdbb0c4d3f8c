"""A portrait reference, and motion as fast as it gets."""

from collections.abc import Callable
from typing import Any

import pytest


def test_a_portrait_reference_gives_a_portrait_shot(
    filmed: Callable[..., Any], solve: Callable[..., Any], errors_of: Callable[..., Any], sound: Callable[..., None]
) -> None:
    reference, truth = filmed("push_in", frames=3, size=(90, 160), coverage=0.4)
    found = solve(reference)
    sound(found)
    assert found.trajectory.camera.size == (90, 160)
    position, rotation, _ = errors_of(found, truth)
    assert position < 0.15
    assert rotation < 1.5


# crash zooms are tested below, moves of other directions in test_self_transfer.py and tests/driver
@pytest.mark.parametrize(
    "name",
    ["dutch", "handheld", *(pytest.param(n, marks=pytest.mark.slow) for n in ("crash_zoom", "boom", "truck", "tilt"))],
)
def test_every_move_ends_sound_and_framed(
    filmed: Callable[..., Any], solve: Callable[..., Any], sound: Callable[..., None], name: str
) -> None:
    reference, _ = filmed(name, frames=5)
    found = solve(reference)
    sound(found)
    assert float(found.verified.term("framing").values.mean()) < 0.03


def test_a_crash_zoom_keeps_the_size_of_the_person_in_every_frame(
    filmed: Callable[..., Any], solve: Callable[..., Any]
) -> None:
    reference, _ = filmed("crash_zoom", frames=24)
    assert float(solve(reference).verified.term("shot_size").values.max()) < 0.01  # measured 0.0015


def test_a_crash_zoom_is_not_taken_for_another_distance(
    filmed: Callable[..., Any], solve: Callable[..., Any], errors_of: Callable[..., Any]
) -> None:
    reference, truth = filmed("crash_zoom", frames=5)
    position, _, focal = errors_of(solve(reference), truth)
    assert position < 0.3
    assert focal < 10
