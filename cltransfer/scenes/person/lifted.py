"""A lifted person beside its scene: subject.json and labels, in a folder or in the cache by content."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ...camera import Camera
from ...drawing import drawn_by
from ...errors import InputError
from ...features import Features
from ...models.content import READERS, files_content, read_by, reading
from ...pipeline.graph import persons_in, run
from ...pipeline.plan import CLIP_SOURCE, Plan, make_plan
from ...registry import RENDERERS
from ...registry.plugin_code import code_of, own_code
from ...storage.files import cache_dir, into_cache
from ...storage.run_files import LABELS, SUBJECT
from ...storage.tensor_file import save_tensors
from ...subject import Subject
from .. import Scene
from .find_people import Boxes
from .fits import check_fits
from .lift import Lift, LiftOptions, lift, summary

WANTED = frozenset({"box", "keypoints", "subject", "orientation"})
USUAL = LiftOptions()


def lift_scene(
    scene: Scene,
    renderer: Any,
    extractors: Mapping[str, Any],
    options: LiftOptions = USUAL,
    progress: Callable[[str], None] = lambda step: None,
) -> Lift:
    """Lift a person of ``scene`` with the configured image extractors.

    Args:
        scene: not lifted yet.
        renderer: draws the views.
        extractors: by name; they must provide box, keypoints, subject and orientation of an image.
        options: from where, and whom.
        progress: called before each round of views.

    Raises:
        InputError: no person is found.
        UsageError: there are fewer persons.
    """
    plan = make_plan(WANTED, extractors, CLIP_SOURCE, "image")
    if plan.missing:
        name, reason = next(iter(plan.missing.items()))
        raise InputError(scene.name, "lift", f"needs {name!r}: {reason}")
    plan.load_networks()
    eyes = _Eyes(scene, renderer, plan, progress)
    return lift(scene, renderer, eyes.look, eyes.see, options)


@dataclass(frozen=True)
class _Eyes:
    """Views of a scene, and what the networks see in them."""

    scene: Scene
    renderer: Any
    plan: Plan
    progress: Callable[[str], None]

    def look(self, cameras: Camera, box: Tensor | None) -> Features:
        """Features of V views, of the persons in the boxes (V, 5) if they are given and can be."""
        if box is None or self.plan.detector is None:
            return run(self.plan, self._drawn(cameras), None)
        return run(self.plan.person_known, replace(self._drawn(cameras), box=box), None)

    def see(self, cameras: Camera) -> Boxes:
        """Boxes of all persons, or of the main one where they are not told apart."""
        if self.plan.detector is not None:
            return persons_in(self.plan.detector, self._drawn(cameras))
        box = run(self.plan, self._drawn(cameras), None).require("box")
        return [row[None][: int(torch.isfinite(row[0]))].numpy() for row in box]

    def _drawn(self, cameras: Camera) -> Features:
        self.progress(f"looking from {len(cameras)} views")
        return drawn_by(self.renderer, self.scene, cameras, frozenset({"image", "depth"}))


def with_person(scene: Scene, subject: Subject, label: Tensor | None) -> Scene:
    """The scene with its person; ``label`` (N,) marks the primitives, None leaves them as the scene's files do."""
    geometry = scene.geometry if label is None else scene.geometry.with_label(label)
    return replace(scene, subject=subject, geometry=geometry)


def save_lift(folder: Path, found: Lift) -> None:
    """Write subject.json (with the report) and the labels into ``folder``."""
    save_labels(folder, found.label)
    found.subject.save(folder / SUBJECT, lift=summary(found))


def cache_lift(folder: Path, found: Lift) -> None:
    """Write a lift into a ``folder`` of the cache, if it can be."""
    with into_cache(folder, "the next run lifts the person anew"):
        save_lift(folder, found)


def save_labels(folder: Path, label: Tensor) -> None:
    """Write the membership (N,) in {0, 1} of the primitives into ``folder``."""
    save_tensors(folder / LABELS, {"label": (label > 0.5).to(torch.uint8)})


