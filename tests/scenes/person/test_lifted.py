"""A lifted person on disk: joints go with labels, and neither is taken for granted."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import ClassVar

import pytest
import torch
from safetensors.torch import save_file

from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.errors import InputError, UsageError
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.renderers.mesh import MeshRenderer
from cltransfer.renderers.nerf_grid import NerfGridRenderer
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.person import lifted
from cltransfer.scenes.person.lift import Lift
from cltransfer.scenes.person.lifted import cached_lift, lifted_scene, load_person, save_labels
from cltransfer.scenes.simplify import subset
from cltransfer.scenes.splats import Splats
from cltransfer.subject import Subject
from cltransfer.testing import sample_features


def test_the_cache_keeps_a_person_for_what_has_drawn_it() -> None:
    scene = named_scene("courtyard")
    kept = cached_lift(scene, GaussianSplats(), {})
    assert cached_lift(scene, GaussianSplats(near=1.0), {}) != kept
    assert cached_lift(scene, MeshRenderer(), {}) != cached_lift(scene, NerfGridRenderer(), {})
    assert cached_lift(scene, GaussianSplats(threads=2), {}) == kept


def test_the_cache_keeps_a_person_for_the_code_of_ours_that_has_found_it(edited: Callable[[str], None]) -> None:
    scene = named_scene("courtyard")
    kept = {cached_lift(scene, GaussianSplats(), {})}
    for module in ("scenes/person/vote.py", "scenes/ply.py", "renderers/gaussian_splats.py", "models/onnx.py"):
        edited(module)
        kept.add(cached_lift(scene, GaussianSplats(), {}))
    assert len(kept) == 5
    edited("describe/description.py")
    assert cached_lift(scene, GaussianSplats(), {}) in kept


@dataclass(frozen=True)
class Toned(GaussianSplats):
    """A plugin's renderer, which reads a file."""

    table: str = "tones.txt"


def test_the_cache_keeps_a_person_for_the_files_of_what_has_drawn_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = named_scene("courtyard")
    kept = [cached_lift(scene, Toned(), {})]
    for content in ("1", "100"):
        (tmp_path / "tones.txt").write_text(content)
        kept.append(cached_lift(scene, Toned(), {}))
    assert len(set(kept)) == 3
    assert cached_lift(scene, Toned(), {}) == kept[-1]


@dataclass(frozen=True)
class Brightened:
    """A helper that what finds a person reads; no network."""

    gain: float = 1.0

    family: ClassVar[str] = "image"
    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("bright",)


@dataclass(frozen=True)
class Found:
    """Reads image and scene alike."""

    shift: int = 0

    family: ClassVar[str] = "both"
    requires: ClassVar[tuple[str, ...]] = ("bright",)
    provides: ClassVar[tuple[str, ...]] = ("box", "keypoints", "subject", "orientation")


def test_the_cache_keeps_a_person_for_all_that_has_read_it() -> None:
    scene = named_scene("courtyard")
    asked = ({"a": Brightened(gain), "b": Found(shift)} for gain in (1.0, 5.0) for shift in (0, 50))
    assert len({cached_lift(scene, GaussianSplats(), extractors) for extractors in asked}) == 4
    beside = {"a": Brightened(), "b": Found(), "c": replace(Found(), shift=3)}
    with pytest.raises(UsageError, match="b and c both provide"):
        cached_lift(scene, GaussianSplats(), beside)


