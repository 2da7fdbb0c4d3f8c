"""A path between lookups: turned aside, steady where they are, smooth over some of the frames to the next."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.driver.closed_form import BEND, BETWEEN, LONGEST, SIDES, _Sampled
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.search.subject_orbit import SCALE, SubjectOrbit


def sampled(frames: int, looked_up: list[int], at: Tensor | None = None) -> _Sampled:
    """So many frames at no distance yet, of which a few are looked up; nothing is rendered."""
    clip = WholeClip(None, SubjectOrbit(), None, None, at)  # type: ignore[arg-type]
    x = torch.rand(frames, 7, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return _Sampled(clip, x, 0.6 * x[:, 1], np.array(looked_up))


@pytest.mark.parametrize(("looked_up", "share"), [([2, 5, 8, 11], 0.4), ([0, 2, 4], 0.6), ([7], 1.0), ([0, 1, 2], 1.0)])
def test_a_bend_costs_by_how_much_of_the_clip_between_is_looked_up(looked_up: list[int], share: float) -> None:
    assert sampled(20, looked_up).rate == pytest.approx(BEND * share)


@pytest.mark.parametrize("each", [True, False])
def test_a_path_is_turned_about_the_person_in_radians_and_read_so_much_higher(each: bool) -> None:
    here = sampled(5, [0, 4])
    by = torch.tensor(SIDES[3], dtype=torch.float64)
    if each:
        by = torch.arange(1, 6, dtype=torch.float64)[:, None] * torch.tensor([0.2, -0.1])
    there, moved = here.turned(by), torch.zeros(5, 7, dtype=torch.float64)
    moved[:, :2] = by
    torch.testing.assert_close((there.x - here.x) * SCALE, moved)
    torch.testing.assert_close(there.pitch - here.pitch, moved[:, 1])
    torch.testing.assert_close(here.x, sampled(5, [0, 4]).x, rtol=0, atol=0)


def test_a_path_is_turned_no_higher_than_the_steepest_camera_that_there_is() -> None:
    here, highest = sampled(5, [0, 4]), SubjectOrbit().bounds()[1]
    here.x[2, 1], here.pitch[2] = highest[1], 1.4
    there = here.turned(torch.tensor(SIDES[2]))
    assert float(there.x[2, 1]) == float(highest[1])
    assert float(there.pitch[2]) == pytest.approx(1.4 + SIDES[2][1])  # what is to be read there all the same
    assert here.turned(torch.zeros(2)) is here


def test_a_path_between_lookups_goes_on_steadily_however_frames_are_spaced() -> None:
    at = torch.tensor([0.0, 1, 3, 4, 6, 7, 9, 10, 12], dtype=torch.float64)
    here = sampled(9, [0, 3, 8], at)
    told, steady = at[here.frames].numpy(), torch.stack([0.02 * at, -0.01 * at, 0.1 + 0.03 * at], dim=1)
    path = here.path(0.1 + 0.03 * told, np.stack([0.02 * told, -0.01 * told], axis=1))
    torch.testing.assert_close((path.x - here.x)[:, :2] * SCALE[:2], steady[:, :2])
    torch.testing.assert_close(path.x[:, 3] * SCALE[3], steady[:, 2])
    torch.testing.assert_close(path.x[:, [2, 4, 5, 6]], here.x[:, [2, 4, 5, 6]], rtol=0, atol=0)
    torch.testing.assert_close(path.pitch - here.pitch, steady[:, 1])


@pytest.mark.parametrize(("apart", "over"), [(2, 2 * BETWEEN), (3, 3 * BETWEEN), (20, LONGEST)])
def test_a_path_bends_at_a_lookup_over_some_of_the_frames_to_the_next(apart: int, over: float) -> None:
    """A tent under a Gaussian is lower at its top by the mean of how far that looks."""
    here = sampled(8 * apart + 1, [apart * k for k in range(9)])
    tent = 0.1 * (4 - np.abs(np.arange(9) - 4.0))
    found = here.path(tent, np.zeros((9, 2))).x[:, 3] * SCALE[3]
    away = np.abs(np.arange(-4 * apart, 4 * apart + 1))
    looked = np.average(away, weights=np.exp(-0.5 * (away / over) ** 2))
    assert 0.4 - float(found[4 * apart]) == pytest.approx(0.1 / apart * looked, rel=1e-3)


def test_a_single_lookup_tells_the_whole_path() -> None:
    here = sampled(6, [2])
    path = here.path(np.array([0.7]), np.array([[0.1, 0.05]]))
    torch.testing.assert_close(path.x[:, 3] * SCALE[3], torch.full((6,), 0.7, dtype=torch.float64))
    torch.testing.assert_close(path.pitch - here.pitch, torch.full((6,), 0.05, dtype=torch.float64))
