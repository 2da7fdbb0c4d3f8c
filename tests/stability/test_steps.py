"""A layer's depth, a median, jumps where half of it leaves the frame, and no slope leads back: the path goes aside."""

from pathlib import Path

from cltransfer.bench.driver import SIZE, TARGETS, TEACHER, drawn, settings
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot
from cltransfer.transfer import Inputs, transfer


def test_frames_in_which_depth_jumps_are_gone_past(tmp_path: Path) -> None:
    person = load_scene(TEACHER).subject
    assert person is not None
    shot("boom", person, SIZE, 24, setup=drawn("boom", 610)).save(tmp_path / "true.json")
    found = transfer(Inputs(TARGETS["cross"], f"{TEACHER}@{tmp_path / 'true.json'}"), settings("balanced", 610))
    stuck = found.kept.found.totals > 3.0
    assert int(stuck.sum()) == 6
    assert float(found.searched.totals[stuck].mean()) < 2.0
    assert found.searched.total < 1.2  # measured 1.01, 1.42 without; by the paper's setting 1.29
