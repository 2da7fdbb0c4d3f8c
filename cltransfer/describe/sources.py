"""What can be described: a clip, a run folder or a camera path, each by what is known of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from ..along_clip import places
from ..clips.thinned import evenly
from ..computer.threads import default_count, set_threads, threads_restored
from ..config.options import RunConfig
from ..errors import InputError, UsageError
from ..extractors.scene_joints import NEAR, project_joints
from ..extractors.scene_orientation import SceneOrientation
from ..features import Features
from ..pipeline.components import Components
from ..progress import Progress, silent
from ..reading.reference import Reading, about_shown, read_reference
from ..reading.scene_source import is_scene
from ..reading.tracks import righted
from ..storage.run_files import SUBJECT, TRAJECTORY, is_run, require_done
from ..subject import Subject
from ..trajectory import Trajectory
from .camera_path import camera_path
from .description import Description, describe_features
from .flow_motion import flow_motion
from .path_motion import path_motion

NEEDS = ("keypoints", "orientation", "flow", "layers")  # features
HINT = "a description needs the losses that read it"


@threads_restored()
def describe(
    source: str, config: RunConfig, subject: Path | None = None, progress: Progress = silent
) -> tuple[Description, Tensor | None]:
    """Describe ``source``.

    Args:
        source: a reference as ``transfer`` takes it, a run folder, or a ``trajectory.json``.
        config: which extractors read a clip; ``frames`` thins it. Meanwhile the threads of the whole process are as
            it says.
        subject: ``subject.json`` of the person a camera path films; None looks beside the path.
        progress: called with a step, frames done, frames in all.

    Returns:
        The description, and the frames (N, 3, H, W) uint8 where there are any.

    Raises:
        InputError: the source is missing, damaged or an unfinished run, or a camera path has no person.
        UsageError: by the config not all would be read, or a person is named of what is no camera path.
    """
    set_threads(config.threads or default_count())
    require_done(Path(source))
    if (path := camera_path(source)) is not None:
        return describe_path(path, subject, config.frames), None
    if subject is not None:
        reason = "is read of a camera path alone, expected a trajectory.json or the folder of a run"
        raise UsageError(source, "--subject", reason, "leave it out")
    parts = about_shown(Components.build(config))
    if not source.endswith(".safetensors"):  # which has its features, whatever the config asks for
        _check_needs(source, parts)
    reading = Reading(config.frames, config.output_side, "scene")
    reference = read_reference(source, parts, reading, progress)
    lacking = [name for name in NEEDS if not reference.features.has(name)]
    if lacking:
        reason = {**reference.missing, **reference.features.reasons}.get(lacking[0], "not read")
        raise InputError(source, lacking[0], reason, HINT)
    motion = flow_motion(reference.features, reference.times)
    read = reference.features
    if reference.family != "scene":  # a scene's is exact
        read = righted(read, reference.times, places(reference.times))
    shown = describe_features(reference.name, read, reference.times, motion, reference.missing)
    lost = [f"the run has no {TRAJECTORY}: read from its frames, as a clip is"] if is_run(Path(source)) else []
    return replace(shown, flags=(*lost, *shown.flags, *reference.flags)), reference.image


def _check_needs(source: str, parts: Components) -> None:
    """Refuse what would not read all that a description is made of, rather than after reading the rest."""
    plan = parts.plan("scene" if is_scene(source) else "image")
    for name in NEEDS:
        if name not in plan.wanted or name in plan.missing:
            reason = plan.missing.get(name, "expected a loss that reads it, none is left")
            raise UsageError(source, name, reason, HINT)


def describe_path(path: Path, subject: Path | None = None, frames: int | None = None) -> Description:
    """Describe the camera path ``path`` about the person of ``subject``, or of ``subject.json`` beside it.

    Of its cameras ``frames`` are read, evenly in time; None reads all.

    Raises:
        InputError: a file is missing or damaged.
    """
    whole = Trajectory.load(path)
    kept = evenly(whole.times, frames)
    trajectory = Trajectory(whole.camera[kept], whole.times[kept])
    beside = subject or path.with_name(SUBJECT)
    if not beside.is_file():
        raise InputError(path, "subject", "no subject.json beside it", "name one: --subject FILE")
    person = Subject.load(beside)
    features = path_features(trajectory, person)
    motion = path_motion(trajectory, person)
    name = path.resolve().parent.name if path.name == TRAJECTORY else path.stem
    return describe_features(name, features, trajectory.times, motion, {"depth": "a camera path has no depth"})


def path_features(path: Trajectory, person: Subject) -> Features:
    """Joints and orientation of ``person`` as the cameras of ``path`` see it, nothing hiding it."""
    camera = path.camera
    near = NEAR * person.height
    pixels, depth = project_joints(camera, person.joints, near)
    inside = ((pixels >= 0) & (pixels < pixels.new_tensor(camera.size))).all(-1) & (depth > near)
    confidence = torch.where(inside, person.confidence, 0.0)[..., None]
    keypoints = torch.cat([pixels, confidence], dim=-1)
    return SceneOrientation("shown")(Features(camera.size, keypoints=keypoints, camera=camera, person=person), None)
