"""The verb that makes a page and analyses it takes no option, and no argument, of the one for the other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


@pytest.mark.parametrize("option", ["--method=ours", "--reference=clip.mp4", "--seed=0"])
def test_an_option_of_the_page_is_refused_of_an_analysis(command: Callable[..., Any], option: str) -> None:
    said = command("study", "--analyse", "answers.csv", "--key", "page.key.json", option)
    name = option.partition("=")[0]
    assert (said.code, said.err) == (2, f"error: {name}: changes nothing of an analysis, only of a page\n")


def test_a_key_is_refused_where_a_page_is_made(command: Callable[..., Any], tmp_path: Path) -> None:
    said = command("study", "a.mp4", "b.mp4", "--key", "page.key.json", "--out", tmp_path / "page")
    assert said.code == 2
    assert said.err.startswith(
        "error: --key: changes nothing of a page, only of an analysis (to read answers: --analyse"
    )


@pytest.mark.parametrize("options", [(), ("--key", "page.key.json"), ("--out", "page")])
def test_answers_are_no_runs(
    command: Callable[..., Any], options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("anna.csv").touch()
    said = command("study", "anna.csv", "ben.CSV", *options)
    assert said.code == 2
    assert said.err.startswith(
        "error: anna.csv: expected a run folder or a clip, got a table (to read answers: --analyse"
    )
    assert not Path("page").exists()
