"""Frames of the reference without a person: named, never invented, and the frames around them hold."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.errors import InputError
from cltransfer.run.flags import run_flags
from cltransfer.run.folder import write_run
from cltransfer.scenes.load import load_scene
from cltransfer.shots import Setup, shot
from cltransfer.storage.run_files import open_run
from cltransfer.transfer import Inputs

PERSON = ("shot_size", "framing", "camera_angle")


@pytest.mark.parametrize(("frames", "gone"), [(4, [1, 2]), (6, [5]), (4, [0])], ids=["middle", "last", "first"])
def test_frames_without_a_person_are_undefined_and_the_rest_is_found(
    filmed: Callable[..., Any],
    solve: Callable[..., Any],
    edited: Callable[..., str],
    blanked: Callable[..., Any],
    sound: Callable[..., None],
    frames: int,
    gone: list[int],
) -> None:
    reference, _ = filmed("push_in", frames=frames)
    found = solve(edited(reference, blanked(gone)))
    sound(found)
    kept = [i for i in range(frames) if i not in gone]
    for name in PERSON:
        values = found.verified.term(name).values
        assert torch.isnan(values[gone]).all(), name
        assert torch.isfinite(values[kept]).all(), name
    assert float(found.verified.term("framing").values[kept].max()) < 0.02
    assert float(found.verified.term("shot_size").values[kept].max()) < 0.03


@pytest.mark.parametrize("preset", [pytest.param("fast", marks=pytest.mark.slow), "balanced"])
def test_a_clip_that_begins_without_the_person_is_refined_all_the_same(
    filmed: Callable[..., Any],
    solve: Callable[..., Any],
    edited: Callable[..., str],
    blanked: Callable[..., Any],
    preset: str,
) -> None:
    reference, _ = filmed("orbit", frames=6, azimuth=0.5, elevation=0.25)
    found = solve(edited(reference, blanked([0, 1])), f"preset={preset}", "path=exact", "extract.verify=false")
    assert float(found.verified.term("camera_angle").values[2:].max()) < 0.12
    assert float(found.verified.term("framing").values[2:].max()) < 0.02


def test_a_run_with_gaps_is_written_without_a_nan(
    filmed: Callable[..., Any],
    solve: Callable[..., Any],
    edited: Callable[..., str],
    blanked: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    reference, _ = filmed("push_in", frames=4)
    source = edited(reference, blanked([1]))
    inputs = Inputs("builtin:courtyard", source)
    folder = open_run(tmp_path / "run")
    write_run(folder, solve(source), inputs, load_config())
    written = json.loads((folder / "metrics.json").read_text(), parse_constant=pytest.fail)
    framing = written["metrics"]["framing"]
    assert (framing["values"][1], framing["defined"], framing["frames"]) == (None, 3, 4)
    assert framing["reason"]
    assert any(flag["frame"] == 1 for flag in written["flags"])
    assert "nan" not in (folder / "metrics.csv").read_text().lower()
    json.loads((folder / "trajectory.json").read_text(), parse_constant=pytest.fail)


def test_no_person_at_all_is_refused(
    filmed: Callable[..., Any], solve: Callable[..., Any], edited: Callable[..., str], blanked: Callable[..., Any]
) -> None:
    reference, _ = filmed("push_in", frames=3)
    with pytest.raises(InputError, match=r"person: none found in 3 frames"):
        solve(edited(reference, blanked([0, 1, 2])))


def test_a_trajectory_that_shows_nobody_of_its_scene_is_told(
    filmed: Callable[..., Any], solve: Callable[..., Any], tmp_path: Path
) -> None:
    """The person's joints are known, but something is before all of them."""
    told = "no frame of the reference shows the person: the result moves alike, and stands anywhere"
    scene = load_scene("builtin:plaza")
    assert scene.subject is not None
    shot("static", scene.subject, (96, 54), 2, setup=Setup(coverage=0.45, distance=9)).save(tmp_path / "hidden.json")
    hidden, shown = (solve(source) for source in (f"builtin:plaza@{tmp_path / 'hidden.json'}", filmed("pan", 2)[0]))
    assert [flag.reason for flag in run_flags(hidden) if "shows the person" in flag.reason] == [told]
    assert not [flag for flag in run_flags(shown) if "shows the person" in flag.reason]
