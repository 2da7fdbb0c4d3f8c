"""What a reader of a run is told that no number says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cltransfer.config import load_config
from cltransfer.flags import run_flags
from cltransfer.scenes.load import load_scene
from cltransfer.transfer import Inputs, transfer

TINY = ["preset=fast", "frames=2", "search_side=48", "output_side=96"]


@pytest.mark.parametrize("people", [None, 1, 3])
def test_other_people_in_the_scene_are_told(tmp_path: Path, people: int | None) -> None:
    subject = load_scene("builtin:plaza").subject
    assert subject is not None
    replace(subject, people=people).save(tmp_path / "subject.json")
    inputs = Inputs("builtin:plaza", "builtin:push_in", subject=tmp_path / "subject.json")
    told = [flag.reason for flag in run_flags(transfer(inputs, load_config(overrides=TINY)))]
    assert any("3 people in the scene, one is filmed" in reason for reason in told) == (people == 3)
