"""What values features may have: those of another unit would be compared as if they were of ours."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from torch import Tensor

if TYPE_CHECKING:
    from .features import Features

BESIDE = 1e-3  # that rounding may leave values beside their range
PEAK, DIP = 2.0, -0.05  # of a confidence: peaks of heatmaps go beyond [0, 1], and percentages and logits further
CROWDED = 8  # px of a frame's longer side, from which on nobody stands in one pixel throughout
FAR = 8  # frames that no tracker guesses a joint beyond, and px of a corner that nobody stands in throughout
TURN = 2 * math.pi + BESIDE
TURNS = 4 * TURN  # that no camera goes about the person in one clip


def odd_values(features: Features, names: Iterable[str]) -> tuple[str, str, str] | None:
    """What of ``names`` has values that the feature cannot have, what they are, and what to do; None where nothing has.

    NaN is undefined, and so is a depth of 0: whoever reads one leaves it out. A confidence counts as it is up to 2.
    """
    for name in sorted(names):
        rule = _RULES.get(name)
        if rule is not None and features.has(name) and (told := rule(name, features.require(name), features.size)):
            return name, *told
    return None


def same_values(one: Tensor, other: Tensor) -> bool:
    """Whether both are of one shape and have the same values, NaN where both are."""
    return one.shape == other.shape and bool(((one == other) | ((one != one) & (other != other))).all())


_Told = tuple[str, str] | None  # what was expected and what came, and what to do


def _keypoints(name: str, value: Tensor, size: tuple[int, int]) -> _Told:
    return _crowded(value[..., :2], size) or _share("confidence", value[..., 2], size)


def _box(name: str, value: Tensor, size: tuple[int, int]) -> _Told:
    return _crowded(value[..., :4], size)


def _crowded(places: Tensor, size: tuple[int, int]) -> _Told:
    """Places [px] of which half lie in the first pixel, and none far from it, are parts of the frame.

    Half, since trackers guess joints that the frame cuts off: of a close-up the knees are at 3 of it.
    """
    low, high = _ends(places)
    if max(size) <= CROWDED or low == high or high <= 0:  # 0 and -1 are written of what was not found
        return None
    if max(-low, high) > FAR or float(places[places.isfinite()].abs().median()) > 1:
        return None
    reason = f"expected pixels of a frame of {size[0]} x {size[1]}, got {low:.3g} to {high:.3g} throughout"
    return reason, "multiply x by the width and y by the height"


def _share(name: str, value: Tensor, size: tuple[int, int]) -> _Told:
    low, high = _ends(value)
    if low >= DIP and high <= PEAK:
        return None
    what = "" if name == "flow_confidence" else f"{name} "
    return f"expected {what}in [0, 1], got {low:.3g} to {high:.3g}", "clip to [0, 1], or divide percentages by 100"


def _angles(name: str, value: Tensor, size: tuple[int, int]) -> _Told:
    """An orbit of more than a turn has a yaw beyond one, but not throughout; pitch and roll stay within it."""
    least, yaw = _ends(value[..., :1].abs())
    other = _ends(value[..., 1:].abs())[1]
    if least <= TURN and yaw <= TURNS and other <= TURN:
        return None
    told = f"a yaw of {yaw:.4g}" if least > TURN or yaw > TURNS else f"a pitch or roll of {other:.4g}"
    return f"expected radians, got {told}", "wrap it, or torch.deg2rad if these are degrees"


def _depth(name: str, value: Tensor, size: tuple[int, int]) -> _Told:
    least = _ends(value)[0]
    return (f"expected depths above 0, got {least:.3g}", "NaN where none is known") if least < 0 else None


def _ends(value: Tensor) -> tuple[float, float]:
    """Least and greatest of what is known; 0 and 0 where nothing is."""
    least, most = math.inf, -math.inf
    for frame in value if value.numel() else ():  # one by one: maps of a clip take as much again together
        least = min(least, float(frame.nan_to_num(math.inf, math.inf, -math.inf).amin()))
        most = max(most, float(frame.nan_to_num(-math.inf, math.inf, -math.inf).amax()))
    return (least, most) if least <= most else (0.0, 0.0)


_RULES = {
    "keypoints": _keypoints,
    "box": _box,
    "flow_confidence": _share,
    "orientation": _angles,
    "depth": _depth,
    "expected_depth": _depth,
}
