"""What an animation of a glTF says of its nodes at one time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from kornia.geometry.quaternion import Quaternion

from ...computer.array_type import Array
from ...errors import InputError
from .gltf_file import Gltf
from .gltf_tree import WIDTH

REST: dict[str, tuple[float, ...]] = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}
WEIGHTS = "weights"  # of morph targets
WIDE = {path: len(value) for path, value in REST.items()}  # numbers of a value
CUBIC = "CUBICSPLINE"
PARTS = {"LINEAR": 1, "STEP": 1, CUBIC: 3}  # values that a key has


def channels(gltf: Gltf, time: float, name: str | None) -> dict[tuple[int, str], Array]:
    """Animated values by node and property at ``time`` [s]; of the first animation if none is named.

    Times before the start and after the end hold the first and last values.

    Raises:
        InputError: there is no such animation, or none at all and the time is not 0; an array is damaged.
    """
    animations = gltf.tree.get("animations", [])
    if name is None and not animations:
        if time != 0:
            raise InputError(gltf.path, "animation", f"holds none to be looked at after {time:g} s")
        return {}
    names = [str(a.get("name", i)) for i, a in enumerate(animations)]
    if name is not None and name not in names:
        raise InputError(gltf.path, "animation", f"no animation {name!r}", f"known: {', '.join(names) or 'none'}")
    chosen = animations[0 if name is None else names.index(name)]
    values = {}
    for channel in chosen["channels"]:
        target = channel["target"]
        if (wide := _wide(gltf, target)) is not None:
            sampler = chosen["samplers"][channel["sampler"]]
            values[target["node"], target["path"]] = _sample(gltf, sampler, time, target["path"], wide)
    return values


def _wide(gltf: Gltf, target: dict[str, Any]) -> int | None:
    """Numbers of one value of what a channel moves, of weights as many as there are targets; None: it moves nothing."""
    path = target.get("path")
    if path != WEIGHTS or "node" not in target:
        return WIDE.get(str(path)) if "node" in target else None
    node = gltf.entry("nodes", target["node"])
    if "mesh" not in node:
        return None
    return len(gltf.entry("meshes", node["mesh"])["primitives"][0].get("targets", ())) or None


def _sample(gltf: Gltf, sampler: dict[str, Any], time: float, path: str, wide: int) -> Array:
    """Value of one sampler, a copy: held, or between two keys on a line, a great circle or a cubic."""
    times, stored = gltf.array(sampler["input"])[:, 0], gltf.entry("accessors", sampler["output"])
    kind = sampler.get("interpolation", "LINEAR")
    if kind not in PARTS:
        raise InputError(
            gltf.path, "animations", f"interpolation {kind!r:.40} is not read", f"known: {', '.join(PARTS)}"
        )
    shape, got = (len(times) * PARTS[kind], wide), (stored["count"], WIDTH.get(stored.get("type", ""), 0))
    fits = math.prod(got) == math.prod(shape) if path == WEIGHTS else got == shape  # weights stand one in a row
    if not fits:
        rows = f"expected {shape[0]} rows of {wide} for its {len(times)} keys, got {got}"
        raise InputError(gltf.path, "animations", f"{path}: {rows}")  # before it is read: a sparse one may be any size
    keys = gltf.array(sampler["output"]).reshape(len(times), PARTS[kind], wide)
    after = int(np.searchsorted(times, time, side="right"))
    if after == 0 or after == len(times) or kind == "STEP":
        return np.asarray(keys[max(after - 1, 0), PARTS[kind] // 2].astype(np.float64))
    begin, end = times[after - 1 : after + 1].astype(np.float64)
    two = keys[after - 1 : after + 1].astype(np.float64)
    if kind == CUBIC:
        return _on_cubic((begin, end), two, time, unit=path == "rotation")
    first, last, share = two[0, 0], two[1, 0], float((time - begin) / (end - begin))
    return _on_circle(first, last, share) if path == "rotation" else np.asarray(first + share * (last - first))


def _on_circle(first: Array, last: Array, share: float) -> Array:
    """The rotation (4,) a ``share`` of the shorter way from the ``first`` to the ``last``."""
    last = -last if first @ last < 0 else last
    ends = (Quaternion(torch.from_numpy(q[[3, 0, 1, 2]] / np.linalg.norm(q))) for q in (first, last))
    return np.asarray(next(ends).slerp(next(ends), share).data.detach().numpy()[[1, 2, 3, 0]])


def _on_cubic(span: tuple[float, float], two: Array, time: float, unit: bool) -> Array:
    """Value (W,) within ``span`` [s] of two keys (2, 3, W): slope on arrival, value, slope on leaving, a second."""
    from scipy.interpolate import CubicHermiteSpline

    value = CubicHermiteSpline(span, two[:, 1], np.stack([two[0, 2], two[1, 0]]))(time)
    return np.asarray(value / np.linalg.norm(value) if unit else value)
