"""Charts: every value of a term has a place; the path and the lens are told as one sees them."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from matplotlib import rc_context
from matplotlib.figure import Figure

from cltransfer.camera import Camera
from cltransfer.pipeline.scores import Scores, Term
from cltransfer.report.data import ReportData
from cltransfer.report.figures import _STYLE, _curves, lens_curves, term_curves, top_view
from cltransfer.testing import sample_subject
from cltransfer.trajectory import Trajectory

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


@pytest.mark.parametrize("values", [[0.0, 1e-7, 3.0], [0.0, 0.01, 1.0], [0.0, 0.02, 7e5], [0.0, 0.29, 9.1]])
def test_no_two_values_at_a_log_axis_lie_over_one_another(values: list[float]) -> None:
    with rc_context(_STYLE):
        figure = Figure(figsize=(6.4, 1.45), layout="constrained")  # as a term alone has
        ax = figure.subplots()
        _curves(ax, np.arange(3.0), Term("framing", "frame", 1.0, torch.tensor(values)), None, "transfer")
        figure.draw_without_rendering()
    places = sorted(tuple(label.get_window_extent().intervaly) for label in ax.get_yticklabels())
    assert len(places) >= 2
    assert all(before[1] < after[0] for before, after in pairwise(places))
    told = [float(label.get_text()) for label in ax.get_yticklabels()]
    assert told == pytest.approx(list(ax.get_yticks()))
    assert min(told) == 0
    assert max(values) / 10 < max(told) <= max(values)


@pytest.mark.parametrize("values", [[NAN, NAN, NAN, NAN], [NAN, 0.2, 0.3, NAN]])
def test_a_chart_goes_over_all_of_the_clip_whatever_has_no_value(report: ReportData, values: list[float]) -> None:
    told = Scores((Term("framing", "frame", 1.0, torch.tensor(values)),), torch.tensor(values))
    whole = replace(told, terms=(replace(told.terms[0], values=torch.tensor([0.1, 0.2, 0.3, 0.1])),))
    gaps, full = (term_curves(replace(report, scores=one, baseline=None)) for one in (told, whole))
    ticks = re.compile(r'id="xtick_.*?>([\d.]+)</text>', re.DOTALL)
    assert ticks.findall(gaps) == ticks.findall(full)
    assert len(ticks.findall(full)) > 3


@pytest.mark.parametrize("size", [1e-6, 0.3, 3e6])
def test_the_values_at_an_axis_are_those_that_are_drawn(size: float) -> None:
    figure = Figure()
    ax = figure.subplots()
    values = size * torch.tensor([1.0, 2.0, 3.0, 2.0])
    _curves(ax, np.arange(4.0), Term("framing", "frame", 1.0, values), None, "transfer")
    figure.draw_without_rendering()
    told = [float(label.get_text()) for label in ax.get_yticklabels()]
    assert told == pytest.approx(list(ax.get_yticks()), rel=1e-5)
    assert max(told) > 2 * size
    assert ax.yaxis.get_offset_text().get_text() == ""


def path(eye: torch.Tensor, size: tuple[int, int] = (64, 36)) -> Trajectory:
    """Two frames from ``eye`` (3,) on, which look at the sample's person."""
    person = sample_subject()
    eyes = torch.stack([eye, eye + 0.1 * person.up])
    return Trajectory(Camera.look_at(eyes, person.anchor[None], person.up, 0.6, size), torch.arange(2).double())


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_from_above_a_camera_at_the_left_of_who_looks_up_the_page_is_at_its_left(side: float) -> None:
    person = sample_subject()
    drawn = top_view(path(person.anchor + 3 * side * person.left + 2 * person.facing), person)
    places = [(float(x), float(y)) for x, y in re.findall(r'<use [^>]*x="([-\d.]+)" y="([-\d.]+)"', drawn)]
    start, body = places[-2:]  # what is drawn last: the first camera, the person
    assert (start[0] < body[0]) == (side > 0)
    assert start[1] < body[1]


def test_a_focal_length_is_told_of_the_width_of_the_frame_as_other_programs_have_it() -> None:
    eye = torch.tensor([0.0, 4.0, 1.0], dtype=torch.float64)
    small, large, wide = (lens_curves(path(eye, size), None) for size in ((64, 36), (128, 72), (128, 36)))
    assert 'aria-label="focal length [mm on a gate 36 mm wide] over time"' in small
    assert small == large != wide
