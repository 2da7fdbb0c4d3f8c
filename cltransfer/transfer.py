"""The story of a transfer: reference + scene + config -> cameras, measured, rendered and written down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torch import Tensor

from .config.options import RunConfig
from .driver.schedule import Schedule
from .driver.stage import Spent
from .pipeline.objective import Objective
from .pipeline.scores import Scores, tabulate
from .progress import Progress, silent
from .reading.depth_alignment import DepthAlignment
from .reading.reference import Reference
from .run.preparation import Clock, Inputs, Record, prepare
from .run.readback import read_held
from .run.rounds import Attempt, attempts
from .scenes import Scene
from .trajectory import Trajectory


@dataclass(frozen=True)
class Result:
    """What a transfer found.

    Args:
        scene, reference: what it was given, read.
        trajectory: N cameras at the output size.
        attempts: every round; the first is uncorrected.
        best: index of the round with the lowest total, the one that is kept.
        searched: the score in the search, by the inner extractors at the search size, of the cleaned reference.
        held: the score of the first view held still.
        search: vectors to cameras.
        renderer: what drew the scene.
        objective: the losses.
        schedule: how frames were searched.
        note: why there were fewer rounds than the config asks for; empty where there were not, and where geometry read
            the reference, so that there is no bias to correct.
        noise: total that cannot be told apart, because networks read both sides; 0 where geometry did.
        read_by: image (networks read the result too) or geometry (a scene taught a scene, or ``extract.verify=false``).
        spent: what it cost.
        seconds: by step.
        alignment: of the depth network, where the scene told it.
        floaters: Gaussians that hang in the air by themselves; 0 where the config keeps them.
    """

    scene: Scene
    reference: Reference
    trajectory: Trajectory
    attempts: tuple[Attempt, ...]
    best: int
    searched: Scores
    held: Scores
    search: Any
    renderer: Any
    objective: Objective
    schedule: Schedule
    note: str
    noise: float
    read_by: str
    spent: Spent
    seconds: dict[str, float]
    alignment: DepthAlignment | None = None
    floaters: int = 0

    @property
    def kept(self) -> Attempt:
        """The round that is kept."""
        return self.attempts[self.best]

    @property
    def verified(self) -> Scores:
        """The score of the rendered frames as they are kept; it is what the run reports."""
        return self.kept.shown.scores

    @property
    def image(self) -> Tensor:
        """The rendered frames, (N, 3, H, W) uint8."""
        return self.kept.shown.image


def transfer(inputs: Inputs, config: RunConfig, progress: Progress = silent, record: Record | None = None) -> Result:
    """Find the cameras that reproduce the reference's camera language in the scene.

    Args:
        inputs: scene, reference and initial view.
        config: everything else.
        progress: called with a step, frames done, frames in all.
        record: where every batch of candidates for one frame is kept, so that a run that was killed can go on; whole
            paths are not, a resumed run scores them again. None keeps nothing.

    Raises:
        UsageError: the config asks for what the scene or the reference cannot give.
        InputError: a file is missing or damaged, or shows no person.
        ModelError: a network is missing.
    """
    clock = Clock()
    job = prepare(inputs, config, clock, progress, record)
    made, note = attempts(job, config, clock, progress)
    kept = min(range(len(made)), key=lambda i: made[i].shown.scores.total)
    stage, reference, cameras = job.stage, job.reference, made[kept].cameras
    terms = stage.path_terms(job.wanted, cameras)
    held = read_held(stage, job.parts, reference, made[kept].shown, cameras)
    clock.lap("comparison")
    return Result(
        scene=stage.scene,
        reference=reference,
        trajectory=Trajectory(cameras, reference.times),
        attempts=tuple(made),
        best=kept,
        searched=tabulate(stage.objective, job.wanted, terms, reference.missing),
        held=held,
        search=job.search,
        renderer=job.parts.renderer,
        objective=stage.objective,
        schedule=job.schedule,
        note=note,
        noise=job.noise,
        read_by="image" if job.by_networks or config.extract.inner == "image" else "geometry",
        spent=stage.spent,
        seconds=clock.seconds,
        alignment=job.alignment,
        floaters=job.floaters,
    )
