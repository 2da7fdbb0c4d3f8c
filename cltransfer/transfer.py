"""The story of a transfer: reference + scene + config -> cameras, rendered and measured.

:func:`cltransfer.run.folder.write_run` writes the folder of a run.
"""

from __future__ import annotations

from .computer.threads import threads_restored
from .config.options import RunConfig
from .pipeline.scores import tabulate
from .progress import Progress, silent
from .run.inputs import Inputs
from .run.preparation import Clock, prepare
from .run.readback import read_held
from .run.record import Record
from .run.result import Result
from .run.rounds import attempts, best_of
from .trajectory import Trajectory

__all__ = ["Inputs", "Record", "Result", "transfer"]


@threads_restored()
def transfer(inputs: Inputs, config: RunConfig, progress: Progress = silent, record: Record | None = None) -> Result:
    """Find the cameras that reproduce the reference's camera language in the scene.

    Meanwhile the threads of the whole process are as the config says.

    Args:
        inputs: scene, reference and initial view.
        config: everything else.
        progress: called with a step, frames done, frames in all.
        record: where what was scored is kept, so that a run that was killed can go on. None keeps nothing.

    Returns:
        What was found: ``trajectory`` of the cameras, ``image`` of their frames, ``searched`` and ``attempts`` with the
        losses as the search and the networks read them, ``spent``.

    Raises:
        UsageError: the config asks for what the scene or the reference cannot give, or this very run was begun in the
            folder of ``record`` and has not come to its end.
        InputError: a file is missing or damaged, or shows no person, or a journal to go on with is of another run.
        ModelError: a network is missing.
        ResourceError: the frames cannot be kept in memory, or another process writes the journal.
    """
    clock = Clock()
    job = prepare(inputs, config, clock, progress, record)
    made, note = attempts(job, clock, progress)
    kept = best_of(made)
    stage, reference, cameras = job.stage, job.reference, made[kept].cameras
    terms = stage.path_terms(job.wanted, cameras)
    held = read_held(stage, job.parts, made[kept].shown, cameras)
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
        family="image" if job.by_networks or config.extract.inner == "image" else "scene",
        spent=stage.spent,
        seconds=clock.seconds,
        alignment=job.alignment,
        floaters=job.floaters,
        header=job.header,
    )
