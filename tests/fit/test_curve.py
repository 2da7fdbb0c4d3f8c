"""The curve of a fit: what is told of its levels can be read."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from cltransfer.fit._curve import Level, _draw, write_curve

QUALITY = {16_000: 18.1, 64_000: 20.1, 256_000: 23.1, 1_024_000: 24.1, 2_000_000: 24.15}  # levels as they are made


def levels(quality: dict[int, float]) -> list[Level]:
    """All kept but the last one."""
    return [Level(n, n, psnr, 100, 40.0, n < max(quality)) for n, psnr in quality.items()]


@pytest.mark.parametrize(
    "quality",
    [
        QUALITY,
        {100_000: 21.3, 200_000: 23.1, 400_000: 24.0, 500_000: 24.1},
        {1000: 21.3, 1050: 21.3, 1100: 21.31, 1200: 21.2, 1300: 21.25, 1_000_000: 28.0},
        {200_000: 21.3},
    ],
)
def test_no_two_levels_are_told_of_over_one_another(quality: dict[int, float]) -> None:
    figure = Figure((5, 3.2), layout="constrained")
    _draw(figure, levels(quality), "cells")
    figure.draw_without_rendering()
    (axes,) = figure.axes
    numbers = [label for label in axes.get_xticklabels() if label.get_text()]
    assert 1 <= len(numbers) == len(axes.texts)
    upper, lower = ([n for n in numbers if n.get_text().startswith("\n") == below] for below in (False, True))
    for texts in (upper, lower, axes.texts):
        boxes = [text.get_window_extent() for text in texts]
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


def test_levels_that_have_room_are_all_told_of(tmp_path: Path) -> None:
    write_curve(tmp_path, levels(QUALITY), "Gaussians")
    drawn = (tmp_path / "curve.svg").read_text()
    assert all(f">{cells:,}</text>" in drawn for cells in QUALITY)
    assert ">Gaussians</text>" in drawn
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == 1 + len(QUALITY)
