"""Of a tilt taught to its own scene the lean way loses one frame of 24, and so the clip is followed thoroughly."""

from pathlib import Path

from cltransfer.bench.driver import SIZE, TEACHER, drawn, settings
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot
from cltransfer.transfer import Inputs, transfer

SEED = 517


def test_a_clip_of_which_one_frame_is_lost_is_found_again(tmp_path: Path) -> None:
    person = load_scene(TEACHER).subject
    assert person is not None
    true = shot("tilt", person, SIZE, 24, setup=drawn("tilt", SEED))
    true.save(tmp_path / "tilt.json")
    found = transfer(Inputs(TEACHER, f"{TEACHER}@{tmp_path / 'tilt.json'}"), settings("balanced", SEED))
    assert found.searched.total < 0.05
    away = (found.trajectory.camera.center - true.camera.center).norm(dim=1).median()
    assert float(away) < 0.01 * person.height
