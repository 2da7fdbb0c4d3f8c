"""Optical flow against the truth: endpoint error by length, with and without its confidence, and time.

Frames of canonical shots are rendered, and their flow is known from depth and the two cameras. Nothing here was tuned
on these shots: every method runs at its defaults.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import fmean, median
from typing import Any

import torch
from torch import Tensor

from ..config import load_config
from ..config.layers import parse_overrides
from ..drawing import renderer_of
from ..errors import UsageError
from ..extractors.layers import Layers
from ..extractors.scene_flow import SceneFlow
from ..extractors.scene_subject import SceneSubject
from ..features import Features
from ..losses.camera_movement import CameraMovement
from ..pipeline.components import Components
from ..registry import EXTRACTORS
from ..scenes import Scene
from ..scenes.load import load_scene
from ..scenes.person.lifted import lifted_scene
from ..shots import SHOTS, shot
from .driver import drawn
from .pages import SECTIONS
from .section import machine, table, write_section

SCENES = ("builtin:plaza", "builtin:courtyard")
METHODS = (
    "flow_dis={preset: ultrafast}", "flow_dis={preset: fast}", "flow_dis={preset: medium}",
    "flow_deep={}", "flow_deep={height: 360}",
)  # fmt: skip
SIZE = (640, 360)  # [px]
FRAMES, MIDDLE, STEPS = 24, 12, (1, 4)  # of a shot; pairs end at its middle and span so many frames
EDGES = (0.0, 1.0, 4.0, 16.0, float("inf"))  # of the bins of |flow| [px]
TRUSTED = 0.5  # confidence from which a pixel passes the gate
TOLERANCE = 0.005  # of the movement term [frame widths]
HEADER = (
    "method", "pairs", "ms a pair", "ms checked",
    *(f"EPE {low:g}-{high:g} px: all, trusted (kept)" for low, high in pairwise(EDGES)),
    "movement term against exact flow [tolerances], median / mean: plain, weighted",
)  # fmt: skip


@dataclass(frozen=True)
class Pair:
    """Two frames whose flow is known.

    Args:
        now: image, layers and exact ``flow``, one frame.
        before: image.
    """

    now: Features
    before: Features


@dataclass(frozen=True)
class PairScore:
    """One method on one pair.

    Args:
        milliseconds: of the flow, and of the flow with its confidence.
        error: summed endpoint error by bin, (4,) [px], of all pixels, and of the trusted, (2, 4).
        pixels: that were counted, (2, 4).
        movement: the movement term against exact flow, unweighted and weighted [tolerances].
    """

    milliseconds: tuple[float, float]
    error: Tensor  # (2, 4)
    pixels: Tensor  # (2, 4)
    movement: tuple[float, float]


def named_methods(texts: Sequence[str] | None) -> dict[str, Any]:
    """Extractors by the text that names each, as in ``flow_dis={preset: fast}``; ours where there is none.

    Raises:
        UsageError: no such extractor or option, or it provides no flow that is checked.
    """
    methods = {}
    for text in texts or METHODS:
        ((name, options),) = parse_overrides([text]).items()
        methods[text] = EXTRACTORS.build(name, options)
        if "flow_confidence" not in methods[text].provides:
            raise UsageError("", text, "provides no flow that is checked", "name an extractor of flow, check left on")
    return methods


def rendered_pairs(scenes: Sequence[str], seeds: Sequence[int], shots: Sequence[str] = SHOTS) -> Iterator[Pair]:
    """Pairs of frames of every shot in every scene, where a seed draws where the shot stands; twice named counts once.

    Raises:
        InputError: a scene is missing or damaged, or no person is found in it.
    """
    parts = Components.build(load_config())
    for name in scenes:
        scene = lifted_scene(load_scene(name), renderer_of(load_scene(name), parts.renderer), parts.extractors)
        for number in dict.fromkeys(seeds):
            for move in shots:
                yield from _pairs(scene, parts.renderer, move, number)


def _pairs(scene: Scene, renderer: Any, move: str, seed: int) -> Iterator[Pair]:
    cameras = shot(move, scene.person, SIZE, FRAMES, setup=drawn(move, seed)).camera
    indices = [MIDDLE, *(MIDDLE - step for step in STEPS)]
    buffers = frozenset({"image", "depth", "label"})
    frames = renderer_of(scene, renderer).render(scene, cameras[indices], buffers)
    for i in range(1, len(indices)):
        exact = SceneFlow()(Layers()(SceneSubject()(frames[0], None), None), frames[i])
        if bool(exact.require("flow").isfinite().any()):
            yield Pair(exact, Features(frames.size, image=frames[i].image))


def measure(extractor: Any, pair: Pair) -> PairScore:
    """One extractor of flow on one pair."""
    pixels_only = Features(pair.now.size, image=pair.now.image)
    milliseconds, got = [], pixels_only
    for checked in (False, True):
        method = replace(extractor, check=checked)
        start = time.perf_counter()
        got = method(pixels_only, pair.before)
        milliseconds.append(1000 * (time.perf_counter() - start))
    error, count = binned_errors(got.require("flow"), pair.now.require("flow"), got.require("flow_confidence"))
    found = replace(pair.now, flow=got.flow)
    loss = CameraMovement()
    plain, weighted = loss(pair.now, found), loss(pair.now, replace(found, flow_confidence=got.flow_confidence))
    movement = (float(plain) / TOLERANCE, float(weighted) / TOLERANCE)
    return PairScore((milliseconds[0], milliseconds[1]), error, count, movement)


def binned_errors(found: Tensor, exact: Tensor, confidence: Tensor) -> tuple[Tensor, Tensor]:
    """Summed endpoint errors and pixel counts by bin of the exact length, of all pixels and of the trusted.

    Args:
        found: (B, 2, H, W) [px].
        exact: the same; NaN where unknown.
        confidence: (B, H, W) in [0, 1].

    Returns:
        Both (2, 4).
    """
    length, error = exact.norm(dim=1), (found - exact).norm(dim=1)
    known = length.isfinite() & error.isfinite()
    sums, counts = torch.zeros(2, len(EDGES) - 1), torch.zeros(2, len(EDGES) - 1)
    for row, passing in enumerate((known, known & (confidence >= TRUSTED))):
        for column, (low, high) in enumerate(pairwise(EDGES)):
            inside = passing & (length >= low) & (length < high)
            sums[row, column], counts[row, column] = error[inside].sum(), inside.sum()
    return sums, counts


def run_flow(
    methods: Mapping[str, Any], pairs: Iterator[Pair], told: Callable[[int], None] = lambda done: None
) -> dict[str, list[PairScore]]:
    """Every method on every pair, in turn.

    Args:
        methods: extractors with a ``check`` option, by the name they get in the table.
        pairs: from :func:`rendered_pairs`.
        told: called with the number of pairs done.
    """
    scores: dict[str, list[PairScore]] = {name: [] for name in methods}
    for done, pair in enumerate(pairs, start=1):
        for name, extractor in methods.items():
            scores[name].append(measure(extractor, pair))
        told(done)
    return scores


def summary(scores: Mapping[str, Sequence[PairScore]]) -> list[list[str]]:
    """One row a method, under :data:`HEADER`; errors are means over the pixels of all pairs."""
    rows = []
    for name, found in scores.items():
        error = sum((score.error for score in found), torch.zeros(2, len(EDGES) - 1))
        pixels = sum((score.pixels for score in found), torch.zeros(2, len(EDGES) - 1))
        mean = error / pixels
        bins = [
            f"{mean[0, i]:.2f}, {mean[1, i]:.2f} ({100 * pixels[1, i] / pixels[0, i]:.0f} %)"
            for i in range(len(EDGES) - 1)
        ]
        plain, checked = (median(score.milliseconds[i] for score in found) for i in (0, 1))
        moved = ", ".join(_movement([score.movement[i] for score in found]) for i in (0, 1))
        rows.append([name, str(len(found)), f"{plain:.0f}", f"{checked:.0f}", *bins, moved])
    return rows


def _movement(values: Sequence[float]) -> str:
    """Median and mean of the terms that are defined, and how many are not."""
    defined = [value for value in values if math.isfinite(value)]
    if not defined:
        return "undefined"
    lost = f" ({len(values) - len(defined)} undefined)" if len(defined) < len(values) else ""
    return f"{median(defined):.2f} / {fmean(defined):.2f}{lost}"


def write_flow(scores: Mapping[str, Sequence[PairScore]], path: Path, command: str) -> None:
    """Rewrite the section "Optical flow" of the Markdown file ``path``."""
    steps = " and ".join(map(str, STEPS))
    lines = [
        f"Made by `{command}`. Pairs of frames of the canonical shots, {SIZE[0]}x{SIZE[1]}, {steps}",
        "frames apart, on one thread; the exact flow comes from depth and cameras, hidden pixels included. EPE is the",
        f"mean endpoint error [px] by the length of the exact flow; trusted pixels have a confidence of {TRUSTED} and",
        "more. The last column is the camera movement term between exact and found flow on the same layers, 1 being",
        "its tolerance.",
        *machine(),
        "",
        *table(HEADER, summary(scores)),
    ]
    write_section(path, SECTIONS["flow"], lines)
