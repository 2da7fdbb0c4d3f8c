"""The depth of a layer jumps as the camera moves: frames found one by one jump with it, the path taken does not."""

from pathlib import Path

import pytest

from cltransfer.bench.driver import SIZE, TARGETS, TEACHER, drawn, settings
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot
from cltransfer.trajectory import jerk
from cltransfer.transfer import Inputs, Result, transfer


@pytest.fixture
def taught(tmp_path: Path) -> Result:
    """A boom in the plaza, taught to the courtyard."""
    subject = load_scene(TEACHER).subject
    assert subject is not None
    shot("boom", subject, SIZE, 16, setup=drawn("boom", 11)).save(tmp_path / "shot.json")
    return transfer(Inputs(TARGETS["cross"], f"{TEACHER}@{tmp_path / 'shot.json'}"), settings("balanced", 11))


def test_a_path_does_not_jump_where_its_frames_do(taught: Result) -> None:
    height = taught.scene.subject.height
    assert jerk(taught.kept.found.camera, height) > 0.1
    assert taught.kept.path.name != "every frame"
    assert jerk(taught.kept.cameras, height) < 0.1 * jerk(taught.kept.found.camera, height)
    assert taught.kept.path.total < taught.kept.path.free + 0.2
    assert taught.spent.evaluations / len(taught.reference) < 1.1 * 37.3
