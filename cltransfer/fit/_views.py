"""Images with their cameras, in memory, as fitters take them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..errors import InputError, UsageError
from ..renderers import Renderer
from ..scenes import Scene
from ..scenes.posed import PosedImages

POINT_SHARE = 0.005  # of the points left out on either side of an axis: reconstructions have strays
MARGIN = 0.05  # of the box added on every side
FEWEST = 3
PARALLEL = 1e-4  # mean squared sine of the axes about their mean, below which they meet nowhere
FARTHEST = 2000  # times the box's longest side: a million voxels, of which float32 tells a sixteenth
ONE_PLACE = 1e-9  # of the distance to the origin: what rounding leaves between places that are the same


@dataclass(frozen=True)
class Views:
    """N images of a scene and the box in which its matter is.

    Args:
        camera: N cameras at the images' size.
        image: (N, 3, H, W) uint8 RGB.
        aabb: lower and upper corner, (2, 3) float64, scene units.
        counted: pixels that are learnt from and scored on, (N, H, W) bool, one an image at least; None where all are.

    Raises:
        ValueError: the lengths or the sizes differ.
    """

    camera: Camera
    image: Tensor  # (N, 3, H, W)
    aabb: Tensor  # (2, 3)
    counted: Tensor | None = None  # (N, H, W)

    def __post_init__(self) -> None:
        width, height = self.camera.size
        if tuple(self.image.shape) != (len(self.camera), 3, height, width):
            raise ValueError(f"image must be {(len(self.camera), 3, height, width)}, got {tuple(self.image.shape)}")
        if self.counted is not None and self.counted.shape != self.image[:, 0].shape:
            shapes = f"{tuple(self.image[:, 0].shape)}, got {tuple(self.counted.shape)}"
            raise ValueError(f"counted must be {shapes}")

    def __len__(self) -> int:
        return len(self.camera)

    def __getitem__(self, index: Sequence[int]) -> Views:
        counted = None if self.counted is None else self.counted[list(index)]
        return replace(self, camera=self.camera[index], image=self.image[list(index)], counted=counted)

    @property
    def digest(self) -> str:
        """SHA-256 of all that a fit depends on."""
        digest = hashlib.sha256()
        masks = () if self.counted is None else self.counted
        for part in (self.camera.w2c, self.camera.K, *self.image, self.aabb, *masks):  # one by one: all may be large
            digest.update(part.contiguous().numpy())
        return digest.hexdigest()

    def check_near(self, near: float) -> None:
        """Refuse a near plane that hides the middle of the box from most views: the set is in other units.

        Raises:
            UsageError: it does.
        """
        typical = float(self.camera.to_camera(self.aabb.mean(0)[None])[:, 0, 2].median())
        if 0 < typical <= near:
            reason = f"hides what is nearer than {near:g}, the middle of the scene is {typical:.2g} from the cameras"
            raise UsageError("", "near", reason, f"near={0.05 * typical:.1g}")

    def split(self, every: int) -> tuple[Views, Views]:
        """Views to learn from, and every ``every``-th, held out, to score on."""
        held_out = range(0, len(self), every)
        return self[[i for i in range(len(self)) if i % every]], self[held_out]


def views_of(posed: PosedImages, side: int) -> Views:
    """Views of a posed image set, the longer side of its images at most ``side`` [px].

    The box holds nearly all reconstructed points, or, without any, it reaches from where the optical axes come closest
    to each other as far as the farthest camera.

    Raises:
        InputError: fewer than three images are there, one is damaged or masked as a whole, cameras or points are all
            at one place, or a camera is so far from the points that float32 does not tell where its rays meet them.
    """
    if len(posed.present) < FEWEST:
        raise InputError(posed.path, "images", f"expected at least {FEWEST}, got {len(posed.present)}")
    camera, image = posed.images(posed.present, side)
    counted = posed.counted(posed.present, side)
    if counted is not None:
        _check_masks(posed, counted)
    return Views(camera, image, _box(posed, camera), counted)


def _box(posed: PosedImages, camera: Camera) -> Tensor:
    """Corners (2, 3) of the box in which the matter is that ``camera`` sees."""
    if posed.points is None or len(posed.points) == 0:
        _check_spread(posed.path, "cameras", camera.center)
        _check_focus(posed.path, camera)
        return box_around_focus(camera)
    box = box_around(posed.points)
    _check_spread(posed.path, "points", box)
    _check_far(posed, camera.center, box)
    return box


def _check_masks(posed: PosedImages, counted: Tensor) -> None:
    """Refuse an image, of those that are there, none of whose pixels is ``counted`` (N, H, W)."""
    empty = (~counted.flatten(1).any(1)).nonzero()[:, 0].tolist()
    if empty:
        reason = f"{len(empty)} images are masked as a whole, e.g. {posed.names[posed.present[empty[0]]]}"
        raise InputError(posed.path, "masks", reason, "leave them out of the set; black is what does not count")


def left_out(posed: PosedImages) -> list[str]:
    """What a fit to ``posed`` does without, a line each."""
    count = len(posed.missing)
    return [f"{count} of {len(posed)} images are not there, e.g. {posed.missing[0]}"] if count else []


def _check_spread(path: Path, field: str, places: Tensor) -> None:
    """Refuse ``places`` (P, 3) that are all the same: there is no box about them."""
    spread = (places.amax(0) - places.amin(0)).max()
    if not spread > ONE_PLACE * (1 + places.abs().max()):
        raise InputError(path, field, "expected several places, all are at one", "a fit needs views from around")


def _check_far(posed: PosedImages, places: Tensor, box: Tensor) -> None:
    """Refuse a camera at one of ``places`` (P, 3), of the images that are there, beyond ``FARTHEST``."""
    away = (places - box.mean(0)).norm(dim=1) / (box[1] - box[0]).max()
    if away.max() > FARTHEST:
        name = posed.names[posed.present[int(away.argmax())]]
        reason = f"expected within {FARTHEST} sides of the box about the points, {name} is {float(away.max()):.3g} away"
        raise InputError(posed.path, "cameras", reason, "are points and cameras in the same units?")


def _check_focus(path: Path, camera: Camera) -> None:
    """Refuse cameras whose axes come together nowhere before them: nothing says where the scene is."""
    axis = camera.w2c[:, 2, :3]
    across = torch.eye(3).to(axis) - axis[:, :, None] * axis[:, None]
    least = torch.linalg.eigvalsh(across.mean(0))[0]
    focus = box_around_focus(camera).mean(0)
    before = ((focus - camera.center) * axis).sum(1) > 0
    if least < PARALLEL or before.double().mean() < 0.5:
        hint = "give the set its reconstructed points"
        raise InputError(path, "cameras", "look the same way or apart, and there are no points: no box is told", hint)


def box_around(points: Tensor) -> Tensor:
    """Corners (2, 3) of a box about nearly all ``points`` (P, 3)."""
    ends = np.quantile(points.double().numpy(), (POINT_SHARE, 1 - POINT_SHARE), axis=0)
    low, high = torch.from_numpy(ends)
    margin = MARGIN * (high - low).max()
    return torch.stack([low - margin, high + margin])


def box_around_focus(camera: Camera) -> Tensor:
    """Corners (2, 3) of a cube about the point nearest to all optical axes, as far out as the farthest camera."""
    axis, center = camera.w2c[:, 2, :3], camera.center
    across = torch.eye(3).to(axis) - axis[:, :, None] * axis[:, None]  # keeps what is at right angles to the axis
    focus = torch.linalg.pinv(across.sum(0)) @ (across @ center[..., None]).sum(0)[:, 0]
    reach = (center - focus).norm(dim=1).max()
    return torch.stack([focus - reach, focus + reach])


def psnr(geometry: Any, views: Views, renderer: Renderer) -> float:
    """Mean over the views of the PSNR of each [dB], as ``renderer`` draws ``geometry``; an exact view counts 100.

    Pixels that do not count are left out.
    """
    scene = Scene(geometry, None, torch.tensor([0.0, 0.0, 1.0]), "fit", "")
    drawn = renderer.render(scene, views.camera, frozenset({"image"})).require("image")
    squares = (drawn - views.image / 255) ** 2
    error = squares.flatten(1).mean(1) if views.counted is None else mean_over(squares, views.counted)
    return float((-10 * error.clamp(min=1e-10).log10()).mean())


def mean_over(values: Tensor, counted: Tensor) -> Tensor:
    """Mean (...) of values (..., 3, H, W) over the pixels that are ``counted`` (..., H, W)."""
    kept = torch.where(counted, values.mean(-3), 0)
    return kept.sum((-2, -1)) / counted.sum((-2, -1))
