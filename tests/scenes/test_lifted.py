"""A lifted person on disk: joints go with labels, and neither is taken for granted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.errors import InputError
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.lifted import load_person, save_labels


def test_labels_come_back_with_the_person(tmp_path: Path) -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    bare = replace(scene, subject=None, geometry=scene.geometry.with_label(torch.zeros(len(scene.geometry))))
    scene.subject.save(tmp_path / "subject.json")
    save_labels(tmp_path, scene.geometry.label)
    again = load_person(bare, tmp_path / "subject.json")
    assert torch.equal(again.geometry.label, (scene.geometry.label > 0.5).float())


def test_a_person_without_labels_is_refused_where_the_scene_marks_nobody(tmp_path: Path) -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    scene.subject.save(tmp_path / "subject.json")
    assert load_person(scene, tmp_path / "subject.json").subject is not None
    bare = replace(scene, subject=None, geometry=scene.geometry.with_label(torch.zeros(len(scene.geometry))))
    with pytest.raises(InputError, match=r"labels.safetensors: label: is missing, and the scene marks nobody"):
        load_person(bare, tmp_path / "subject.json")
