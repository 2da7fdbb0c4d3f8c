"""The verb: a camera path in words, as text, JSON and files."""

import json
from pathlib import Path
from typing import Any

from cltransfer.shots import shot
from cltransfer.testing import sample_subject


def test_a_path_is_described_and_kept(command: Any, tmp_path: Path) -> None:
    shot("boom", sample_subject(), (160, 90), 8).save(tmp_path / "trajectory.json")
    sample_subject().save(tmp_path / "subject.json")
    said = command("describe", tmp_path, "--out", tmp_path / "words", "--json")
    assert said.code == 0, said.err
    assert json.loads(said.out)["movement"]["name"] == "boom up"
    assert sorted(p.name for p in (tmp_path / "words").iterdir()) == [
        "description.json",
        "description.txt",
        "strip.svg",
    ]


def test_a_missing_source_is_one_line(command: Any, tmp_path: Path) -> None:
    said = command("describe", tmp_path / "none.json")
    assert (said.code, said.err.count("\n")) == (3, 1)
