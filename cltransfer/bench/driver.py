"""The driver on canonical shots: loss, pose error, evaluations and seconds, preset against preset on the same clips.

Each seed draws where a shot stands (side, height, distance, size, place in the frame); the reference is the shot in the
plaza, read by geometry. Taught to the plaza itself the true cameras are known; taught to the courtyard they are not,
and the paper's setting on the same features is what the others are held against.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from ..camera import resized
from ..computer.threads import set_threads
from ..config import load_config, to_yaml
from ..config.options import RunConfig
from ..errors import UsageError
from ..scenes.load import load_scene
from ..shots import SHOTS, Setup, own_setup, shot
from ..subject import Subject
from ..trajectory import Trajectory, jerk
from ..transfer import Inputs, Result, transfer
from .judge import Reader, judge
from .methods import ON_ROBUST_LOSSES, judge_config
from .protocol import row_key
from .rows import kept_rows
from .trial import Row, spent_on
from .truth import path_errors
from .warm_up import warm_up

VERSION = 3  # raise it when a row holds something else: older ones are then measured anew
SIZE = (640, 360)  # [px] of the reference
TEACHER = "builtin:plaza"
TARGETS = {"self": TEACHER, "cross": "builtin:courtyard"}
PAPER = "paper"
ON_GEOMETRY = ["extract.inner=geometric", "output_side=160", "search_side=160"]


@dataclass(frozen=True)
class Run:
    """One transfer to measure.

    Args:
        preset: of :mod:`cltransfer.config`.
        target: self or cross.
        shot: canonical.
        seed: of where it stands, and of the search.
        frames: of the clip.
    """

    preset: str
    target: str
    shot: str
    seed: int
    frames: int

    @property
    def key(self) -> str:
        """Digest of the run, the config it comes to, and what the judge reads and scores by."""
        judge = judge_config(TARGETS[self.target])
        config = to_yaml(settings(self.preset, self.seed))
        return row_key(VERSION, asdict(self), config, judge.extractors, judge.losses)


@dataclass(frozen=True)
class Clip:
    """One transfer that was measured.

    Args:
        preset, target, shot, seed: what was run, see :class:`Run`.
        total: mean over the frames, by geometry at the search size, in the scene as it is, floaters and all.
        judged: the same by the judge, at a size that nobody searches at, :data:`.judge.SIDE`.
        evaluations: a frame.
        seconds: of the search, with those of the initial view and of finding floaters.
        position, rotation, focal: median errors of the camera [subject heights, degrees, share]; NaN where unknown.
        extra: total that the path taken costs more than the frames as they were found.
        shaken, smooth: jerk of those frames and of the path, :func:`cltransfer.trajectory.jerk`.
        true: jerk of the reference's own cameras.
    """

    preset: str
    target: str
    shot: str
    seed: int
    total: float
    judged: float
    evaluations: float
    seconds: float
    position: float
    rotation: float
    focal: float
    extra: float
    shaken: float
    smooth: float
    true: float


@dataclass(frozen=True)
class Bench:
    """What is run.

    Args:
        seeds: of where the shots stand.
        presets: to compare.
        shots: canonical shots.
        paper_shots: how many of them the paper's setting, a thousand evaluations a frame, is taught across scenes too,
            for every seed others in turn; 0 leaves it out.
        frames: of each clip.

    Raises:
        UsageError: there is no such shot.
    """

    seeds: tuple[int, ...]
    presets: tuple[str, ...] = ("fast", "balanced")
    shots: tuple[str, ...] = SHOTS
    paper_shots: int = 0
    frames: int = 24

    def __post_init__(self) -> None:
        for name in self.shots:
            own_setup(name)

    def runs(self) -> list[Run]:
        """Every preset on every shot, seed and target."""
        runs = []
        for number, seed in enumerate(dict.fromkeys(self.seeds)):
            turn = {(number * self.paper_shots + k) % len(self.shots) for k in range(self.paper_shots)}
            for at, name in enumerate(self.shots):
                for target in TARGETS:
                    presets = [*self.presets, PAPER] if target == "cross" and at in turn else self.presets
                    runs += [Run(preset, target, name, seed, self.frames) for preset in presets]
        return runs


def seed_range(text: str) -> range:
    """The seeds of ``seeds=FIRST:LAST``, the last one left out.

    >>> list(seed_range("seeds=500:503"))
    [500, 501, 502]

    Raises:
        UsageError: it is not written so, or holds none or more than a thousand.
    """
    match = re.fullmatch(r"(?:seeds=)?(\d{1,9}):(\d{1,9})", text)
    found = range(int(match[1]), int(match[2])) if match else range(0)
    if not 0 < len(found) <= 1000:
        raise UsageError("", text, "expected seeds=FIRST:LAST with 1 to 1000 seeds", "e.g. seeds=500:520")
    return found


def run_driver(bench: Bench, folder: Path, jobs: int = 1, told: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Rows of all runs; kept in ``folder``, and taken from there where they were run before.

    Args:
        bench: what is run.
        folder: of rows.jsonl.
        jobs: clips at a time, one thread each; seconds are comparable where nothing else runs.
        told: hears a line for every new row.
    """
    return kept_rows({run.key: run for run in bench.runs()}, _measured, folder, jobs, told, _named)