def load_person(scene: Scene, subject_file: Path) -> Scene:
    """The scene with the person of ``subject_file``, marked by the labels beside it, or else by the scene's files.

    Where its primitives reach only a part of the joints a warning says so.

    Raises:
        InputError: a file is damaged, the labels are of another scene or not from 0 to 1, there are none at all, or
            what they mark lies elsewhere than the person.
    """
    found = _read_person(scene, subject_file)
    check_fits(subject_file, found)
    return found


def _read_person(scene: Scene, subject_file: Path) -> Scene:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    subject = Subject.load(subject_file)
    labels = subject_file.with_name(LABELS)
    if not labels.is_file():
        if not bool(scene.geometry.label.any()):
            hint = "it stands beside the subject.json that lift leaves; copy it too"
            raise InputError(labels, "label", "is missing, and the scene marks nobody", hint)
        return with_person(scene, subject, None)
    count = len(scene.geometry)
    if labels.stat().st_size > count + 4096:
        raise InputError(labels, "label", f"expected {count} labels, the file is larger", "lift this scene again")
    try:
        label = load_file(labels).get("label")
    except SafetensorError as error:
        raise InputError(labels, "", f"not a label file: {error}") from None
    if label is None or tuple(label.shape) != (count,):
        got = None if label is None else tuple(label.shape)
        raise InputError(labels, "label", f"expected ({count},), got {got}", "lift this scene again")
    label = label.to(torch.float32, copy=True)  # rather than a map of the file, which may be replaced
    wrong = label[~((label >= 0) & (label <= 1))]  # NaN among them
    if len(wrong):
        raise InputError(labels, "label", f"expected values from 0 to 1, got {float(wrong[0]):g}", "lift it again")
    return with_person(scene, subject, label)


def lifted_scene(
    scene: Scene,
    renderer: Any,
    extractors: Mapping[str, Any],
    progress: Callable[[str], None] = lambda step: None,
    person: int | None = None,
) -> Scene:
    """The scene with its person: its own, that of the cache by content, or lifted now (and cached).

    Who is marked in the scene's files stays marked, if no ``person`` is asked for (:class:`.lift.LiftOptions`).
    """
    if scene.subject is not None:
        return scene
    cached = cached_lift(scene, renderer, extractors, person)
    if cached.is_file():
        found = _read_person(scene, cached)  # which is kept by what the scene holds, and so fits it
    else:
        lifted = lift_scene(scene, renderer, extractors, LiftOptions(person=person), progress)
        cache_lift(cached.parent, lifted)
        found = with_person(scene, lifted.subject, (lifted.label > 0.5).float())
    return replace(found, geometry=scene.geometry) if person is None and bool(scene.geometry.label.any()) else found


def cached_lift(scene: Scene, renderer: Any, extractors: Mapping[str, Any], person: int | None = None) -> Path:
    """Where the cache keeps a person of this scene, drawn with this renderer and read with these extractors.

    By other code of ours that draws or reads, a person is lifted anew.
    """
    steps = make_plan(WANTED, extractors, CLIP_SOURCE, "image").steps
    used = [[step.name, reading(step.extractor), step.hidden] for step in steps]
    files = filter(None, [files_content(renderer)])
    drawn = [RENDERERS.name_of(renderer), {**asdict(renderer), "threads": None}, code_of(renderer), *files]
    shown = [scene.digest, scene.harmonics]
    ours = own_code(*READERS, "renderers", "scenes")
    which = f"person {person}" if person else None  # 0 is whom it takes where nobody is named
    known = [ours, read_by(), shown, scene.up.tolist(), used, drawn, *filter(None, [scene.code, which])]
    text = json.dumps(known, default=str)
    return cache_dir() / "lifts" / hashlib.sha256(text.encode()).hexdigest()[:32] / SUBJECT
