"""Whether a clip zooms, as its flow and depth tell: turning the lens moves all layers alike, travelling does not."""

from __future__ import annotations

import math

from ..feature_shapes import on_grid
from ..features import Features
from ..losses._affine_flow import fit_affine_flow
from ..losses.filmic_space import layer_depths

NEEDED = ("flow", "layers", "depth")
LEAST_AREA = 0.005  # of the frame, that a layer needs


def lens_range(features: Features) -> float:
    """How far the focal length goes along N frames that follow one another, [log], >= 0; NaN where nothing tells.

    A layer at depth Z grows by g = z + t / Z in a frame, by the lens z and by what the camera travels t towards it. Two
    layers, the person and what is behind, tell both: z = (g_b Z_b - g_c Z_c) / (Z_b - Z_c). A rough measure, since what
    is behind is no plane: of drawn clips it was 0.5 to 1.0 where the lens goes by 0.7 to 1.1, dolly zooms among them,
    and where it stands 0 to 0.3, but for some pans and orbits (0.5) and things close before the camera (to 1.6).
    """
    if any(not features.has(name) for name in NEEDED) or len(features) < 2:
        return math.nan
    flow = features.require("flow")
    layers = on_grid(features.require("layers"), flow.shape[-2:])[:, 1:]
    growth = -fit_affine_flow(flow, layers, features.size).coefficients[:, :, 0, 1]  # of x by x, (N, 2)
    person, behind = growth.double().unbind(1)
    near, far = layer_depths(features, LEAST_AREA)[:, 1:].to(person).unbind(1)
    zoom = (behind * far - person * near) / (far - near)
    if not bool(zoom.isfinite().any()):
        return math.nan
    gone = zoom.nan_to_num(0.0, 0.0, 0.0).cumsum(0)
    return float(gone.max() - gone.min().clamp_max(0.0))
