"""Across a jump of a loss: what a frame would cost beyond it, and how far it is from there.

A loss that jumps has no slope that leads across, but it may know what is beyond: the depth of a layer is the highest
peak of a density, and the peak that is wanted is there before it is the highest. So while a path is refined such a
residual is replaced by what it is beyond the jump, and by a toll that falls with the way that is left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..pipeline.objective import Across
from .spline import Local

NEAR = 0.5  # how far a jump is away at most
GAIN = 0.2  # total that a frame has to save beyond it
MARGIN = 0.1  # how far beyond it a frame is led: what ends at its edge falls back
COMES = 0.5  # of the way that has to be left at most after a step, by the linear model, where a frame is led at all
WORTH = 0.1  # total that all that are led have to save in the mean over the clip


@dataclass(frozen=True)
class Jumps:
    """Jumps that frames of a path are led across, of C of the residuals.

    Args:
        columns: which residuals, (C,).
        led: which frames, (N, C) bool.
        gain: what each costs less beyond, (N, C).
        far: how far each is from there, (N, C).
    """

    columns: Tensor  # (C,)
    led: Tensor  # (N, C)
    gain: Tensor  # (N, C)
    far: Tensor  # (N, C)

    @property
    def worth(self) -> float:
        """Total that is saved beyond, in the mean over the frames."""
        return float((self.gain * self.led).sum(1).mean())

    def values(self, across: Across) -> Tensor:
        """All that is measured, (N, R + 2 C): the residuals, what those of the columns are beyond, and how far."""
        return torch.cat([across.residuals, across.beyond[:, self.columns], across.far[:, self.columns]], dim=1)

    def local(self, measured: Local) -> Local:
        """What leads: of what was ``measured`` of :meth:`values`, those that are led replaced, and C tolls (N, R + C).

        A toll is what its residual gains, by the part of the way that is left.
        """
        led, per = self.led, torch.where(self.led, self.gain / (self.far + MARGIN), 0.0)

        def lead(values: Tensor, margin: float) -> Tensor:  # (..., N, R + 2 C)
            own, beyond, far = self._split(values)
            own[..., self.columns] = torch.where(led, beyond, own[..., self.columns])
            return torch.cat([own, per * (far + margin)], dim=-1)

        residuals = lead(measured.residuals, MARGIN)
        residuals[:, -len(self.columns) :].clamp_(min=0.0)
        groups = torch.cat([measured.groups, measured.groups.max() + 1 + torch.arange(len(self.columns))])
        jacobian = lead(measured.jacobian.movedim(-1, 0), 0.0).movedim(0, -1)
        return Local(residuals, jacobian, groups, measured.paired[: residuals.shape[1]])

    def _split(self, values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        C = len(self.columns)
        own, beyond, far = values.split([values.shape[-1] - 2 * C, C, C], dim=-1)
        return own.clone(), beyond, far

    def own(self, measured: Local) -> Local:
        """Of what was ``measured`` the residuals as they are."""
        R = len(measured.groups)
        return Local(measured.residuals[:, :R], measured.jacobian[:, :R], measured.groups, measured.paired[:R])

    def crossed(self, measured: Local, move: Tensor) -> Jumps:
        """Those that a ``move`` (N, D) brings near, by the linear model; the others are not led."""
        _, _, slopes = self._split(measured.jacobian.movedim(-1, 0))
        far = self.far + (slopes.movedim(0, -1) * move[:, None]).sum(-1)
        return replace(self, led=self.led & (far < COMES * self.far))

    def nearer(self, measured: Local) -> Jumps:
        """From what was ``measured`` nearer to them: what is left of the way is dearer, the less it is."""
        own, beyond, far = self._split(measured.residuals)
        came = self.led & (far > 0) & (far < self.far)
        gain = (own[:, self.columns].abs() - beyond.abs()).clamp_min(0.0)
        return replace(self, gain=torch.where(came, gain, self.gain), far=torch.where(came, far, self.far))


def jumps_of(across: Across, tried: Tensor) -> Jumps | None:
    """Jumps that are near and worth it, but those that were ``tried``, (N, R) bool; None where there are none."""
    gain = across.residuals.abs() - across.beyond.abs()
    led = ~tried & (across.far > 0) & (across.far < NEAR) & (gain > GAIN)
    columns = led.any(0).nonzero()[:, 0]
    jumps = Jumps(columns, led[:, columns], gain[:, columns], across.far[:, columns])
    return jumps if jumps.worth >= WORTH else None
