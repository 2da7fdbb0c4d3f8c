"""Every command that README shows can be meant: its verb, its options and the config that it comes to."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from cltransfer.ablate.read import read_sweep
from cltransfer.cli.app import app
from cltransfer.config import load_config

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
SHELL = "\n".join(re.findall(r"```sh\n(.*?)```", README, re.DOTALL)).replace("\\\n", " ")
COMMANDS = [line for line in SHELL.splitlines() if line.startswith("cltransfer ")]
DEPTH = "{model: depth_anything_v2_small.onnx, kind: disparity, multiple: 14"


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_of_the_readme_can_be_meant(line: str) -> None:
    name, *words = shlex.split(line, comments=True)
    command = typer.main.get_command(app)
    while hasattr(command, "commands"):
        name = words.pop(0)
        command = command.commands[name]
    given = command.make_context(name, words).params  # an option that is none is refused here
    overrides = [word for word in words if re.match(r"[a-z_.]+=", word) and "/" not in word.partition("=")[0]]
    if name == "transfer":
        assert set(overrides) <= set(given["arguments"])
        load_config(overrides=overrides)


def test_the_readme_shows_each_verb_that_a_newcomer_needs() -> None:
    shown = {line.split()[1] for line in COMMANDS}
    assert shown >= {"models", "transfer", "export", "evaluate", "ablate", "inspect", "describe", "plugins", "assets"}


@pytest.mark.parametrize(
    "override",
    ["extractors.depth_sfm={}", f"extractors.depth_onnx={DEPTH}}}", f"extractors.depth_onnx={DEPTH}, align: shift}}"],
)
def test_an_override_that_its_text_names_is_one(override: str) -> None:
    assert override in README
    load_config(overrides=[override])


def test_the_ablation_that_it_shows_has_as_many_trials_as_it_says() -> None:
    for overrides, count in ((["seeds=[0]", "references=[drawn:orbit]"], 6), ([], 90)):
        sweep = read_sweep("leave_one_out", overrides)
        file = sweep.file
        assert len(file.scenes) * len(file.references) * len(file.seeds) * len(sweep.rows) == count
        assert re.search(rf"\b{count} trials", README)