@pytest.mark.parametrize("of", ["package", "device"])
def test_the_cache_keeps_a_person_for_the_packages_that_have_read_it(of: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another OpenCV resizes otherwise, and a device has other numbers."""
    scene, asked = named_scene("courtyard"), {"a": Brightened(1.0), "b": Found(0)}
    before = cached_lift(scene, GaussianSplats(), asked)
    if of == "package":
        monkeypatch.setattr("cltransfer.models.content.versions", lambda: {"opencv-contrib-python-headless": "99"})
    else:
        monkeypatch.setenv("CLTRANSFER_NETWORKS", "cuda")
    assert cached_lift(scene, GaussianSplats(), asked) != before


def test_labels_come_back_with_the_person(tmp_path: Path) -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    bare = replace(scene, subject=None, geometry=scene.geometry.with_label(torch.zeros(len(scene.geometry))))
    scene.subject.save(tmp_path / "subject.json")
    save_labels(tmp_path, scene.geometry.label)
    again = load_person(bare, tmp_path / "subject.json")
    assert torch.equal(again.geometry.label, (scene.geometry.label > 0.5).float())


def test_the_labels_beside_a_person_mark_another_than_the_scene_does(tmp_path: Path) -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    other = scene.geometry.label.clone()
    other[::2] = 0
    scene.subject.save(tmp_path / "subject.json")
    save_labels(tmp_path, other)
    assert torch.equal(load_person(scene, tmp_path / "subject.json").geometry.label, (other > 0.5).float())


@pytest.mark.parametrize(
    ("value", "kind"), [(255, torch.uint8), (-1, torch.int8), (torch.nan, torch.float16), (torch.inf, torch.float16)]
)
def test_labels_that_are_no_membership_are_refused(tmp_path: Path, value: float, kind: torch.dtype) -> None:
    scene = replace(named_scene("courtyard"), geometry=synthetic_room(200))
    sample_features(0, 1).require("person").save(tmp_path / "subject.json")
    label = torch.zeros(len(scene.geometry), dtype=kind)
    label[3] = value
    save_file({"label": label}, tmp_path / "labels.safetensors")
    with pytest.raises(InputError, match=f"labels.safetensors: label: expected values from 0 to 1, got {value:g}"):
        load_person(scene, tmp_path / "subject.json")


def test_labels_that_others_are_copied_over_change_nothing_that_was_read(tmp_path: Path) -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    assert isinstance(scene.geometry, Splats)
    few = replace(scene, geometry=subset(scene.geometry, scene.geometry.label.nonzero()[:1000, 0]))
    scene.subject.save(tmp_path / "subject.json")
    labels = tmp_path / "labels.safetensors"
    save_file({"label": few.geometry.label}, labels)
    found = load_person(few, tmp_path / "subject.json")
    with labels.open("r+b") as stream:  # as cp does, which keeps the file and writes into it
        stream.write(b"\0" * labels.stat().st_size)
    assert torch.equal(found.geometry.label, few.geometry.label)


def test_a_person_without_labels_is_refused_where_the_scene_marks_nobody(tmp_path: Path) -> None:
    scene = named_scene("courtyard")
    assert scene.subject is not None
    scene.subject.save(tmp_path / "subject.json")
    assert load_person(scene, tmp_path / "subject.json").subject is not None
    bare = replace(scene, subject=None, geometry=scene.geometry.with_label(torch.zeros(len(scene.geometry))))
    with pytest.raises(InputError, match=r"labels.safetensors: label: is missing, and the scene marks nobody"):
        load_person(bare, tmp_path / "subject.json")


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("left_knee", "null", r"confidence.left_knee: expected 0: it is unknown, got"),
        ("left_knee", "[Infinity, 0, 0]", r"joints.left_knee: expected three numbers or null, got \[inf, 0.0, 0.0\]"),
        ("facing", "[0, 1, 0]", r"facing: expected a vector orthogonal to up, got 1 of its length along up"),
        ("up", "[0, 2, 0]", r"up: expected a unit vector, got \[0.0, 2.0, 0.0\]"),
        ("height", "Infinity", r"height: expected a length, got inf"),
        (
            "confidence",
            "none",
            r"confidence: expected a known head, chest, waist, knees or feet, got 0 for all of them",
        ),
    ],
)
def test_a_person_who_cannot_be_is_refused_by_field(tmp_path: Path, field: str, value: str, told: str) -> None:
    raw = {**sample_features(0, 1).require("person").to_json(), "up": [0.0, 1.0, 0.0], "facing": [0.0, 0.0, 1.0]}
    if value == "none":
        raw["confidence"] = dict.fromkeys(raw["confidence"], 0.0)
    else:
        (raw["joints"] if field in raw["joints"] else raw)[field] = json.loads(value)
    (tmp_path / "subject.json").write_text(json.dumps(raw))
    with pytest.raises(InputError, match=told):
        Subject.load(tmp_path / "subject.json")


@pytest.mark.parametrize("count", ["Infinity", "-3", "0", "2.7", '"3"', "true"])
def test_people_that_are_no_count_are_refused(tmp_path: Path, count: str) -> None:
    sample_features(0, 1).require("person").save(tmp_path / "subject.json")
    text = (tmp_path / "subject.json").read_text()
    (tmp_path / "subject.json").write_text(text.replace('"people": null', f'"people": {count}'))
    with pytest.raises(InputError, match="people must be a whole number"):
        Subject.load(tmp_path / "subject.json")


def test_a_cache_that_cannot_be_written_loses_no_person(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    scene = named_scene("courtyard")
    bare = replace(scene, subject=None, geometry=scene.geometry.with_label(torch.zeros(len(scene.geometry))))
    found = Lift(**dict.fromkeys((field.name for field in fields(Lift)), None))
    found = replace(found, subject=scene.subject, label=0.9 * scene.geometry.label)
    monkeypatch.setattr(lifted, "lift_scene", lambda *given, **options: found)
    monkeypatch.setattr(lifted, "summary", lambda found: {})
    (tmp_path / "file").touch()
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "file"))
    told = lifted_scene(bare, GaussianSplats(), {})
    assert caplog.messages[0].endswith("Not a directory: the next run lifts the person anew")
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    kept = lifted_scene(bare, GaussianSplats(), {})
    assert torch.equal(told.geometry.label, kept.geometry.label)
    assert (len(caplog.messages), kept.subject.height) == (1, told.subject.height)
