"""Baselines on the same clips: JAWS, the five losses with Adam, the paper's setting, replay; ours beside them.

Every method gets the same reference features, renderer and first view, and is scored by the same five losses, whatever
it minimised itself. Cost is counted in evaluations, one rendered and scored candidate each, and for Adam in gradient
steps too.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import torch

from ..camera import Camera
from ..config import RunConfig, load_config
from ..driver.initial_view import best_of_orbit, first_seen
from ..driver.stage import Stage
from ..objective import Objective
from ..reference import Components, Reading, Reference, read_reference
from ..scenes.load import load_scene
from ..scores import Scores, tabulate
from ..shots import SHOTS, shot
from ..subject import Subject
from ..trajectory import Trajectory
from ..transfer import Inputs, fit, transfer
from .driver import PUPIL, ROBUST, TEACHER, drawn, pose_errors
from .replay import replayed
from .section import machine, table, write_section

SIZE = (640, 360)  # [px] of the reference
SIDE = 160  # [px] of everything rendered
REPLAY = {"replay": 1.0, "replay_drift": 1.3}  # scale at the last frame
ADAM = ("jaws_code", "jaws_clean", "five_adam")
METHODS = (*REPLAY, *ADAM, "jaws_losses_cma", "paper", "balanced")
HEADER = ("method", "target", "clips", "total", "evaluations a frame", "gradient steps a frame", "seconds a clip")
POSE = ("position [heights]", "rotation [deg]", "focal [%]")


@dataclass(frozen=True)
class Row:
    """One method on one clip.

    Args:
        method, target, shot, seed: what was run; target is self or cross.
        scores: of the five losses.
        evaluations, steps: candidates scored and gradients taken in the search, a frame.
        seconds: of the search.
        pose: median errors of position [subject heights], rotation [degrees] and focal length [share]; NaN for cross.
    """

    method: str
    target: str
    shot: str
    seed: int
    scores: Scores
    evaluations: float
    steps: float
    seconds: float
    pose: tuple[float, float, float]


@dataclass(frozen=True)
class Baselines:
    """What is run.

    Args:
        seeds: of where the shots stand.
        methods: presets, ``replay`` and ``replay_drift``.
        shots: canonical shots.
        frames: of each clip.
        overrides: of every preset, ``key=value``.
    """

    seeds: tuple[int, ...] = (0,)
    methods: tuple[str, ...] = METHODS
    shots: tuple[str, ...] = SHOTS
    frames: int = 24
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Clip:
    """A clip that methods are run on."""

    scene: str
    target: str
    seed: int
    true: Trajectory
    source: str  # of the reference
    view: Path  # first view of every method
    home: Camera
    stage: Stage
    reference: Reference
    unit: float  # height of the filmed subject, scene units

    @property
    def subject(self) -> Subject:
        subject = self.stage.scene.subject
        assert subject is not None
        return subject


def run_baselines(bench: Baselines, told: Callable[[Row], None] = lambda row: None) -> list[Row]:
    """Run every method on every shot, seed and target."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in bench.shots:
            for seed in bench.seeds:
                for clip in _clips(name, seed, bench.frames, Path(folder)):
                    for method in bench.methods:
                        rows.append(_run(method, name, clip, bench.overrides))
                        told(rows[-1])
    return rows


def _clips(name: str, seed: int, frames: int, folder: Path) -> Iterator[_Clip]:
    filmed = load_scene(TEACHER).subject
    assert filmed is not None
    true = shot(name, filmed, SIZE, frames, setup=drawn(name, seed))
    path = folder / f"{name}-{seed}.json"
    true.save(path)
    parts = Components.build(load_config())
    source = f"{TEACHER}@{path}"
    reference = read_reference(source, parts, Reading(side=SIDE))
    for target, scene in (("self", TEACHER), ("cross", PUPIL)):
        plan = parts.plan("scene", shared=reference.features.names())
        stage = Stage(load_scene(scene), parts.renderer, plan, Objective(parts.losses), fit(SIZE, SIDE))
        home = best_of_orbit(stage, first_seen(reference.features), stage.size, free_lens=True)[0]
        view = folder / f"{name}-{seed}-{target}.json"
        Trajectory(home, torch.zeros(1, dtype=torch.float64)).save(view)
        yield _Clip(scene, target, seed, true, source, view, home, stage, reference, filmed.height)


