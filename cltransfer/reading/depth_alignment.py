"""A depth network's scale and shift, read off renders whose depth is known, for the clip that the network reads too."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean, median
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..computer.threads import default_count, set_threads, threads_restored
from ..config.options import RunConfig
from ..drawing import drawn_by, renderer_of
from ..errors import InputError, UsageError
from ..extractors._disparity import Align, aligned, fit_affine
from ..extractors.depth_onnx import DepthOnnx
from ..pipeline.components import Components
from ..pipeline.plan import Family
from ..registry import EXTRACTORS
from ..scenes import Scene
from ..scenes.load import load_scene
from ..scenes.person.lifted import lifted_scene, load_person
from ..shots import Moves, Setup, cameras
from .scene_source import is_scene

SIZE, VIEWS = (640, 360), 8  # of the views [px]; how many
MOVES = tuple(Moves.__annotations__)


@dataclass(frozen=True)
class DepthAlignment:
    """What a network's disparity means in a scene.

    Args:
        align: the policy it is for.
        affine: (a, b) of 1 / depth = a d + b, the median over the views; for ``shift`` of d in the frame's largest,
            with a = 1.
        spread: median distance of a view's b / a from that of the median, in units of the largest disparity: how
            steady the network is. What is not steady here will not be right for a clip either.
        error: mean over the views of the median relative error of the inverse depth, after the view's best scale;
            raw, and with ``affine``.
    """

    align: Align
    affine: tuple[float, float]
    spread: float
    error: tuple[float, float]

    def __str__(self) -> str:
        (a, b), (before, after) = self.affine, self.error
        return (
            f"1 / depth = {a:.4g} d + {b:.4g} in this scene ({self.align}; inverse depth off by {100 * before:.1f} % "
            f"before, {100 * after:.1f} % after; the shift varies by {100 * self.spread:.1f} % between views)"
        )


def align_depth(disparity: Tensor, depth: Tensor, align: Align) -> DepthAlignment:
    """Scale and shift of a network, from what it says of V rendered views.

    Args:
        disparity: of the network, (V, H, W).
        depth: of the renderer, (V, H, W), > 0; NaN where nothing is seen.
        align: shift, or metric where the network scales all frames alike.

    Raises:
        InputError: no view has depths that differ.
        ValueError: ``align`` is raw, which needs none.
    """
    if align == "raw":
        raise ValueError("align must be shift or metric, got 'raw', which needs no alignment")
    counted = aligned(disparity, align, (1.0, 0.0))
    fits = [fit_affine(view.flatten(), seen.flatten()) for view, seen in zip(counted, depth)]
    usable = [(a, b) for a, b in fits if a > 0]  # a wall that fills the view says nothing: NaN
    if not usable:
        raise InputError("", "depth", f"none of {len(depth)} views has disparity that falls with depth")
    ratio = median(b / a for a, b in usable)
    largest = [m for m, (a, _) in zip(disparity.abs().amax(dim=(1, 2)).tolist(), fits) if a > 0]  # none of them is 0
    unit = 1.0 if align == "shift" else median(largest)
    spread = median(abs(b / a - ratio) for a, b in usable) / unit
    scale = 1.0 if align == "shift" else median(a for a, _ in usable)
    found = (scale, scale * ratio)
    error = (_error(disparity, depth), _error(aligned(disparity, align, found), depth))
    return DepthAlignment(align, found, spread, error)


def _error(inverse: Tensor, depth: Tensor) -> float:
    """Mean over the views of the median relative error of inverse depth (V, H, W), each view's best scale taken out.

    A view without a scale, whose median ratio is 0 or none, is left out; NaN where all are.
    """
    off = []
    for view, seen in zip(inverse, depth):
        ratio = (view * seen)[seen.isfinite()]
        scale = float(ratio.median()) if len(ratio) else math.nan
        if math.isfinite(scale) and scale != 0:
            off.append(float((ratio / scale - 1).abs().median()))
    return fmean(off) if off else math.nan


def align_to_scene(
    extractor: DepthOnnx, scene: Scene, renderer: Any, views: Camera, align: Align
) -> tuple[DepthOnnx, DepthAlignment]:
    """``extractor`` with the affine that its network has in ``scene``, and how well that was told.

    A clip that is read with it is treated as the renders are: by the same policy with the same numbers.

    Args:
        extractor: of kind disparity.
        scene: to render.
        renderer: draws it.
        views: of its subject, V.
        align: shift, or metric.

    Raises:
        ModelError: the network is missing or refused.
        InputError: the views do not tell.
    """
    disparity, depth = [], []
    for i in range(len(views)):
        seen = drawn_by(renderer, scene, views[i], frozenset({"image", "depth"}))
        disparity.append(extractor.output_maps(seen.require("image")))
        depth.append(seen.require("depth"))
    found = align_depth(torch.cat(disparity), torch.cat(depth), align)
    return replace(extractor, align=align, affine=found.affine), found


@threads_restored()
def align_config(
    scene: str,
    config: RunConfig,
    views: int,
    up: tuple[float, float, float] | None = None,
    subject: Path | None = None,
) -> DepthAlignment:
    """What the depth network of ``config`` means in a scene, looked at from ``views`` places around its subject.

    Args:
        scene: a scene file, or ``builtin:NAME``.
        config: with a ``depth_onnx``. Meanwhile the threads of the whole process are as it says.
        views: how many.
        up: the scene's; None takes the format's usual one, or its own.
        subject: a subject.json; None lifts the scene, or takes the lift from the cache.

    Raises:
        UsageError: the config has no ``depth_onnx``, or its policy is raw.
        InputError: the scene is missing or damaged, or no person is found in it.
        ModelError: the network is missing or refused.
    """
    set_threads(config.threads or default_count())
    parts = Components.build(config)
    name = depth_network(parts.extractors)
    if not name or parts.extractors[name].align == "raw":
        got = "align raw" if name else "no depth_onnx"
        raise UsageError("", f"extractors.{name or 'depth_onnx'}", f"expected align shift or metric, got {got}")
    loaded = load_scene(scene, up)
    load_network(parts)
    if subject is not None:
        loaded = load_person(loaded, subject)
    lifted = lifted_scene(loaded, renderer_of(loaded, parts.renderer), parts.extractors)
    return align_parts(parts, lifted, views)[1]


def load_network(parts: Components) -> None:
    """Load the ``depth_onnx`` of ``parts`` now, so that a missing one is told before a scene is lifted for it.

    Raises:
        ModelError: the network is missing or refused.
    """
    _ = parts.extractors[depth_network(parts.extractors)].network.session


def depth_network(extractors: Iterable[str]) -> str:
    """Which of the extractors in use is ``depth_onnx`` or a class of it; empty where none is. Two would not be run."""
    known = EXTRACTORS.registered()
    return next((name for name in extractors if issubclass(known.get(name, object), DepthOnnx)), "")


def align_parts(parts: Components, scene: Scene, views: int = VIEWS) -> tuple[Components, DepthAlignment]:
    """``parts`` with the affine that their ``depth_onnx`` has in a lifted scene.

    Args:
        parts: with a ``depth_onnx`` whose policy is shift or metric.
        scene: with its person.
        views: looked at, all around the person.

    Raises:
        InputError: the views do not tell.
        ModelError: the network is missing or refused.
    """
    setup = Setup(azimuth=0.0, distance=3.0, coverage=0.5)
    around = {name: torch.ones(views, dtype=torch.float64) * (name in ("dolly", "follow", "zoom")) for name in MOVES}
    around["azimuth"] = torch.arange(views, dtype=torch.float64) * (2 * math.pi / views)
    ring = cameras(scene.person, SIZE, setup, Moves(**around))
    name = depth_network(parts.extractors)
    network = parts.extractors[name]
    extractor, found = align_to_scene(network, scene, renderer_of(scene, parts.renderer), ring, network.align)
    return replace(parts, extractors={**parts.extractors, name: extractor}), found


def needs_scene(parts: Components, reference: str, family: Family) -> bool:
    """Whether the shift of ``parts``' depth network is to be read off the scene.

    It is where the network reads anything: a ``reference`` that is a clip, or scenes read by extractors of the image
    ``family``.
    """
    network = parts.extractors.get(depth_network(parts.extractors))
    return network is not None and network.unaligned and (family == "image" or not is_scene(reference))
