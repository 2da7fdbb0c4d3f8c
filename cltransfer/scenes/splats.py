"""3D Gaussians as a value, read-only and in one convention."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from kornia.geometry.conversions import quaternion_to_rotation_matrix
from torch import Tensor

from ..renderers.kernels.splat_pack import Packed, pack

BLOCK = 2**18  # Gaussians whose covariances are made at once
SH_DEGREES = {1: 0, 4: 1, 9: 2, 16: 3}  # coefficients per channel -> degree


@dataclass(frozen=True, eq=False)
class Splats:
    """N anisotropic 3D Gaussians with view-dependent colour (Kerbl et al. 2023).

    Args:
        means: centres in the world, (N, 3), scene units.
        scales: standard deviations along the own axes, (N, 3), scene units, > 0.
        quats: own axes to world, (N, 4) as w, x, y, z, unit.
        opacity: peak opacity in [0, 1], (N,).
        sh: real spherical harmonics of the colour minus 0.5, (N, (d + 1)^2, 3), degree d in 0..3.
        label: membership in the subject, [0, 1], (N,).

    Raises:
        ValueError: a shape is wrong.
    """

    renderer: ClassVar[str] = "gaussian_splats"

    means: Tensor  # (N, 3)
    scales: Tensor  # (N, 3)
    quats: Tensor  # (N, 4)
    opacity: Tensor  # (N,)
    sh: Tensor  # (N, (d + 1)^2, 3)
    label: Tensor  # (N,)

    def __post_init__(self) -> None:
        n = len(self.means)
        for name, shape in (
            ("means", (3,)),
            ("scales", (3,)),
            ("quats", (4,)),
            ("opacity", ()),
            ("label", ()),
        ):
            got = tuple(getattr(self, name).shape)
            if got != (n, *shape):
                raise ValueError(f"{name} must be {(n, *shape)}, got {got}")
        got = tuple(self.sh.shape)
        if len(got) != 3 or got[0] != n or got[1] not in SH_DEGREES or got[2] != 3:
            raise ValueError(f"sh must be ({n}, 1 | 4 | 9 | 16, 3), got {got}")

    def __len__(self) -> int:
        return len(self.means)

    @property
    def degree(self) -> int:
        """Degree of the spherical harmonics, 0..3."""
        return SH_DEGREES[self.sh.shape[1]]

    def covariances(self) -> Tensor:
        """World covariances R diag(scales^2) R^T, (N, 3, 3), squared scene units."""
        parts = []  # in blocks: what is in between takes five times the memory of the result
        for quats, scales in zip(self.quats.split(BLOCK), self.scales.split(BLOCK)):
            half = quaternion_to_rotation_matrix(quats) * scales[:, None, :]
            parts.append(half @ half.transpose(1, 2))
        return torch.cat(parts)

    def with_label(self, label: Tensor) -> Splats:
        """The same Gaussians with another subject membership (N,) in [0, 1]."""
        return replace(self, label=label.to(self.label))

    @cached_property
    def packed(self) -> Packed:
        """Layout of the CPU kernels, made on first use; faint Gaussians (opacity <= 1/255) are left out.

        Raises:
            ValueError: a Gaussian is not finite, which would hide others.
        """
        for name in ("means", "scales", "quats", "opacity", "label", "sh"):
            finite = getattr(self, name).isfinite()
            lost = len(self) - int((finite.flatten(1).all(1) if finite.ndim > 1 else finite).sum())
            if lost:
                raise ValueError(f"{name} must be finite, {lost} of {len(self)} Gaussians are not: leave them out")
        parts = (self.means, self.covariances(), self.scales, self.opacity, self.label, self.sh)
        return pack(*(p.detach().to("cpu", torch.float32).numpy().astype(np.float32, copy=False) for p in parts))
