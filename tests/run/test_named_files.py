"""Every file that a transfer names is known before it is read, however it is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.run.inputs import Inputs
from cltransfer.run.named_files import named_files
from cltransfer.scenes.load import load_scene


@pytest.mark.parametrize(
    ("inputs", "files"),
    [
        (Inputs("builtin:room-3", "builtin:orbit"), []),
        (Inputs(load_scene("builtin:room-3"), "a.mp4"), ["a.mp4"]),
        (Inputs("man.glb#t=0.6", "a.mp4#t=1,2&person=1"), ["man.glb", "a.mp4"]),
        (Inputs("s.ply", "f.safetensors", init="set:3"), ["s.ply", "f.safetensors", "set"]),
        (Inputs("s.ply", "builtin:orbit", init="a/t.json"), ["s.ply", "a/t.json"]),
        (Inputs("s.ply", "builtin:orbit", init="10:30/t.json"), ["s.ply", "10:30/t.json"]),
        (Inputs("builtin:room", "builtin:orbit", subject=Path("a/b.json")), ["a/b.json", "a/labels.safetensors"]),
        (
            Inputs("builtin:room", "s.ply@a/t.json"),
            ["s.ply", "a/t.json", "a/subject.json", "a/labels.safetensors"],
        ),
        (Inputs("builtin:room", "builtin:plaza@"), [".", "subject.json", "labels.safetensors"]),
    ],
)
def test_files_of_what_is_given(inputs: Inputs, files: list[str]) -> None:
    assert [str(path) for path in named_files(inputs)] == files
