"""Coloured spheres in an .npz file: a whole representation, its file and its renderer, outside this project."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from cltransfer import RENDERERS, Camera, Features, Scene
from cltransfer.errors import InputError, UsageError
from cltransfer.storage.files import check_size

LIMIT = 2**20  # bytes of a file, and of what is packed in it: about 35,000 spheres
PACKED = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}  # numpy's; others unpack to more than the size they state
AT_ONCE = 2**22  # rays times spheres that are drawn at once: 100 MB
COLUMNS: dict[str, tuple[tuple[int, ...], str, Callable[[Tensor], Tensor]]] = {  # what a row of each is
    "centers": ((3,), "finite numbers", torch.isfinite),
    "radii": ((), "finite numbers above 0", lambda values: (values > 0) & values.isfinite()),
    "colors": ((3,), "numbers in [0, 1]", lambda values: (values >= 0) & (values <= 1)),
    "label": ((), "numbers in [0, 1]", lambda values: (values >= 0) & (values <= 1)),
}


@dataclass(frozen=True, eq=False)
class Ball:
    """N spheres; see cltransfer/scenes/geometry.py for what a geometry has.

    Args:
        centers: in the world, (N, 3), scene units.
        radii: (N,), scene units, > 0.
        colors: RGB in [0, 1], (N, 3).
        label: membership in the subject, [0, 1], (N,).
    """

    renderer: ClassVar[str] = "spheres"

    centers: Tensor  # (N, 3)
    radii: Tensor  # (N,)
    colors: Tensor  # (N, 3)
    label: Tensor  # (N,)

    def __len__(self) -> int:
        return len(self.radii)

    @property
    def means(self) -> Tensor:
        """Where the spheres are, (N, 3)."""
        return self.centers

    def with_label(self, label: Tensor) -> Ball:
        """The same spheres, of which others are the person's."""
        return replace(self, label=label.to(self.label))


@RENDERERS.register("spheres")
@dataclass(frozen=True)
class Spheres:
    """Draws the spheres of an .npz over black, lit from the camera.

    Args:
        near: nothing nearer is drawn, scene units, > 0.
    """

    near: float = 0.05

    provides: ClassVar[frozenset[str]] = frozenset({"image", "alpha", "label", "depth"})
    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def __post_init__(self) -> None:
        if not self.near > 0:
            raise ValueError(f"near must be positive, got {self.near}")

    @staticmethod
    def read(path: Path) -> Ball:
        """The spheres of a file, which may be a stranger's: no pickle, and sizes before memory."""
        check_size(path, LIMIT)
        try:
            with zipfile.ZipFile(path) as packed:
                members = packed.infolist()
            if sum(member.file_size for member in members) > LIMIT or {m.compress_type for m in members} - PACKED:
                raise ValueError(f"at most {LIMIT} bytes unpacked, of np.savez or np.savez_compressed")
            with np.load(path, allow_pickle=False) as arrays:
                columns = {name: torch.from_numpy(arrays[name].astype(np.float32)) for name in COLUMNS}
        except Exception as error:  # zipfile, zlib and numpy raise ten kinds, and MemoryError of a shape that lies
            raise InputError(path, "", f"expected an .npz of {', '.join(COLUMNS)}: {error}") from None
        count = max(1, columns["radii"].numel())
        for name, (row, wanted, right) in COLUMNS.items():
            shape, got = (count, *row), tuple(columns[name].shape)
            if got != shape:
                raise InputError(path, name, f"expected {shape}, got {got}")
            if not bool(right(columns[name]).all()):
                raise InputError(path, name, f"expected {wanted}")
        return Ball(**columns)

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """What B cameras see; depth is along the optical axis, NaN where there is nothing."""
        if not isinstance(scene.geometry, Ball):
            kind = type(scene.geometry).__name__
            raise UsageError(scene.name, "renderer spheres", f"expected spheres, got {kind}", "name an .npz")
        frames = [self._frame(scene.geometry, cameras[i]) for i in range(len(cameras))]  # 10 ms each at 160x90
        drawn: dict[str, Any] = {name: torch.stack([frame[name] for frame in frames]) for name in buffers}
        return Features(cameras.size, **drawn, camera=cameras, person=scene.subject)

    def _frame(self, ball: Ball, camera: Camera) -> dict[str, Tensor]:
        """Each pixel's nearest sphere, lit."""
        width, height = camera.size
        x, y = torch.meshgrid(torch.arange(width) + 0.5, torch.arange(height) + 0.5, indexing="xy")
        pixels = torch.stack([x, y, torch.ones_like(x)], -1).double().reshape(-1, 3)
        rays = (pixels @ camera.K[0].inverse().T @ camera.w2c[0, :3, :3]).float()  # t is the depth: 1 along the axis
        away = camera.center[0].float() - ball.centers  # (N, 3)
        depth, which = torch.empty(len(rays)), torch.empty(len(rays), dtype=torch.long)
        step = max(1, AT_ONCE // len(ball))
        for i in range(0, len(rays), step):
            depth[i : i + step], which[i : i + step] = self._met(ball, away, rays[i : i + step])
        seen = depth.isfinite()
        outward = (depth.nan_to_num(posinf=0)[:, None] * rays + away[which]) / ball.radii[which, None]
        light = -(outward * torch.nn.functional.normalize(rays, dim=1)).sum(1, keepdim=True).clamp(-1, 0)
        image = ball.colors[which] * (0.3 + 0.7 * light) * seen[:, None]
        return {
            "image": image.T.reshape(3, height, width),
            "alpha": seen.float().reshape(height, width),
            "label": (ball.label[which] * seen).reshape(height, width),
            "depth": depth.masked_fill(~seen, torch.nan).reshape(height, width),
        }

    def _met(self, ball: Ball, away: Tensor, rays: Tensor) -> tuple[Tensor, Tensor]:
        """How far along R rays their nearest sphere is, and which: the first root of |away + t ray|^2 = radius^2."""
        a, b, c = (rays**2).sum(1, keepdim=True), rays @ away.T, (away**2).sum(1) - ball.radii**2
        first = (-b - (b**2 - a * c).sqrt()) / a  # (R, N); NaN past the sphere
        distance, which = torch.where(first > self.near, first, torch.inf).min(1)
        return distance, which
