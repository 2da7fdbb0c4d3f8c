"""What a run leaves: the command in its report makes the run again."""

from __future__ import annotations

import shlex
from pathlib import Path

from cltransfer.run.folder import command_again
from cltransfer.run.inputs import Inputs


def test_the_command_of_a_run_can_be_pasted_though_names_have_spaces() -> None:
    line = command_again(Path("my run"), Inputs("my scene.ply", "a clip.mp4"), ["my plugin.py"])
    assert shlex.split(line)[2:4] == ["my scene.ply", "a clip.mp4"]