def _run(method: str, name: str, clip: _Clip, overrides: tuple[str, ...]) -> Row:
    frames, begun = len(clip.true), time.perf_counter()
    if method in REPLAY:
        camera = replayed(clip.true.camera, clip.home, clip.subject.height / clip.unit, REPLAY[method])
        evaluations, steps, seconds = 0.0, 0.0, time.perf_counter() - begun
    else:
        inputs = Inputs(clip.scene, clip.source, init=str(clip.view))
        result = transfer(inputs, settings(method, clip.seed, overrides))
        camera, seconds = result.trajectory.camera, result.seconds["search"]
        evaluations = result.spent.evaluations / frames
        steps = result.spent.generations / frames if result.schedule.engine == "adam" else 0.0
    terms = clip.stage.path_terms(clip.reference.features, camera)
    scores = tabulate(clip.stage.objective, clip.reference.features, terms, clip.reference.missing)
    pose = (math.nan, math.nan, math.nan)
    if clip.target == "self":
        pose = pose_errors(camera, clip.true.camera, clip.unit)
    return Row(method, clip.target, name, clip.seed, scores, evaluations, steps, seconds, pose)


def settings(method: str, seed: int, overrides: Sequence[str] = ()) -> RunConfig:
    """A preset on geometric features at one size; the paper's with the robust losses: only the search differs."""
    same = [f"preset={method}", f"seed={seed}", f"search_side={SIDE}", f"output_side={SIDE}", "extract.inner=geometric"]
    if method == "paper":
        same += [*ROBUST, "losses.camera_movement.weight=40"]
    return load_config(overrides=[*same, *overrides])


def header(rows: Sequence[Row]) -> list[str]:
    """Column names of :func:`summary`."""
    return [*HEADER, *(f"{term.name} [{term.unit}]" for term in rows[0].scores.terms), *POSE]


def summary(rows: Sequence[Row]) -> list[list[str]]:
    """Means over clips and frames for each method and target, under :func:`header`; pose errors as medians of clips."""
    lines = []
    for target in dict.fromkeys(row.target for row in rows):
        for method in dict.fromkeys(row.method for row in rows):
            mine = [row for row in rows if (row.method, row.target) == (method, target)]
            if mine:
                lines.append([method, target, str(len(mine)), *_costs(mine), *_metrics(mine), *_poses(mine)])
    return lines


def _costs(rows: Sequence[Row]) -> list[str]:
    total = fmean(float(row.scores.totals.mean()) for row in rows)
    means = [fmean(getattr(row, name) for row in rows) for name in ("evaluations", "steps", "seconds")]
    return [f"{total:.2f}", f"{means[0]:.0f}", f"{means[1]:.0f}", f"{means[2]:.1f}"]


def _metrics(rows: Sequence[Row]) -> list[str]:
    """Mean raw value of each term, with its coverage where it is not whole."""
    cells = []
    for k in range(len(rows[0].scores.terms)):
        values = torch.cat([row.scores.terms[k].values for row in rows])
        known = values[torch.isfinite(values)]
        coverage = "" if len(known) == len(values) else f" ({len(known)}/{len(values)})"
        cells.append(f"{float(known.mean()):.4f}{coverage}" if len(known) else f"undefined{coverage}")
    return cells


def _poses(rows: Sequence[Row]) -> list[str]:
    errors = torch.tensor([row.pose for row in rows]).median(0).values * torch.tensor([1.0, 1.0, 100.0])
    return ["" if math.isnan(error) else f"{error:.3f}" for error in errors.tolist()]


def write_baselines(rows: Sequence[Row], path: Path, command: str) -> None:
    """Rewrite the section "Baselines" of the Markdown file ``path``."""
    lines = [
        f"Made by `{command}`. Canonical shots in the plaza, taught to the plaza (self) and to the courtyard (cross);",
        "all methods from the same first view, on the same geometric features, scored by the same five losses: means",
        "over frames and clips, raw, with coverage where a term is undefined on some frames. A total of 1 means every",
        "term at its tolerance. Adam's gradients are central differences: an evaluation is one rendered candidate, 18",
        "an iteration in two strokes. Pose errors are medians over clips of the median over frames.",
        *machine(),
        "",
        *table(header(rows), summary(rows)),
    ]
    write_section(path, "Baselines", lines)
