"""Options of the gradient baseline, ``engine: adam``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..errors import UsageError


@dataclass
class AdamConfig:
    """How Adam descends. A gradient is taken by central differences, 2D + 1 evaluations a step.

    Args:
        iterations: per frame after the first; the first has half of them.
        rate: learning rate, in the units of x; it decays to 0.8 of itself along the frame.
        strokes: both moves pose by all losses, then the lens by the losses of the flow alone (JAWS); one moves all.
        weighting: fixed takes the losses' own weights; gradnorm balances their gradients while the pose moves.
        quirks: as the published code of JAWS has it: both strokes at one rate from the second iteration on, the totals
            of both strokes compete for the frame's best, each by gradnorm's weights, and gradnorm balances a loss that
            starts at 0, which silences the others once it leaves 0; otherwise pose at 1.2 and lens at 0.5 of the rate,
            whole totals compete, and such a loss is left out of the balance.
        difference: step of the differences, in the units of x.
    """

    iterations: int = 40
    rate: float = 0.025
    strokes: Literal["one", "two"] = "one"
    weighting: Literal["fixed", "gradnorm"] = "fixed"
    quirks: bool = False
    difference: float = 0.002

    def __post_init__(self) -> None:
        for name, low, high in (("iterations", 1, 10**5), ("rate", 1e-6, 10.0), ("difference", 1e-6, 1.0)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise UsageError("", f"adam.{name}", f"expected {low} to {high}, got {value}")
