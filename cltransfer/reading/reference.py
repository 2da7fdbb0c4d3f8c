"""The reference: a clip, an image folder, a run, a feature file, or a scene with a trajectory; read once, cached."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from ..along_clip import check_times
from ..errors import InputError
from ..extractors.scene_orientation import SceneOrientation
from ..features import Features
from ..models.content import READERS, read_by, reading
from ..near_plane import cut_note
from ..pipeline.components import SCENE_SOURCE, Components
from ..pipeline.graph import CHUNK, run_clip
from ..pipeline.plan import Family, Plan
from ..progress import Progress, silent
from ..registry.declared import BUILTIN
from ..registry.plugin_code import own_code
from ..shots import SHOTS
from ..storage.files import cache_dir, content_hash, into_cache
from ..storage.run_files import SUBJECT
from .feature_file import LIMIT, FeatureFile
from .frames import ELSEWHERE, check_maps, check_room, read_alike, read_frames, read_renders, require_person
from .scene_source import is_scene

_log = logging.getLogger("cltransfer")
BY_GEOMETRY = "networks see nobody in its renders: extract.inner=geometric reads the scene itself"

if TYPE_CHECKING:
    from ..clips.clip import Clip


@dataclass(frozen=True)
class Reference:
    """What a transfer or an evaluation is measured against.

    Args:
        features: N frames without pixels.
        times: (N,) [s], from 0.
        image: the frames, (N, 3, H, W) uint8, None for a feature file.
        name: for tables and folders.
        digest: of its content.
        family: which extractors read it: image (a clip) or scene (a scene with a trajectory).
        missing: features it cannot have, with the reason.
        flags: what was done to it and what is doubtful in it, for reports.
        zoom: its longest focal length over its shortest, >= 1, where its cameras are known; None where they are not.
        without: features by which nothing else is read on either side, since a render had to do without them.
    """

    features: Features
    times: Tensor  # (N,)
    image: Tensor | None
    name: str
    digest: str
    family: Family
    missing: Mapping[str, str]
    flags: tuple[str, ...] = ()
    zoom: float | None = None
    without: frozenset[str] = frozenset()

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True)
class Reading:
    """How a reference is read.

    Args:
        frames: how many, evenly over the clip; None takes all.
        side: longer side of the frames that a scene with a trajectory is rendered at [px].
        scene_family: which extractors read a scene with a trajectory.
    """

    frames: int | None = None
    side: int = 720
    scene_family: Family = "scene"


def read_reference(source: str, parts: Components, reading: Reading, progress: Progress = silent) -> Reference:
    """Read ``source``.

    Args:
        source: a video or an image folder, with ``#t=START,END&person=ID`` for a part of it and ``#fps=N`` for how
            fast its images play (:class:`cltransfer.clips.source.ClipSource`), a feature file (.safetensors),
            ``builtin:SHOT``, or ``SCENE@TRAJECTORY.json`` (:func:`cltransfer.reading.scene_source.split_scene`).
        parts: the config's components.
        reading: frames, size, extractors.
        progress: called with a step, frames done, frames in all.

    Raises:
        InputError: it is missing, damaged, has a cut, or shows no person in any frame.
        UsageError: the part asked for cannot be.
    """
    if is_scene(source):
        reference = _from_scene(source, parts, reading, progress)
    elif source.endswith(".safetensors"):
        reference = _from_file(Path(source), parts, reading.frames)
    else:
        reference = _from_clip(source, parts, reading.frames, progress)
    hint = BY_GEOMETRY if is_scene(source) else ELSEWHERE
    require_person(source, reference.features, hint if reference.family == "image" else "")
    return reference


def beside(rendered: Features, reference: Reference, parts: Components, progress: Progress = silent) -> Reference:
    """The ``reference`` by the rule by which networks could read what was ``rendered`` (:func:`read_alike`).

    What one render had to do without no later one is read by. A feature file, which has no frames, stays as it is.
    """
    if reference.image is None:
        return reference
    plan = parts.plan("image").hiding(reference.without)
    features = read_alike(reference.features, reference.image, plan, rendered, progress)
    without = reference.without | (rendered.reasons.keys() - reference.features.reasons.keys())
    return replace(reference, features=features, without=without)


def as_read(parts: Components, reference: Reference) -> Components:
    """``parts`` whose scene extractors mean by an angle what the readers of ``reference`` do, where nobody says."""
    return about_shown(parts) if reference.family == "image" else parts


def about_shown(parts: Components) -> Components:
    """``parts`` whose scene extractors have angles about what is shown of the person, where nobody says."""
    extractors = {
        name: replace(extractor, about="shown")
        if isinstance(extractor, SceneOrientation) and extractor.about == "auto"
        else extractor
        for name, extractor in parts.extractors.items()
    }
    return replace(parts, extractors=extractors)


def times_field(source: str) -> str:
    """By what name a reference says when its frames are shown, for error lines.

    >>> times_field("clip.mp4"), times_field("clip.safetensors"), times_field("builtin:pan")
    ('t', 'times', 'time')
    """
    return "time" if is_scene(source) else "times" if source.endswith(".safetensors") else "t"


def _from_clip(source: str, parts: Components, frames: int | None, progress: Progress) -> Reference:
    from ..clips.image_folder import clip_hash
    from ..clips.kept_clip import kept_clip
    from ..clips.open_clip import open_clip
    from ..clips.source import ClipSource

    asked_for = ClipSource.parse(source)
    if source in SHOTS and not asked_for.path.exists():
        raise InputError(source, "", "no such file", f"did you mean builtin:{source}?")
    where = kept_clip(asked_for)
    clip, flags = open_clip(where, frames)
    plan = parts.plan("image")
    digest = clip_hash(where.path)
    asked = [frames, str(where.span), where.fps, where.person, clip.times.tolist()]
    key = _key([digest, _pixels(clip.image), clip.size, *asked], plan)
    cached = cache_dir() / "features" / f"{key}.safetensors"
    stored = _kept(cached)
    if stored is not None:
        features, read = _with_pixels(stored.features, clip, plan), tuple(stored.origin.splitlines()[1:])
    else:
        plan.load_networks()
        features, read = read_frames(
            clip.image, plan, where.who(clip.times, clip.size), progress, clip.times, where.path
        )
        file = FeatureFile(features, clip.times, "\n".join([where.path.name, *read]))
        if file.size <= LIMIT and file.lasts:  # others are read anew by every run
            with into_cache(cached, "the next run reads the clip anew"):
                file.save(cached)
    flags = (*flags, *read, *plan.notes)
    name = asked_for.path.stem
    return Reference(features, clip.times, clip.image, name, digest, "image", plan.missing, flags)


def _kept(cached: Path) -> FeatureFile | None:
    """What the cache has of a clip; None where it has nothing, or what is damaged, which is told and made anew."""
    if not cached.is_file():
        return None
    try:
        return FeatureFile.load(cached)
    except InputError as error:
        _log.warning("%s: the clip is read anew", error)
        return None


def _with_pixels(features: Features, clip: Clip, plan: Plan) -> Features:
    """What the cache keeps of a ``clip``, and its pixels where the plan wants them: they are in the clip itself.

    Raises:
        ResourceError: there is no memory for them, as where the clip is read.
    """
    if "image" not in plan.wanted:
        return features
    check_maps(clip.image)
    return replace(features, image=clip.features().image)


def _pixels(image: Tensor) -> str:
    """SHA-256 of the pixels of frames (N, 3, H, W) uint8: one file may be decoded otherwise than it once was."""
    digest = hashlib.sha256()
    for frame in image:  # 3 ms each at 960 x 540
        digest.update(frame.contiguous().numpy())
    return digest.hexdigest()


def _key(what: list[Any], plan: Plan) -> str:
    steps = [[s.name, reading(s.extractor), list(s.hidden)] for s in plan.steps]
    text = json.dumps([own_code(*READERS), read_by(), what, sorted(plan.wanted), steps], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _from_file(path: Path, parts: Components, frames: int | None) -> Reference:
    stored = FeatureFile.load(path)
    check_times(path, "times", stored.times)
    index = list(range(len(stored.times)))
    if frames is not None and frames != len(index):
        reason = f"holds {len(index)} frames, {frames} asked for"
        hint = "take all by frames=null, or write a file of so many: flow goes from each frame to the next"
        raise InputError(path, "frames", reason, hint)
    wanted = {n for loss in parts.losses.values() for n in loss.requires}
    missing = {n: "not in the feature file" for n in wanted if not stored.features.has(n)}
    return Reference(stored.features, stored.times, None, path.stem, content_hash(path), "image", missing)


def _from_scene(source: str, parts: Components, reading: Reading, progress: Progress) -> Reference:
    from ..drawing import drawn_by, renderer_of
    from .named_scenes import lift_command, load_reference_scene

    scene, path = load_reference_scene(source, reading.frames, reading.side)
    if scene.subject is None and reading.scene_family == "scene":
        reason = f"the reference scene has no lifted person: no {SUBJECT} beside the trajectory"
        raise InputError(source, "subject", reason, lift_command(source, scene))
    plan = parts.plan(reading.scene_family)
    buffers = (plan.buffers | {"image"}) - SCENE_SOURCE
    renderer = renderer_of(scene, parts.renderer)
    check_room((len(path), *path.camera.size))
    image = torch.empty((len(path), 3, *path.camera.size[::-1]), dtype=torch.uint8)

    def load(start: int, stop: int) -> Features:
        rendered = drawn_by(renderer, scene, path.camera[start:stop], buffers)
        image[start:stop] = quantised(rendered.require("image"))  # a reader of whole clips asks for a frame again
        return replace(rendered, image=image[start:stop].float() / 255)

    task, flags = "rendering the reference", tuple[str, ...]()
    if reading.scene_family == "image":  # as its result is read: who is filmed is followed
        for start in range(0, len(path), CHUNK):
            load(start, start + CHUNK)
            progress(task, min(start + CHUNK, len(path)), len(path))
        features, read = read_renders(image, path.camera, scene.subject, plan, path.times, progress)
        flags = (*read, *plan.notes)
    else:
        features = run_clip(plan, load, len(path), progress, task)
    told = [scene.digest, scene.harmonics, scene.person_digest, path.to_json(), *filter(None, [scene.code])]
    digest = hashlib.sha256(json.dumps(told).encode()).hexdigest()
    if scene.subject is not None and (note := cut_note(renderer, path.camera, scene.subject.joints)):
        flags = (note, *flags)
    features = replace(features, camera=None, person=None)
    name, focal = Path(source.removeprefix(BUILTIN).replace("@", "-")).stem, path.camera.focal
    zoom, family = float(focal.max() / focal.min()), reading.scene_family
    return Reference(features, path.times, image, name, digest, family, plan.missing, flags, zoom)


def quantised(image: Tensor) -> Tensor:
    """What a file keeps of frames (N, 3, H, W) in [0, 1]: uint8."""
    return (image.clamp(0, 1) * 255).round().to(torch.uint8)
