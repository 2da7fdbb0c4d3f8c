"""The verb: a camera path in words, as text, JSON and files."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot
from cltransfer.testing import sample_features, sample_subject
from cltransfer.trajectory import Trajectory


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


def test_a_path_with_an_at_in_its_name_is_no_scene_with_a_path(command: Any, tmp_path: Path) -> None:
    shot("boom", sample_subject(), (160, 90), 8).save(tmp_path / "my@take.json")
    sample_subject().save(tmp_path / "subject.json")
    said = command("describe", tmp_path / "my@take.json", "--json")
    assert said.code == 0, said.err
    assert json.loads(said.out)["movement"]["name"] == "boom up"


def test_a_scene_with_a_path_in_another_folder_is_rendered_and_described(command: Any, tmp_path: Path) -> None:
    person = load_scene("builtin:plaza").subject
    assert person is not None
    shot("static", person, (160, 90), 3).save(tmp_path / "takes" / "shot.json")
    path = tmp_path / "takes" / "shot.json"
    said = command("describe", f"builtin:plaza@{path}", "output_side=96", "--json")
    assert said.code == 0, said.err
    assert json.loads(said.out)["movement"]["name"] == "static"


def test_a_path_is_told_alike_with_its_scene_and_with_its_person_alone(command: Any, tmp_path: Path) -> None:
    """A close-up from the height of the face, which looks down on the body's middle."""
    person = load_scene("builtin:plaza").subject
    assert person is not None
    head = person.key_joints[0, :3]
    eye = head + 0.4 * person.height * person.facing
    view = Camera.look_at(eye.expand(2, 3), head, person.up, 0.5, (160, 90))
    Trajectory(view, torch.arange(2.0, dtype=torch.float64)).save(tmp_path / "trajectory.json")
    person.save(tmp_path / "subject.json")
    path = tmp_path / "trajectory.json"
    sources = ((path,), (f"builtin:plaza@{path}", "output_side=96"))
    told = [command("describe", *source, "--json") for source in sources]
    assert [json.loads(said.out)["height"]["usual"] for said in told] == ["eye level"] * 2


def test_what_could_not_be_read_is_told_in_the_file_too(command: Any, tmp_path: Path) -> None:
    features = replace(sample_features(0, 3), image=None, alpha=None, label=None, camera=None, person=None)
    layers = features.layers.clone()
    layers[1:, 2] = False
    FeatureFile(replace(features, layers=layers), torch.arange(3).double(), "a").save(tmp_path / "a.safetensors")
    said = command("describe", tmp_path / "a.safetensors", "--out", tmp_path / "words")
    assert said.code == 0, said.err
    written = (tmp_path / "words" / "description.txt").read_text()
    assert written == said.out
    assert "Movement: not told (no frame's motion could be read)." in written
    assert "note: the motion of 2 frames could not be read" in written
    movement = json.loads((tmp_path / "words" / "description.json").read_text())["movement"]
    assert (movement["name"], movement["reason"]) == (None, "no frame's motion could be read")


LEFT_OUT = {
    "losses.camera_angle=null": "orientation: expected a loss that reads it, none is left",
    "losses.camera_movement=null": "flow: expected a loss that reads it, none is left",
    "extractors.flow_dis=null": "flow: no image extractor provides 'flow'",
}


@pytest.mark.parametrize("override", LEFT_OUT)
def test_what_no_loss_reads_is_told_before_anything_is_read(command: Any, tmp_path: Path, override: str) -> None:
    clip = tmp_path / "clip.mp4"
    clip.write_text("this cannot be read")
    said = command("describe", clip, override)
    assert said.err == f"error: {clip}: {LEFT_OUT[override]} (a description needs the losses that read it)\n"
    assert said.code == 2


def test_a_feature_file_that_lacks_something_is_named_whatever_the_config_reads(command: Any, tmp_path: Path) -> None:
    features = replace(sample_features(0, 3), image=None, alpha=None, label=None, camera=None, person=None)
    times, path = torch.arange(3).double(), tmp_path / "a.safetensors"
    FeatureFile(features, times, "a").save(path)
    assert command("describe", path, "losses.camera_angle=null").code == 0
    idle = command("describe", path, "lod=2")
    assert idle.code == 2
    assert "lod: changes nothing of a description" in idle.err
    FeatureFile(replace(features, orientation=None), times, "a").save(path)
    said = command("describe", path)
    assert (said.code, "a.safetensors: orientation: not in the feature file" in said.err) == (3, True)


IDLE = {
    "clip.mp4": ("a clip", ["output_side=96", "renderer.mesh={}"]),
    "features.safetensors": ("a feature file", ["output_side=96", "renderer.mesh={}", "extractors.flow_dis=null"]),
    "trajectory.json": ("a camera path", ["output_side=96", "losses.framing.weight=2", "threads=1", "preset=fast"]),
    "": ("a camera path", ["extractors.flow_dis=null"]),  # the folder of a run
    "builtin:pan": ("a scene with a trajectory", ["search_side=96"]),
}


@pytest.mark.parametrize(("name", "override"), [(name, key) for name, (_, keys) in IDLE.items() for key in keys])
def test_a_key_that_changes_nothing_of_what_is_described_is_refused(
    command: Any, tmp_path: Path, name: str, override: str
) -> None:
    shot("boom", sample_subject(), (160, 90), 8).save(tmp_path / "trajectory.json")
    source = name if name.startswith("builtin:") else tmp_path / name
    said = command("describe", source, override)
    key, known = override.partition("=")[0].partition(".")[0], "expected a key that it looks at (frames"
    assert said.err.startswith(f"error: {key}: changes nothing of a description of {IDLE[name][0]}, {known}")
    assert said.code == 2


def test_a_person_is_refused_of_what_is_no_camera_path(command: Any, tmp_path: Path) -> None:
    sample_subject().save(tmp_path / "subject.json")
    for source in ("clip.mp4", "features.safetensors", "builtin:pan"):
        said = command("describe", source, "--subject", tmp_path / "subject.json")
        reason = "is read of a camera path alone, expected a trajectory.json or the folder of a run (leave it out)"
        assert (said.code, said.err) == (2, f"error: {source}: --subject: {reason}\n")


def test_a_missing_source_is_one_line(command: Any, tmp_path: Path) -> None:
    said = command("describe", tmp_path / "none.json")
    assert (said.code, said.err.count("\n")) == (3, 1)
