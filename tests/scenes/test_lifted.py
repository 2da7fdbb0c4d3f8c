"""A lifted person on disk: joints go with labels, and neither is taken for granted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.errors import InputError
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.lifted import load_person, save_labels
from cltransfer.subject import Subject
from cltransfer.testing import sample_features


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


@pytest.mark.parametrize("count", ["Infinity", "-3", "0", "2.7", '"3"', "true"])
def test_people_that_are_no_count_are_refused(tmp_path: Path, count: str) -> None:
    sample_features(0, 1).require("person").save(tmp_path / "subject.json")
    text = (tmp_path / "subject.json").read_text()
    (tmp_path / "subject.json").write_text(text.replace('"people": null', f'"people": {count}'))
    with pytest.raises(InputError, match="people must be a whole number"):
        Subject.load(tmp_path / "subject.json")
