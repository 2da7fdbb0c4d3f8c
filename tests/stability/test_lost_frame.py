"""The lean way loses a frame of 24: the clip is followed thoroughly, unless the path passes that frame by."""

from pathlib import Path

import pytest

from cltransfer.bench.driver import SIZE, TARGETS, TEACHER, drawn, settings
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, Result, transfer


def taught(program: str, seed: int, target: str, folder: Path) -> tuple[Result, Trajectory, float]:
    """The result, the true path, and how tall who is seen from it is."""
    person = load_scene(TEACHER).subject
    assert person is not None
    true = shot(program, person, SIZE, 24, setup=drawn(program, seed))
    true.save(folder / "true.json")
    found = transfer(Inputs(TARGETS[target], f"{TEACHER}@{folder / 'true.json'}"), settings("balanced", seed))
    return found, true, person.height


def test_a_clip_of_which_one_frame_is_lost_is_found_again(tmp_path: Path) -> None:
    found, true, height = taught("tilt", 517, "self", tmp_path)
    assert found.searched.total < 0.05
    away = (found.trajectory.camera.center - true.camera.center).norm(dim=1).median()
    assert float(away) < 0.01 * height


@pytest.mark.slow  # tests/run/test_take.py tells such a path from one that leaps
def test_a_path_that_passes_a_lost_frame_by_is_kept(tmp_path: Path) -> None:
    found, _, _ = taught("boom", 511, "cross", tmp_path)
    totals = found.kept.found.totals
    assert float(totals.max()) > 6 * float(totals.median())
    assert found.searched.total < 0.6
    assert found.spent.evaluations < 45 * len(totals)
