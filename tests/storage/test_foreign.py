"""What a verb would write over is its own, or the verb is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.errors import UsageError
from cltransfer.evaluate_kept import ClipScore
from cltransfer.evaluate_many import summarise
from cltransfer.evaluate_table import write_methods
from cltransfer.scenes.person.lifted import save_labels
from cltransfer.storage.foreign import OF_A_CLIP, OF_A_PERSON, OF_A_STUDY, OF_METHODS, refuse_foreign
from cltransfer.study.analysis import preferences
from cltransfer.study.design import design
from cltransfer.study.report import Analysis, write_analysis
from cltransfer.testing import sample_features


def test_what_a_run_and_a_lift_have_written_is_ours(tiny_run: Path, tmp_path: Path) -> None:
    refuse_foreign(tiny_run, OF_A_CLIP)
    refuse_foreign(tiny_run, OF_A_PERSON)
    refuse_foreign(tmp_path / "missing", OF_A_CLIP)
    sample_features(0, 1).require("person").save(tmp_path / "subject.json")
    save_labels(tmp_path, torch.ones(2))
    (tmp_path / "sheet.png").touch()
    refuse_foreign(tmp_path, OF_A_PERSON, ("sheet.png",))


def test_tables_of_methods_and_of_a_study_are_ours(tmp_path: Path) -> None:
    rows = [ClipScore("ours", "a", {"framing": 0.1}, {"framing": 8}, 8, seconds=2.0)]
    write_methods(tmp_path, rows, summarise(rows), {})
    study = design(["a"], ["ours", "jaws"], [], 0)
    write_analysis(tmp_path, Analysis(study, {}, tuple(preferences([], study)), ()))
    assert all((tmp_path / name).is_file() for name in (*OF_METHODS, *OF_A_STUDY))
    refuse_foreign(tmp_path, OF_METHODS, ("methods.md", "methods.tex"))
    refuse_foreign(tmp_path, OF_A_STUDY)


def test_a_file_that_is_empty_is_nobody_s(tmp_path: Path) -> None:
    for name in OF_A_CLIP:
        (tmp_path / name).touch()
    refuse_foreign(tmp_path, OF_A_CLIP)


def test_what_has_no_mark_is_refused_and_by_its_company_what_can_have_none(tmp_path: Path) -> None:
    (tmp_path / "sheet.png").write_bytes(b"mine")
    with pytest.raises(UsageError, match=r"sheet\.png: --out: is there, and was not written by this verb"):
        refuse_foreign(tmp_path, OF_A_PERSON, ("sheet.png",))
    (tmp_path / "subject.json").write_text('{"format": "mine"}')
    with pytest.raises(UsageError, match=r"subject\.json: --out: is there"):
        refuse_foreign(tmp_path, OF_A_PERSON, ("sheet.png",))


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("evaluate", "a.mp4", "b.mp4"), "report.html"),
        (("evaluate", "clips", "ours=clips"), "metrics.json"),
        (("evaluate", "clips", "ours=clips"), "methods.md"),
        (("lift", "builtin:courtyard"), "contact_sheet.png"),
        (("bake", "box.obj"), "subject.json"),
        (("bake", "box.obj"), "box.ply"),
        (("study", "--analyse", "a.csv", "--key", "page.key.json"), "analysis.json"),
    ],
)
def test_a_verb_writes_over_nothing_that_is_another_s(
    command: Callable[..., Any], words: tuple[str, ...], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before its work: what these commands read is no clip, or not there, but a mesh."""
    monkeypatch.chdir(tmp_path)
    for folder in (Path("out"), Path("clips")):
        folder.mkdir()
    Path("box.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    Path("clips/a.mp4").touch()
    (Path("out") / name).write_text("mine")
    said = command(*words, "--out", "out")
    assert said.code == 2
    told = f"error: out/{name}: --out: is there, and was not written by this verb (name another folder, or take it"
    assert said.err.splitlines()[-1].startswith(told)
    assert (Path("out") / name).read_text() == "mine"
