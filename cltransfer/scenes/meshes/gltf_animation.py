"""What an animation of a glTF says of its nodes at one time."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from kornia.geometry.quaternion import Quaternion

from ...errors import InputError
from ...renderers.kernels import Array
from .gltf_file import Gltf

REST: dict[str, tuple[float, ...]] = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}
WEIGHTS = "weights"  # of morph targets


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
        if target.get("path") in (*REST, WEIGHTS) and "node" in target:
            sampler = chosen["samplers"][channel["sampler"]]
            values[target["node"], target["path"]] = _sample(gltf, sampler, time, target["path"])
    return values


def _sample(gltf: Gltf, sampler: dict[str, Any], time: float, path: str) -> Array:
    """Value of one sampler, a copy: held, or between two keys on a line or a great circle."""
    times, values = gltf.array(sampler["input"])[:, 0], gltf.array(sampler["output"])
    if path == WEIGHTS:  # as many numbers for a key as there are targets
        values = values.reshape(len(times), -1)
    kind = sampler.get("interpolation", "LINEAR")
    if kind not in ("LINEAR", "STEP") or len(values) != len(times):
        raise InputError(gltf.path, "animations", f"interpolation {kind} is not read", "bake it to LINEAR or STEP")
    after = int(np.searchsorted(times, time, side="right"))
    if after == 0 or after == len(times) or kind == "STEP":
        return np.asarray(values[max(after - 1, 0)].astype(np.float64))
    share = float((time - times[after - 1]) / (times[after] - times[after - 1]))
    start, end = values[after - 1 : after + 1].astype(np.float64)
    if path != "rotation":
        return np.asarray(start + share * (end - start))
    if start @ end < 0:  # the same rotation by the shorter way
        end = -end
    first, last = (Quaternion(torch.from_numpy(q[[3, 0, 1, 2]] / np.linalg.norm(q))) for q in (start, end))
    return np.asarray(first.slerp(last, share).data.detach().numpy()[[1, 2, 3, 0]])
