"""A path against the true one. Lengths in subject heights, so scenes of any unit compare."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from kornia.geometry.linalg import inverse_transformation
from kornia.metrics import angle_error_mat
from torch import Tensor

from ..camera import Camera

STANDING = 0.02  # subject heights: a path whose root mean square distance from its start is less has no scale


@dataclass(frozen=True)
class PathErrors:
    """How far N cameras are from the true ones; medians over frames, of the path as it is and of its shape.

    Args:
        position: [subject heights].
        rotation: [degrees].
        log_focal: natural log of the ratio of focal lengths, >= 0.
        path_position: root mean square after the first frames, and then, where neither path stands, the root mean
            square distances from where they stand, were made equal [subject heights]; no rotation is fitted, since the
            centres of a dolly lie on a line and leave one open.
        path_rotation: after the first frames were made equal [degrees].
    """

    position: float
    rotation: float
    log_focal: float
    path_position: float
    path_rotation: float


def path_errors(found: Camera, true: Camera, height: float) -> PathErrors:
    """Errors of N cameras against the true ones; ``height`` is the subject's, scene units."""
    position = (found.center - true.center).norm(dim=1) / height
    rotation = angle_error_mat(found.w2c[:, :3, :3], true.w2c[:, :3, :3])
    focal = torch.log((found.focal / found.size[1]) / (true.focal / true.size[1])).abs()
    aligned = true.c2w[:1] @ inverse_transformation(found.c2w[:1]) @ found.c2w
    moved, wanted = ((c2w[:, :3, 3] - true.center[:1]) / height for c2w in (aligned, true.c2w))
    spread, true_spread = (float(path.pow(2).sum(1).mean().sqrt()) for path in (moved, wanted))
    scale = true_spread / spread if min(spread, true_spread) > STANDING else 1.0
    turned = angle_error_mat(aligned[:, :3, :3].transpose(1, 2), true.w2c[:, :3, :3])
    return PathErrors(
        position=median(position),
        rotation=median(rotation),
        log_focal=median(focal),
        path_position=float((scale * moved - wanted).pow(2).sum(1).mean().sqrt()),
        path_rotation=median(turned),
    )


def median(values: Tensor) -> float:
    """Of N values, of an even number the mean of the two in the middle (``Tensor.median`` takes the lower)."""
    return float(np.median(values.double().numpy()))
