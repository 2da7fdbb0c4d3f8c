"""Every command that README and the pages for users show can be meant: its verb, its options and its config."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.sweep import SweepFile
from cltransfer.cli.app import app
from cltransfer.config import load_config

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
NAMES = ("transfer", "score", "ablate", "models")
GUIDES = [(ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in NAMES]


def shown(page: str) -> list[str]:
    """The commands of a page."""
    shell = "\n".join(re.findall(r"```sh\n(.*?)```", page, re.DOTALL)).replace("\\\n", " ")
    return [line for line in shell.splitlines() if line.startswith("cltransfer ")]


COMMANDS = shown(README)
DEPTH = "{model: depth_anything_v2_small.onnx, kind: disparity, multiple: 14"


@pytest.mark.parametrize("line", dict.fromkeys([*COMMANDS, *(line for page in GUIDES for line in shown(page))]))
def test_a_command_that_a_page_shows_can_be_meant(line: str) -> None:
    name, *words = shlex.split(line, comments=True)
    command = typer.main.get_command(app)
    while hasattr(command, "commands"):
        name = words.pop(0)
        command = command.commands[name]
    given = command.make_context(name, words).params  # an option that is none is refused here
    overrides = [word for word in words if re.match(r"[a-z_.]+=", word) and "/" not in word.partition("=")[0]]
    if name == "transfer":
        assert set(overrides) <= {given["scene"], given["reference"], *(given["more"] or ())}
    if name in ("transfer", "evaluate", "inspect"):
        load_config(overrides=overrides)


@pytest.mark.parametrize("page", [README, *GUIDES], ids=["README", *NAMES])
def test_an_ablation_file_that_a_page_shows_is_one(page: str, tmp_path: Path) -> None:
    for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL):
        if "rows:" in block:
            (tmp_path / "mine.yaml").write_text(block, encoding="utf-8")
            assert len(read_sweep(str(tmp_path / "mine.yaml")).rows) > 1


def test_the_guide_tells_what_an_ablation_takes_where_its_file_names_none() -> None:
    guide, file = GUIDES[NAMES.index("ablate")], SweepFile()
    assert f"# {file.scenes[0].scene} where none is named" in guide
    assert f"or drawn:SHOT; else {file.references[0]}\n" in guide
    assert f"of what is drawn; else {file.seeds}\n" in guide


def test_the_readme_shows_each_verb_that_a_newcomer_needs() -> None:
    verbs = {line.split()[1] for line in COMMANDS}
    assert verbs >= {"models", "transfer", "export", "evaluate", "ablate", "inspect", "describe", "plugins", "assets"}


@pytest.mark.parametrize(
    "override",
    ["extractors.depth_sfm={}", f"extractors.depth_onnx={DEPTH}}}", f"extractors.depth_onnx={DEPTH}, align: shift}}"],
)
def test_an_override_that_a_page_names_is_one(override: str) -> None:
    assert any(override in page for page in GUIDES)
    load_config(overrides=[override])


def test_the_ablation_that_it_shows_has_as_many_trials_as_it_says() -> None:
    for overrides, count in ((["seeds=[0]", "references=[drawn:orbit]"], 6), ([], 90)):
        sweep = read_sweep("leave_one_out", overrides)
        file = sweep.file
        assert len(file.scenes) * len(file.references) * len(file.seeds) * len(sweep.rows) == count
        assert re.search(rf"\b{count} trials", README)