def _measured(key: str, run: Run) -> Row:
    set_threads(1)
    subject = load_scene(TEACHER).person
    true = shot(run.shot, subject, SIZE, run.frames, setup=drawn(run.shot, run.seed))
    warm_up(TARGETS[run.target])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shot.json"
        true.save(path)
        result = transfer(Inputs(TARGETS[run.target], f"{TEACHER}@{path}"), settings(run.preset, run.seed))
    return {"frames": run.frames, **row_of(_clip(run, result, true, subject))}


def _named(row: Row) -> str:
    return f"{row['preset']}, {row['target']}, {row['shot']} {row['seed']}, total {row['total']:.3f}"


def row_of(clip: Clip) -> Row:
    """The clip in plain values: what is NaN is None, null in JSON."""
    return {name: None if value != value else value for name, value in asdict(clip).items()}


def clips_of(rows: Sequence[Row]) -> list[Clip]:
    """Clips of rows."""
    return [_clip_of(row) for row in rows]


def _clip_of(row: Row) -> Clip:
    values: Row = {f.name: math.nan if row[f.name] is None else row[f.name] for f in fields(Clip)}
    return Clip(**values)


def drawn(name: str, seed: int) -> Setup:
    """Where shot ``name`` stands for ``seed``.

    Raises:
        UsageError: there is no such shot.
    """
    own_setup(name)
    rng = np.random.Generator(np.random.PCG64([seed, SHOTS.index(name)]))
    return Setup.drawn(rng, seed)


def settings(preset: str, seed: int) -> RunConfig:
    """A preset on geometric features and the robust losses, so that only the search differs."""
    same = ON_ROBUST_LOSSES if preset == PAPER else ()
    return load_config(overrides=[f"preset={preset}", f"seed={seed}", "threads=1", *ON_GEOMETRY, *same])


def _clip(run: Run, result: Result, true: Trajectory, subject: Subject) -> Clip:
    position = rotation = focal = math.nan
    if run.target == "self":
        errors = path_errors(result.trajectory.camera, true.camera, subject.height)
        position, rotation, focal = errors.position, errors.rotation, math.expm1(errors.log_focal)
    evaluations, seconds = spent_on(result, len(result.trajectory)).values()
    total, judged = result.searched.total, _judged(run, result, true)
    kept = result.kept
    height = subject.height if result.scene.subject is None else result.scene.subject.height
    extra = 0.0 if kept.path is None else kept.path.total - kept.path.free
    shaken, smooth = jerk(kept.found.camera, height), jerk(kept.cameras, height)
    shakes = (shaken, smooth, jerk(true.camera, subject.height))
    name = (run.preset, run.target, run.shot, run.seed)
    return Clip(*name, total, judged, evaluations, seconds, position, rotation, focal, extra, *shakes)


def _judged(run: Run, result: Result, true: Trajectory) -> float:
    """Mean total by the judge: what a search gained by the pixels of its own size alone is gone."""
    reader, teacher, pupil = Reader.of(TARGETS[run.target]), load_scene(TEACHER), load_scene(TARGETS[run.target])
    reference = reader.read(teacher, true.camera)
    found = reader.read(pupil, resized(result.trajectory.camera, SIZE), reference.names())
    return float(judge(reader.objective, reference, found).totals.mean())
