"""Measuring a result by other losses than it was searched with: what a row leaves out is measured too."""

from __future__ import annotations

from ..components import Components
from ..config import RunConfig
from ..driver.stage import Stage
from ..graph import Family
from ..objective import Objective
from ..read_frames import render_features
from ..readback import read_path
from ..reference import Reading, read_reference
from ..scenes.lifted import lifted_scene
from ..scores import Scores, score
from ..transfer import Result


def measured(result: Result, reference: str, config: RunConfig, metrics: RunConfig) -> Scores:
    """Scores of ``result`` at its own size by the losses and extractors of ``metrics``.

    As in a transfer, networks read both sides where the reference is a clip and ``extract.verify`` says so.

    Args:
        result: of a transfer.
        reference: what it was transferred from.
        config: of the transfer; its renderer draws the scene again.
        metrics: losses and extractors, and by ``extract.inner`` whether geometry or networks read a scene.

    Raises:
        InputError: the reference cannot be read by these extractors.
    """
    cameras = result.trajectory.camera
    parts = Components(config.build_one("renderer"), metrics.build("extractors"), metrics.build("losses"))
    family: Family = "scene" if metrics.extract.inner == "geometric" else "image"
    read = read_reference(reference, parts, Reading(config.frames, config.output_side, family))
    objective = Objective(parts.losses)
    if read.family == "image" and metrics.extract.verify:
        features = render_features(result.image, cameras, result.scene.subject, parts.plan("image"))
        return score(objective, read.features, features, read.missing)
    scene = lifted_scene(result.scene, parts.renderer, parts.extractors) if family == "scene" else result.scene
    plan = parts.plan(family, shared=read.features.names())
    stage = Stage(scene, parts.renderer, plan, objective, cameras.size)
    return score(objective, read.features, read_path(stage, cameras), read.missing)
