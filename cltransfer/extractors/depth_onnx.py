"""Depth by any monocular network that was exported to ONNX: Depth Anything V1 and V2, MiDaS, DPT."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import cv2
import numpy as np
import torch
from torch import Tensor

from ..errors import ModelError, UsageError
from ..features import Features
from ..models.onnx import Network
from ..models.places import find_model
from ..registry import EXTRACTORS
from ._disparity import Align, depth_from_disparity
from ._pixels import IMAGENET_MEAN, IMAGENET_STD, MOST, normalised, require_input, resized, to_uint8

__all__ = ["DepthOnnx", "depth_from_disparity"]


@EXTRACTORS.register("depth_onnx")
@dataclass(frozen=True)
class DepthOnnx:
    """Depth of each pixel as the network sees it; its scale, and for disparity its shift, are unknown.

    Args:
        model: ONNX file, RGB (1 or B, 3, height, width) -> (1 or B, [1,] h, w).
        kind: what it puts out. Disparity (nearer is larger; Depth Anything's relative models) is inverted, see
            :func:`depth_from_disparity`; of depth (its metric models) what is not positive is NaN.
        width: of the network's input [px]; the image is stretched to it.
        height: likewise.
        multiple: 0 for a network of this one size. Otherwise the image keeps its aspect: width and height are the
            least, and both sides are multiples of this (14 for Depth Anything, 32 for MiDaS), as the authors do.
        mean: of each channel, in [0, 1], subtracted.
        std: of each channel, divides then.
        input: name of the input.
        output: name of the output.
        floor: disparity over the largest, in (0, 1), down to which nothing is told: the sky has no depth,
            with a shift or without.
        align: what is done about a disparity's unknown shift, which changes the depth ratio of two layers. ``raw``
            takes it for none; ``shift`` and ``metric`` take 1 / depth = a d + b, ``shift`` with d in the frame's
            largest, for a network that scales each frame by itself.
        affine: a and b, for shift and metric alone; null has a transfer read them off its own scene.
    """

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("depth",)
    family: ClassVar[Literal["image", "scene", "both"]] = "image"
    passes: ClassVar[int] = 1
    model: str
    kind: Literal["disparity", "depth"]
    width: int = 518
    height: int = 518
    multiple: int = 0
    mean: tuple[float, float, float] = IMAGENET_MEAN
    std: tuple[float, float, float] = IMAGENET_STD
    input: str = "pixel_values"
    output: str = "predicted_depth"
    floor: float = 1e-3
    align: Align = "raw"
    affine: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("disparity", "depth"):
            raise ValueError(f"kind must be disparity or depth, got {self.kind!r}")
        if self.align not in ("raw", "shift", "metric") or (self.align != "raw" and self.kind != "disparity"):
            raise ValueError(f"align must be raw, or shift or metric of a disparity, got {self.align!r} of {self.kind}")
        if self.affine is not None and self.align == "raw":
            hint = "set the align that it was read for, which `cltransfer models align` prints beside it"
            hint = hint if self.kind == "disparity" else "what is depth has no shift"
            raise ValueError(f"affine is for align shift or metric of a disparity, got raw of {self.kind}: {hint}")
        if self.affine is not None and not self.affine[0] > 0:
            raise ValueError(f"affine must rise with the disparity, got {self.affine}")
        if not 0 <= self.multiple <= MOST:
            raise ValueError(f"multiple must be 0 to {MOST}, got {self.multiple}")
        if not 0 <= min(self.mean) <= max(self.mean) <= 1:
            raise ValueError(f"mean is of pixels in [0, 1], got {self.mean}: divide it and std by 255")
        if not 1 <= min(self.width, self.height) <= max(self.width, self.height) <= MOST:
            raise ValueError(f"width and height must be 1 to {MOST}, got {self.width} and {self.height}")
        if min(self.std) <= 0 or not 0 < self.floor < 1:
            raise ValueError("std must be positive and floor in (0, 1)")

    @cached_property
    def network(self) -> Network:
        """The depth network."""
        shape = (None, 3, None, None) if self.multiple else (None, 3, self.height, self.width)
        return Network(find_model(self.model), {self.input: shape}, {self.output: None})

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        """``now`` with ``depth``, on the pixels of ``image``.

        Raises:
            ModelError: the network is missing or refused, or its output is no map.
            UsageError: its shift is to be taken out and not known.
        """
        image = now.require("image")
        maps = self.output_maps(image)
        if self.kind == "disparity":
            depth = depth_from_disparity(maps, self.floor, self.align, self._known_affine())
        else:
            depth = torch.where(maps > 0, maps, torch.nan)
        return replace(now, depth=depth.to(image.device))

    @property
    def note(self) -> str:
        """What a reader of its depth should know; empty where that is nothing."""
        if self.kind != "disparity" or self.align != "raw":
            return ""
        return "the shift of its disparity is taken for 0, and filmic space depends on it (align: shift, docs/score.md)"

    @property
    def unaligned(self) -> bool:
        """Whether a shift is to be taken out that is not known yet."""
        return self.align != "raw" and self.affine is None

    def _known_affine(self) -> tuple[float, float]:
        if self.unaligned:
            field = "extractors.depth_onnx.affine"
            hint = "a transfer reads it off its scene; elsewhere take what `cltransfer models align SCENE` prints"
            raise UsageError("", field, f"expected [a, b] for align {self.align}, got null", hint)
        return self.affine or (1.0, 0.0)

    def output_maps(self, image: Tensor) -> Tensor:
        """What the network says of ``image`` (B, 3, H, W) in [0, 1], on its pixels, (B, H, W).

        Raises:
            ModelError: the network is missing or refused, or its output is no map.
        """
        raw = self.network({self.input: self._input(image)})[self.output]
        if raw.ndim not in (3, 4) or (raw.ndim == 4 and raw.shape[1] != 1):
            reason = f"expected (B, h, w) or (B, 1, h, w), got {raw.shape}"
            raise ModelError(self.model, f"output {self.output}", reason)
        maps = torch.from_numpy(raw.reshape(len(raw), 1, *raw.shape[-2:]))
        return torch.nn.functional.interpolate(maps, image.shape[2:], mode="bilinear")[:, 0]

    def _input(self, image: Tensor) -> np.ndarray:
        size = self._size(image.shape[3], image.shape[2])
        require_input(self.model, len(image), size, "crop what is so long")
        return normalised(resized(to_uint8(image), size, cv2.INTER_CUBIC), self.mean, self.std)

    def _size(self, width: int, height: int) -> tuple[int, int]:
        """What images of ``width`` by ``height`` are resized to (W, H) [px]."""
        if not self.multiple:
            return self.width, self.height
        scale = max(self.width / width, self.height / height)
        return self._stepped(width * scale, self.width), self._stepped(height * scale, self.height)

    def _stepped(self, side: float, least: int) -> int:
        """The multiple nearest to ``side`` that is at least ``least``."""
        return self.multiple * max(round(side / self.multiple), math.ceil(least / self.multiple))
