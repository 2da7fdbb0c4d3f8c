"""Whether a person lies where a scene has it: a lift does not follow a scene that is scaled, turned or moved."""

from __future__ import annotations

import logging
from pathlib import Path

import torch
from torch import Tensor

from ...errors import InputError
from .. import Scene
from .vote import REACH, bone_distance

ENOUGH = 10**5  # primitives that are looked at
PART = 0.25  # share of the known joints that may lie far from all primitives: not every hand and foot is voted for
HINT = "if the scene was scaled, turned or moved since, lift it again"

_log = logging.getLogger("cltransfer")


def check_fits(where: Path, scene: Scene) -> None:
    """Hold the person of ``scene``, which ``where`` tells of, against the primitives that are marked.

    Where more than a quarter of the joints have none near them, as in a scene made smaller, a warning says so.

    Raises:
        InputError: half of the primitives lie farther from the bones than a lift marks any.
    """
    person = scene.person
    marked, wide = _marked(scene)
    if not len(marked):
        return
    reach = REACH + wide / person.height
    near = f"within {reach:.2g} heights"
    apart = float(bone_distance(marked, person).median()) / person.height
    if apart > reach:
        reason = f"expected the primitives that are labelled {near} of the bones, got {apart:.2g} for half of them"
        raise InputError(where, "joints", reason, HINT)
    joints = person.joints[person.confidence > 0]
    alone = int((torch.cdist(joints, marked).amin(1) > reach * person.height).sum())
    if alone > PART * len(joints):
        told = f"expected primitives that are labelled {near} of each joint, {alone} of {len(joints)} have none"
        _log.warning("%s: joints: %s; %s", where, told, HINT)


def _marked(scene: Scene) -> tuple[Tensor, float]:
    """Places (M, 3) of primitives of the person, evenly taken, and how far from its surface one may lie by itself."""
    from ..nerf_grid import NerfGrid

    geometry, label, wide = scene.geometry, scene.geometry.label, 0.0
    if isinstance(geometry, NerfGrid):  # which has a label at all vertices, and places of those that hold anything
        label, wide = label[tuple(geometry.filled.T)], float(geometry.voxel.max())
    index = (label > 0.5).nonzero()[:, 0]
    return geometry.means[index[:: max(1, len(index) // ENOUGH)]].double(), wide
