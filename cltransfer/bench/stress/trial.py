"""One stressed trial: a clip is drawn and made worse, a method finds cameras, the unstressed clip judges them.

The judge's scene and reference are those before the stress: what counts is where the camera went, not what the stress
hides or shows.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ...camera import Camera, fitted_size, resized
from ...computer.threads import set_threads
from ...config import load_config, to_yaml
from ...errors import UsageError
from ...pipeline.components import Components
from ...pipeline.objective import Objective
from ...reading.feature_file import FeatureFile
from ...scenes.load import load_scene
from ...scenes.ply import write_splats
from ...shots import shot
from ...storage.run_files import LABELS, SUBJECT
from ...trajectory import Trajectory
from ...transfer import Inputs, transfer
from ..failure import failed_clip, pinned_frames
from ..judge import Reader, Verdict, judge_take, random_total
from ..methods import config_of, config_text, method
from ..protocol import FPS, SIZE, drawn_start, row_key
from ..replay import rebuilt, replayed
from ..trial import Row
from .case import Case, Film, Stressor
from .filming import FILMING
from .reading import READING
from .scenery import SCENERY
from .viewing import VIEWING

STRESSORS: dict[str, Stressor] = {**VIEWING, **READING, **SCENERY, **FILMING}
VERSION = 3  # raise it when the same trial means something else
SIDE = 160  # longer side of what is read and judged [px]
ClipName = tuple[str, str, str, int]  # shot, teacher, pupil, seed


def stressor_called(name: str) -> Stressor:
    """The stressor called ``name``.

    Raises:
        UsageError: there is none.
    """
    if name not in STRESSORS:
        raise UsageError("", f"stressor {name!r}", "no such stressor", f"known: {', '.join(STRESSORS)}")
    return STRESSORS[name]


@dataclass(frozen=True)
class StressTrial:
    """One transfer under stress.

    Args:
        method: see :mod:`cltransfer.bench.methods`.
        stressor: key of :data:`STRESSORS`; empty without stress.
        level: 1 to 5, 0 without stress.
        shot, teacher, pupil, seed: the clip, as in :class:`cltransfer.bench.protocol.Trial`.
        frames: of the clip, before it is hurried.
        options: config overrides over the method's.
    """

    method: str
    stressor: str
    level: int
    shot: str
    teacher: str
    pupil: str
    seed: int
    frames: int
    options: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.stressor:
            stressor_called(self.stressor)
        if (self.level > 0) != bool(self.stressor) or not 0 <= self.level <= 5:
            raise ValueError(f"level must be 0 without a stressor and 1 to 5 with one, got {self.level}")

    @property
    def clip(self) -> ClipName:
        """What is equal for all methods and stressors."""
        return self.shot, self.teacher, self.pupil, self.seed

    @property
    def key(self) -> str:
        """Digest of the trial, the stress it is put under, the config it comes to, and what it is judged by."""
        config = config_text(self.method, self.pupil, self.seed, self.options)
        value = STRESSORS[self.stressor].levels[self.level - 1] if self.stressor else 0.0
        return row_key(VERSION, asdict(self), value, config, _judge_text())


@lru_cache(maxsize=1)
def _judge_text() -> str:
    return to_yaml(load_config())


KNOWN = "extractors.scene_orientation.about=body"  # no network has read the angles of a reference


@dataclass(frozen=True)
class _Clip:
    """A clip before the stress, as the judge knows it."""

    case: Case
    path: Camera  # of the reference
    true: Camera  # the same program about the person of the target
    scale: float  # height of the person in the target over that in the reference
    reader: Reader  # the judge's


def run_stress(trial: StressTrial) -> Row:
    """The row of one trial, plain values; it depends on the trial alone.

    Raises:
        UsageError: there is no such method, shot or scene.
    """
    set_threads(1)
    stressor = STRESSORS.get(trial.stressor)
    value = stressor.levels[trial.level - 1] if stressor else 0.0
    film = Film(trial.frames, SIZE)
    clip = _drawn(trial.clip, stressor.film(film, value) if stressor else film)
    rng = np.random.Generator(np.random.PCG64([trial.seed, trial.level, *trial.stressor.encode()]))
    given = stressor.strain(clip.case, value, rng) if stressor else clip.case
    cameras, pinned = _taken(trial, clip, given)
    reader, reference, scene = clip.reader, clip.case.reference, clip.case.scene
    rendered = reader.read(scene, cameras, reference.names())
    verdict, reasons, failed = judge_take(reader, reference, rendered, scene, cameras, clip.true, pinned)
    total, chance = float(verdict.totals.mean()), _chance(trial.clip, trial.frames)
    return {
        "key": trial.key,
        **asdict(trial),
        "options": list(trial.options),
        "value": value,
        "total": total,
        "random_total": chance,
        "failed": failed_clip(failed, total, chance),
        "reasons": {name: int(frames.sum()) for name, frames in reasons.items() if frames.any()},
        "totals": verdict.totals.tolist(),
        "terms": _weighted(verdict, reader.objective),
    }


def _drawn(clip: ClipName, film: Film) -> _Clip:
    name, taught_by, taught, seed = clip
    teacher, pupil = (load_scene(f"builtin:{scene}") for scene in (taught_by, taught))
    _, setup = drawn_start(name, taught_by, seed)
    path, true = (shot(name, scene.person, film.size, film.frames, FPS, setup) for scene in (teacher, pupil))
    reader = Reader(Components.build(load_config()), fitted_size(film.size, SIDE))
    case = Case(replace(reader.read(teacher, path.camera), camera=None, person=None), path.times, pupil, true.camera[0])
    return _Clip(case, path.camera, true.camera, pupil.person.height / teacher.person.height, reader)


def _taken(trial: StressTrial, clip: _Clip, given: Case) -> tuple[Camera, Tensor]:
    """Cameras that the method found, and frames with a parameter at its bound, (N,) bool."""
    drift = method(trial.method).drift
    if drift is not None:
        path = clip.path
        if method(trial.method).rebuilt:
            teacher = load_scene(f"builtin:{trial.teacher}")
            path = rebuilt(load_config().build_one("renderer"), teacher, Trajectory(path, clip.case.times))
        path = replayed(path, given.view, clip.scale, drift)
        return path, torch.zeros(len(path), dtype=torch.bool)
    config = config_of(trial.method, trial.pupil, trial.seed, (KNOWN, *trial.options))
    with tempfile.TemporaryDirectory() as folder:
        result = transfer(_on_disk(given, Path(folder)), config)
    pinned = pinned_frames(result.kept.x, result.search)
    return resized(result.trajectory.camera, clip.path.size), pinned


def _on_disk(case: Case, folder: Path) -> Inputs:
    """The case as a user has it: a scene with its person, read features, a first view."""
    from safetensors.torch import save_file

    scene = case.scene
    write_splats(folder / "scene.ply", scene.geometry)
    scene.person.save(folder / SUBJECT)
    save_file({"label": (scene.geometry.label > 0.5).to(torch.uint8)}, folder / LABELS)
    FeatureFile(case.reference, case.times, "stress").save(folder / "reference.safetensors")
    Trajectory(case.view, torch.zeros(1, dtype=torch.float64)).save(folder / "view.json")
    return Inputs(
        scene=str(folder / "scene.ply"),
        reference=str(folder / "reference.safetensors"),
        init=str(folder / "view.json"),
        subject=folder / SUBJECT,
        up=tuple(scene.up.tolist()),
    )


@lru_cache(maxsize=64)
def _chance(clip: ClipName, frames: int) -> float:
    """What random views score on the clip without stress, for the definition of failure."""
    case = _drawn(clip, Film(frames, SIZE)).case
    return random_total(Reader.of(clip[2], side=SIDE), case.reference, case.scene, clip[3])


def _weighted(verdict: Verdict, objective: Objective) -> Mapping[str, float | None]:
    """Mean over the frames of each weighted term, None where the reference lacks it throughout."""
    means = (verdict.priced * objective.weights).nanmean(0)
    return {name: None if mean.isnan() else float(mean) for name, mean in zip(verdict.names, means)}
