"""Where frames stand in time: what may be, even ones are counted, a pause and a burst are bounded; what is filtered."""

from __future__ import annotations

import pytest
import torch

from cltransfer import along_clip
from cltransfer.along_clip import LATEST, LONGEST, WIDEST, along, check_span, check_times, counted, places
from cltransfer.clips.thinned import evenly
from cltransfer.errors import InputError


@pytest.mark.parametrize("rate", [23.976, 24.0, 30.0, 29.97])
def test_evenly_spaced_frames_are_counted(rate: float) -> None:
    assert places(torch.arange(240).double() / rate) is None
    assert places(torch.arange(240).float() / rate) is None
    assert places(torch.tensor([0.0, 1.0])) is None
    assert counted(3).tolist() == [0, 1, 2]


def test_a_thinned_clip_keeps_its_time() -> None:
    times = torch.arange(60).double()[evenly(torch.arange(60).double(), 24)] / 30
    at = places(times)
    assert at is not None
    assert counted(24, at) is at
    assert float((at / at[-1] - times / times[-1]).abs().max()) < 1e-12
    short, long = sorted({round(step, 6) for step in at.diff().tolist()})
    assert long / short == pytest.approx(3 / 2, abs=1e-5)  # every second and every third frame


def test_a_pause_and_a_burst_weigh_no_more_than_a_few_frames() -> None:
    at = places(torch.tensor([0.0, 1.0, 2.0, 2.001, 100.0, 101.0, 102.0]))
    assert at is not None
    assert at.diff().tolist() == [1.0, 1.0, 1 / WIDEST, WIDEST, 1.0, 1.0]


@pytest.mark.parametrize("rate", [240, 480, 960, 1000])
@pytest.mark.parametrize("clock", [1000, 90_000])
@pytest.mark.parametrize("start", [0.0, 1.8e9])
def test_times_of_high_frame_rates_are_taken_as_any_clock_keeps_them(rate: int, clock: int, start: float) -> None:
    times = start + (torch.arange(2000).double() / rate * clock).round() / clock
    check_times("clip", "t", times)


def test_one_frame_and_bursts_and_years_are_taken() -> None:
    check_times("clip", "t", torch.tensor([-LATEST], dtype=torch.float64))
    check_times("clip", "t", torch.tensor([-LATEST, 0.0, 1e-6, 0.0333, 0.0336, LATEST], dtype=torch.float64))


def test_a_span_that_no_mp4_holds_is_refused() -> None:
    check_span("clip", "t", torch.tensor([-LONGEST, 0.0], dtype=torch.float64), "#t=1,2")
    line = r"^clip: t: expected at most 1e\+06 s from the first frame to the last, got 2e\+06 s \(#t=1,2\)$"
    with pytest.raises(InputError, match=line):
        check_span("clip", "t", torch.tensor([-LONGEST, 0.0, LONGEST], dtype=torch.float64), "#t=1,2")


@pytest.mark.parametrize("times", [[0, float("nan")], [0, float("inf")], [2 * LATEST], [0, 1e-7]])
def test_times_that_are_none_of_frames_are_refused(times: list[float]) -> None:
    with pytest.raises(InputError, match=r"^clip: t: expected .* \(frames=N\)$"):
        check_times("clip", "t", torch.tensor(times, dtype=torch.float64), "frames=N")


def test_the_filter_keeps_a_line_to_its_ends_and_lowers_noise() -> None:
    line = torch.linspace(-1, 2, 30, dtype=torch.float64)[:, None]
    torch.testing.assert_close(along(line, 1.5), line)
    noise = 0.1 * torch.randn(30, 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert float((along(line + noise, 1.5) - line).std()) < 0.6 * float(noise.std())


@pytest.mark.parametrize("even", [True, False])
def test_a_long_clip_is_filtered_in_parts_as_a_short_one_is(even: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    generator = torch.Generator().manual_seed(0)
    x = torch.randn(200, 3, generator=generator, dtype=torch.float64).cumsum(0)
    x[::7, 1] = torch.nan
    at = None if even else torch.rand(200, generator=generator, dtype=torch.float64).add(0.2).cumsum(0)
    whole = along(x, 1.5, at)
    monkeypatch.setattr(along_clip, "BLOCK", 64)
    torch.testing.assert_close(along(x, 1.5, at), whole, rtol=0, atol=1e-12, equal_nan=True)
    monkeypatch.undo()
    assert along(torch.zeros(100_000, 1), 1.0).shape == (100_000, 1)  # all against all would take 40 GB
