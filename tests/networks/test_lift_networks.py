"""A person lifted by networks out of a scene that marks nobody; clips and runs that are scored by the same networks."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.scenes import Scene
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import load_person
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.splats import Splats
from cltransfer.subject import Subject

Command = Callable[..., Any]
SMALL = ("search_side=96", "output_side=240", "threads=1", "preset=fast", "--quiet")


def share(found: Tensor, truth: Tensor) -> float:
    """Intersection over union of two memberships (N,)."""
    one, other = found > 0.5, truth > 0.5
    return float((one & other).sum() / (one | other).sum())


def test_a_person_is_lifted_with_joints_and_labels_from_a_scene_that_marks_nobody(
    command: Command, networks: tuple[str, ...], scene_file: Path, stage: Scene, tmp_path: Path
) -> None:
    answer = command("lift", scene_file, "--views", "10", "--out", tmp_path / "lift", "--json", "--quiet", *networks)
    assert answer.code == 0, answer.err
    told = json.loads(answer.out)
    assert (told["views_with_person"], told["people"], told["joints_known"]) == (10, 1, 14)
    found, truth = load_person(load_scene(scene_file), tmp_path / "lift" / "subject.json"), stage.subject
    assert found.subject is not None
    assert truth is not None
    label, own = found.geometry.label > 0.5, stage.geometry.label > 0.5
    assert float((label & own).sum() / own.sum()) > 0.99
    assert int((label & ~own).sum()) < 10  # of the floor under the feet, which is near the bones
    off = (found.subject.joints - truth.joints).norm(dim=1) / truth.height
    assert float(off.median()) < 0.08
    assert float(off.max()) < 0.2
    assert found.subject.height == pytest.approx(truth.height, rel=0.05)
    assert math.degrees(math.acos(float(found.subject.facing @ truth.facing))) < 40  # the paint of legs in stride


@pytest.fixture
def pair(stage: Scene, tmp_path: Path) -> tuple[Path, Tensor]:
    """The painted person and, a way off, its green double; unmarked. And the way from one to the other."""
    splats, subject = stage.geometry, stage.subject
    assert subject is not None
    way, own = 1.6 * subject.left, splats.label > 0.5
    parts = {name: getattr(splats, name) for name in ("means", "scales", "quats", "opacity", "sh", "label")}
    both = {name: torch.cat([part, part[own]]) for name, part in parts.items()}
    both["means"][len(splats) :] += way.float()
    both["sh"][len(splats) :] = both["sh"][len(splats) :][..., [1, 0, 2]]
    write_splats(tmp_path / "pair.ply", Splats(**both))
    return tmp_path / "pair.ply", way


def test_either_of_two_persons_is_lifted_and_nobody_else(
    command: Command, networks: tuple[str, ...], pair: tuple[Path, Tensor], stage: Scene, tmp_path: Path
) -> None:
    file, way = pair
    scenes = []
    for person in (0, 1):
        out = tmp_path / str(person)
        answer = command("lift", file, "--views", "8", "--person", person, "--out", out, "--quiet", *networks)
        assert answer.code == 0, answer.err
        scenes.append(load_person(load_scene(file), out / "subject.json"))
    one, other = scenes
    assert one.subject.people == other.subject.people == 2
    apart = other.subject.anchor - one.subject.anchor
    assert min(float((apart - way).norm()), float((apart + way).norm())) < 0.15
    assert float((one.geometry.label * other.geometry.label).sum()) == 0
    count, own = len(one.geometry), stage.geometry.label > 0.5
    truths = torch.zeros(2, count)
    truths[0, : len(own)][own], truths[1, len(own) :] = 1, 1
    for scene in scenes:
        assert max(share(scene.geometry.label, truth) for truth in truths) > 0.95


def test_a_transfer_films_the_person_that_is_asked_for(
    command: Command, networks: tuple[str, ...], pair: tuple[Path, Tensor], tmp_path: Path
) -> None:
    file, way = pair
    filmed = []
    for person in (0, 1):
        run, small = tmp_path / f"run {person}", ("frames=1", "search_side=48", "output_side=64", "preset=fast")
        words = (file, "builtin:static", "--subject", person, "--out", run, *small, "threads=1", "--quiet")
        answer = command("transfer", *words, *networks)
        assert answer.code == 0, answer.err
        assert "2 people in the scene, one is filmed: in a scan --subject 0, 1, ... takes each" in answer.out
        filmed.append(Subject.load(run / "subject.json").anchor)
    apart = filmed[1] - filmed[0]
    assert min(float((apart - way).norm()), float((apart + way).norm())) < 0.25


def test_a_person_who_is_not_there_cannot_be_lifted(
    command: Command, networks: tuple[str, ...], scene_file: Path, tmp_path: Path
) -> None:
    answer = command("lift", scene_file, "--person", "1", "--out", tmp_path / "out", "--quiet", *networks)
    assert (answer.code, answer.err.count("\n")) == (2, 1)
    assert "person 1: only person 0 is seen in this scene" in answer.err
    assert not (tmp_path / "out").exists()


def test_evaluating_a_written_run_agrees_with_its_own_metrics_to_the_bit(
    command: Command, networks: tuple[str, ...], scene_file: Path, film: Callable[..., Path], tmp_path: Path
) -> None:
    clip, run, person = film("push_in", 3), tmp_path / "run", scene_file.with_name("subject.json")
    made = command("transfer", scene_file, clip, "--subject", person, "--out", run, *SMALL, *networks)
    assert made.code == 0, made.err
    answer = command("evaluate", clip, run, "--json", "threads=1", "preset=fast", "--quiet", *networks)
    assert answer.code == 0, answer.err
    own, again = json.loads((run / "metrics.json").read_text())["metrics"], json.loads(answer.out)["metrics"]
    assert own["total"]["mean"] > 0
    assert own["camera_angle"]["defined"] == 3
    for name, metric in again.items():
        assert (metric["mean"], metric["defined"]) == (own[name]["mean"], own[name]["defined"]), name


def test_a_clip_in_which_the_networks_find_nobody_is_refused(
    command: Command, networks: tuple[str, ...], scene_file: Path, tmp_path: Path
) -> None:
    grey, out = tmp_path / "grey", tmp_path / "out"
    grey.mkdir()
    for i in range(3):
        assert cv2.imwrite(str(grey / f"{i}.png"), np.full((90, 160, 3), 90 + i, np.uint8))
    transfer = ("transfer", scene_file, grey, "--subject", scene_file.with_name("subject.json"), "--out", out)
    for words in (transfer, ("evaluate", grey, grey)):
        answer = command(*words, "--quiet", *networks)
        assert (answer.code, answer.err.count("\n")) == (3, 1), answer.err
        assert answer.err.startswith(f"error: {grey}: person: none found in 3 frames")
    assert not out.exists()
