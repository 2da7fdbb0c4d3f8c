"""One trial: a shot is drawn and shot, a method finds cameras, the judge measures them; one row."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..camera import resized
from ..computer.threads import set_threads
from ..describe.shot_scale import shot_scale
from ..features import Features
from ..scenes import Scene
from ..scenes.load import load_scene
from ..shots import shot
from ..trajectory import Trajectory, jerk
from ..transfer import Inputs, Result, transfer
from .failure import failed_clip, pinned_frames
from .judge import HELD_OUT, NETWORK_SIDE, SIDE, Reader, Verdict, judge, judge_take, random_total
from .methods import FAITHFUL, config_of, judge_config, method
from .protocol import FPS, SIZE, Trial, drawn_start
from .replay import rebuilt, replayed
from .truth import path_errors
from .warm_up import warm_up

Row = dict[str, Any]  # plain values, as JSON gives them back


@dataclass(frozen=True)
class Clip:
    """A reference and the scene it is taught to.

    Args:
        teacher, pupil: the scenes.
        start: key of :data:`cltransfer.bench.protocol.STARTS`.
        reference: the cameras in the teacher.
        true: the same program about the pupil's person, in that person's heights; in a self-transfer the very cameras.
    """

    teacher: Scene
    pupil: Scene
    start: str
    reference: Trajectory
    true: Trajectory

    @classmethod
    def drawn(cls, trial: Trial) -> Clip:
        """The clip of ``trial``."""
        teacher, pupil = (load_scene(f"builtin:{name}") for name in (trial.teacher, trial.pupil))
        start, setup = drawn_start(trial.shot, trial.teacher, trial.seed)
        paths = [shot(trial.shot, scene.person, SIZE, trial.frames, FPS, setup) for scene in (teacher, pupil)]
        return cls(teacher, pupil, start, *paths)


@dataclass(frozen=True)
class Take:
    """What a method found.

    Args:
        trajectory: N cameras.
        pinned: frames with a parameter at its bound, (N,) bool.
        spent: what it cost, by name.
    """

    trajectory: Trajectory
    pinned: Tensor  # (N,)
    spent: Mapping[str, float]


def run_trial(trial: Trial, key: str, folder: Path, networks: bool = False) -> Row:
    """The row of one trial.

    Args:
        trial: what is run.
        key: of the trial.
        folder: gets shots/NAME.json, the reference's cameras, and paths/KEY.json, the cameras that were found.
        networks: the result is also read by the networks, which no method saw.

    Raises:
        UsageError: there is no such method, shot or scene.
        ModelError: ``networks`` was asked for and one is missing.
    """
    set_threads(1)
    clip = Clip.drawn(trial)
    shots = folder / "shots" / f"{trial.shot}-{trial.teacher}-{trial.seed}-{trial.frames}.json"
    clip.reference.save(shots)
    warm_up(trial.pupil)
    take = _taken(trial, clip, shots)
    take.trajectory.save(folder / "paths" / f"{key}.json")
    cameras, height = take.trajectory.camera, clip.pupil.person.height
    readings = ("dis_flow", "networks") if networks else ("dis_flow",)
    return _plain(
        {
            "key": key,
            **asdict(trial),
            "start": clip.start,
            **_judged(trial, clip, take),
            "held_out": {name: _held_out(clip, take, trial, name) for name in readings},
            "truth": asdict(path_errors(cameras, clip.true.camera, height)),
            "jerk": jerk(cameras, height),
            "reference_jerk": jerk(clip.reference.camera, clip.teacher.person.height),
            **take.spent,
        }
    )


def _taken(trial: Trial, clip: Clip, shots: Path) -> Take:
    """Run the method; a replay searches its first frame only."""
    drift = method(trial.method).drift
    options = trial.options if drift is None else (*trial.options, "frames=1")
    config = config_of(trial.method, trial.pupil, trial.seed, options)
    result = transfer(Inputs(f"builtin:{trial.pupil}", f"builtin:{trial.teacher}@{shots}"), config)
    if drift is None:
        pinned = pinned_frames(result.kept.x, result.search)
        return Take(result.trajectory, pinned, spent_on(result, trial.frames))
    scale = clip.pupil.person.height / clip.teacher.person.height
    begun, path = time.perf_counter(), clip.reference.camera
    if method(trial.method).rebuilt:
        path = rebuilt(judge_config(trial.teacher).build_one("renderer"), clip.teacher, clip.reference)
    spent = spent_on(result, trial.frames)
    spent["seconds"] += time.perf_counter() - begun
    camera = replayed(path, result.trajectory.camera[0], scale, drift)
    still = torch.zeros(trial.frames, dtype=torch.bool)
    return Take(Trajectory(camera, clip.reference.times), still, spent)


def spent_on(result: Result, frames: int) -> dict[str, float]:
    """Evaluations a frame, and seconds of the search, with those of the initial view and of finding floaters."""
    seconds = sum(result.seconds.get(step, 0.0) for step in ("floaters", "initial view", "search"))
    return {"evaluations": result.spent.evaluations / frames, "seconds": seconds}


def _judged(trial: Trial, clip: Clip, take: Take) -> Row:
    """Terms, totals, failures and classes by the judge's reading."""
    reader, faithful = (Reader.of(trial.pupil, overrides) for overrides in ((), FAITHFUL))
    reference, rendered = _both(clip, take, reader, Reader.of(trial.teacher))
    cameras, true = take.trajectory.camera, clip.true.camera
    verdict, reasons, failed = judge_take(reader, reference, rendered, clip.pupil, cameras, true, take.pinned)
    printed = judge(faithful.objective, reference, rendered)
    total, chance = float(verdict.totals.mean()), random_total(reader, reference, clip.pupil, trial.seed)
    classes, wanted = shot_scale(rendered), shot_scale(reference)
    return {
        "terms": _columns(verdict, verdict.terms),
        "priced": _columns(verdict, verdict.priced),
        "faithful": _columns(printed, printed.terms),
        "totals": verdict.totals.tolist(),
        "total": total,
        "random_total": chance,
        "failed": {reason: where.nonzero()[:, 0].tolist() for reason, where in reasons.items() if where.any()},
        "failed_clip": failed_clip(failed, total, chance),
        "scale_agreement": float((classes == wanted)[wanted >= 0].double().mean()),
    }


def _held_out(clip: Clip, take: Take, trial: Trial, name: str) -> dict[str, list[float]]:
    """Terms by extractors that no objective had; a render that lacks what the reference has pays the penalty."""
    side = NETWORK_SIDE if name == "networks" else SIDE
    reader, other = (Reader.of(scene, HELD_OUT[name], side) for scene in (trial.pupil, trial.teacher))
    verdict = judge(reader.objective, *_both(clip, take, reader, other))
    return _columns(verdict, verdict.priced)


def _both(clip: Clip, take: Take, reader: Reader, other: Reader) -> tuple[Features, Features]:
    """Features of the reference and of what was found, read by one rule; ``other`` draws the teacher's form."""
    reference = other.read(clip.teacher, clip.reference.camera)
    cameras = resized(take.trajectory.camera, SIZE)
    return reference, reader.read(clip.pupil, cameras, reference.names())


def _columns(verdict: Verdict, values: Tensor) -> dict[str, list[float]]:
    return dict(zip(verdict.names, values.T.tolist()))


def _plain(value: Any) -> Any:
    """The same with lists for tuples and None for what is not finite, as JSON has it."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
