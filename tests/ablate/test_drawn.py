"""References that the seed draws: those of published ablations stay what they were."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from cltransfer.ablate.drawn import draw_references, drawn_setup
from cltransfer.ablate.read import read_sweep
from cltransfer.shots import Setup
from cltransfer.trajectory import Trajectory


@pytest.mark.parametrize(
    ("name", "seed", "degrees", "offset"),
    [
        ("push_in", 0, (22.2933, 3.4779), (-0.0715, -0.0325)),
        ("orbit", 1, (8.422, 9.608), (-0.0084, 0.0234)),
        ("static", 2, (-18.0526, 0.615), (-0.1154, 0.0023)),
    ],
)
def test_a_published_reference_is_drawn_as_it_was(
    name: str, seed: int, degrees: tuple[float, float], offset: tuple[float, float]
) -> None:
    setup = drawn_setup(name, seed)
    assert (math.degrees(setup.azimuth), math.degrees(setup.elevation)) == pytest.approx(degrees, abs=1e-4)
    assert setup.offset == pytest.approx(offset, abs=1e-4)
    assert setup == Setup(setup.azimuth, setup.elevation, offset=setup.offset, seed=seed)  # all else is the shot's own


def test_its_cameras_stay_where_they_were(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text("references: ['drawn:orbit']\nseeds: [1]\nrows: {full: {}}\n")
    made = draw_references(read_sweep(str(tmp_path / "sweep.yaml")), tmp_path)
    scene, path = made["drawn:orbit", 1].split("@")
    camera = Trajectory.load(path).camera
    assert (scene, len(camera), camera.size) == ("builtin:plaza-1", 24, (640, 360))
    ends = [[*camera.center[i].tolist(), *camera.focal[i].flatten().tolist()] for i in (0, -1)]
    assert ends == [
        pytest.approx([5.3726, -2.018, 0.8388, 655.2], abs=1e-3),
        pytest.approx([1.9672, -2.018, 5.0597, 655.2], abs=1e-3),
    ]


@pytest.mark.parametrize(("rows", "frames"), [("{a: {}, b: {frames: 3}}", 24), ("{a: {frames: 5}, b: {frames: 3}}", 5)])
def test_it_has_as_many_frames_as_the_row_that_takes_most(tmp_path: Path, rows: str, frames: int) -> None:
    (tmp_path / "sweep.yaml").write_text(f"references: ['drawn:pan']\nrows: {rows}\n")
    made = draw_references(read_sweep(str(tmp_path / "sweep.yaml")), tmp_path)
    assert len(Trajectory.load(made["drawn:pan", 0].split("@")[1])) == frames
