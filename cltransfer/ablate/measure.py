"""Measuring a result by other losses than it was searched with: what a row leaves out is measured too."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..camera import fitted_size, resized
from ..config.options import RunConfig
from ..drawing import renderer_of
from ..driver.stage import Stage, read_path
from ..features import Features
from ..losses.camera_movement import weight_note
from ..pipeline.components import Components
from ..pipeline.objective import Objective
from ..pipeline.plan import Family
from ..pipeline.scores import Scores, score
from ..reading.depth_alignment import align_parts, load_network, needs_scene
from ..reading.frames import render_features
from ..reading.reference import Reading, Reference, as_read, beside, read_reference
from ..run.readback import render_frames
from ..run.result import Result
from ..scenes.person.lifted import lifted_scene
from ..trajectory import jerk as path_jerk

JERK = "jerk"


@dataclass(frozen=True)
class Way:
    """Which way a result errs, in one respect.

    Args:
        mean: signed, over the frames that have one; NaN of none.
        unit: of it.
        defined: how many frames have one.
    """

    mean: float
    unit: str
    defined: int


@dataclass(frozen=True)
class Measured:
    """What a result is worth.

    Args:
        scores: the terms, NaN where undefined.
        priced: the same, with the penalty where only the render lacks a term, (N, L).
        directions: which way it errs, by name; and the jerk of its path.
        note: what is wrong with the weights by which it is measured, empty where nothing.
        lasts: whether another run tells no more of either side.
    """

    scores: Scores
    priced: Tensor  # (N, L)
    directions: Mapping[str, Way]
    note: str = ""
    lasts: bool = True


def measured(result: Result, reference: str, config: RunConfig, metrics: RunConfig) -> Measured:
    """Scores of ``result`` by the losses and extractors of ``metrics``, and at the size that these say.

    As in a transfer, networks read both sides where the reference is a clip and ``extract.verify`` says so. Frames of
    another size are rendered anew for them: those of a smaller result made larger would be blurred, as no row of that
    size is. What a row's own renderer sees is its matter while it searches: reference and result are drawn by that of
    ``metrics``, a result in another geometry by the one of ours that draws it.

    Args:
        result: of a transfer.
        reference: what it was transferred from.
        config: of the transfer.
        metrics: losses, extractors and renderer, ``output_side``, and by ``extract.inner`` whether geometry or networks
            read a scene.

    Raises:
        InputError: the reference cannot be read by these extractors.
        ResourceError: the frames do not fit in memory.
    """
    parts = Components.build(metrics)
    family: Family = "scene" if metrics.extract.inner == "geometric" else "image"
    scene, drawn_by = result.scene, renderer_of(result.scene, parts.renderer)
    if needs_scene(parts, reference, family):
        load_network(parts)
        scene = lifted_scene(scene, drawn_by, parts.extractors)
        aligned, _ = align_parts(replace(parts, renderer=drawn_by), scene)
        parts = replace(aligned, renderer=parts.renderer)
    read = read_reference(reference, parts, Reading(config.frames, metrics.output_side, family))
    parts = as_read(replace(parts, renderer=drawn_by), read)
    cameras, size = result.trajectory.camera, fitted_size(read.features.size, metrics.output_side)
    same = cameras.size == size and parts.renderer == result.renderer
    cameras = cameras if cameras.size == size else resized(cameras, size)
    if read.family == "image" and metrics.extract.verify:
        image = result.image if same else render_frames(scene, parts, cameras)
        plan = parts.plan("image", read.features.names())
        features = render_features(image, cameras, scene.subject, plan, read.times)
        read = beside(features, read, parts)
    else:
        if family == "scene":
            scene = lifted_scene(scene, parts.renderer, parts.extractors)
        plan = parts.plan(family, shared=read.features.names())
        features = read_path(Stage(scene, parts.renderer, plan, parts.objective, cameras.size), cameras)
    found = _judged(parts.objective, read, features, _jerk(result))
    return replace(found, note=weight_note(parts.losses, read.features.size[0]))


def _judged(objective: Objective, read: Reference, features: Features, jerk: float) -> Measured:
    scores = score(objective, read.features, features, read.missing)
    terms = torch.stack([term.values for term in scores.terms], dim=1)
    ways = dict(directions(objective, read.features, features))
    ways[JERK] = Way(jerk, "per frame cubed", len(terms) if math.isfinite(jerk) else 0)  # one number of all frames
    lasts = read.features.lasts and features.lasts
    return Measured(scores, objective.priced(terms, objective.defined(read.features)), ways, lasts=lasts)


def _jerk(result: Result) -> float:
    person = result.scene.subject
    return float("nan") if person is None else path_jerk(result.trajectory.camera, person.height)


def directions(objective: Objective, reference: Features, rendered: Features) -> Iterator[tuple[str, Way]]:
    """Signed means over the frames of what a loss names in ``signs``; with its name where two say so.

    That is its residuals, or its ``directions`` where a residual may be a cost and no direction.
    """
    told = Counter(sign for loss in objective.losses.values() for sign in getattr(loss, "signs", ()))
    told[JERK] += 1
    for name, loss in objective.losses.items():
        signs = getattr(loss, "signs", ())
        if signs and all(reference.has(feature) and rendered.has(feature) for feature in loss.requires):
            columns = getattr(loss, "directions", loss.residuals)(reference, rendered).double().T
            for sign, values in zip(signs, columns):
                own = sign if told[sign] == 1 else f"{sign}, {name}"
                yield own, Way(float(values.nanmean()), loss.unit, int(values.isfinite().sum()))
