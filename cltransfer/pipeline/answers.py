"""What losses say of two sides: their values and residuals, refused where they say anything else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from ..errors import ModelError, named
from ..features import Features

ROUNDED = 1e-6  # below 0, that a difference of equal things may come to
APART = 0.01  # of the larger, by which residuals may come to another value: a slope may be rounded off
LITTLE = 1e-3  # of the penalty: what is less tells of no difference
LOOKS = 4  # at a loss, at most: one that costs nothing wherever a search looks tells nothing, and its value takes time


def values(loss: Any, features: tuple[Features, Features], count: int, who: str) -> Tensor:
    """Raw values of a loss, (``count``,) float64 of 0 or more; one that is not finite is undefined.

    Raises:
        ModelError: it fails, or gives anything else.
    """
    found = answer(loss, features, (count,), who)
    least = float(found.nan_to_num(0.0).min()) if count else 0.0
    if least < -ROUNDED:
        raise ModelError("", who, f"expected values of 0 or more, got {least:g}", "0 is where nothing differs")
    return found


def residuals_of(loss: Any, name: str, features: tuple[Features, Features], count: int) -> Tensor:
    """Residuals of a loss, (``count``, R) float64.

    Raises:
        ModelError: it fails, or gives anything else.
    """
    groups = tuple(loss.groups)
    hint = f"one row a frame, in it a residual for each of groups = {groups}"
    return answer(loss.residuals, features, (count, len(groups)), f"residuals of loss {name!r}", hint)


def answer(
    call: Callable[..., Any],
    features: tuple[Features, Features],
    shape: tuple[int, ...],
    who: str,
    hint: str = "return a tensor with one row a frame",
) -> Tensor:
    """What a loss says of ``features``, as float64 of ``shape``; ``hint`` tells how it is said where it is not.

    Raises:
        ModelError: it fails, or says anything else.
    """
    expected = f"expected values of shape {shape}"
    with named(who, expected), torch.no_grad():
        value = call(*features)
    if not isinstance(value, Tensor) or tuple(value.shape) != shape:
        came = f"shape {tuple(value.shape)}" if isinstance(value, Tensor) else type(value).__name__
        raise ModelError("", who, f"{expected}, got {came}", hint)
    return value.double()


def check_sum(loss: Any, name: str, value: Tensor, norms: Tensor) -> bool:
    """Refuse a loss whose residuals are not of its value: what a search finds by them would be worse than it thinks.

    Args:
        loss: with residuals.
        name: of it.
        value: what it says of B views, (B,); one that is not finite tells nothing, if the norms are not either.
        norms: what the norms of the groups of its residuals come to, (B,), without the weight too.

    Returns:
        Whether any view tells.

    Raises:
        ModelError: they are not.
    """
    larger, known = torch.maximum(value, norms), value.isfinite() & norms.isfinite()
    tells = known & (larger > LITTLE * loss.penalty)
    torn = value.isfinite() != norms.isfinite()
    apart = torn | tells & ((value - norms).abs() > APART * larger)
    if bool(apart.any()):
        i = int(apart.nonzero()[0, 0])
        reason = f"its residuals come to {float(norms[i]):.4g}, its value is {float(value[i]):.4g}"
        hint = f"the value is the sum of the norms of groups = {tuple(loss.groups)} of its residuals, all unweighted"
        if bool(torn[i]):
            hint = "a term is NaN in both or in neither"
        raise ModelError("", f"loss {name!r}", reason, hint)
    return bool(tells.any())
