"""Extracted features on disk, as safetensors: read once a clip, used by every run after."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .errors import InputError
from .features import Features
from .files import atomic
from .tensor_file import HEADER_LIMIT, check_tensor_file

FORMAT = "cltransfer.features.1"
LIMIT = 4 * 2**30  # bytes
STORED = ("keypoints", "box", "subject", "layers", "depth", "flow", "flow_confidence", "orientation")


@dataclass(frozen=True)
class FeatureFile:
    """Features of N frames with their times and where they came from.

    Args:
        features: without pixels.
        times: (N,) [s].
        origin: what was read and how, for reports.
    """

    features: Features
    times: Tensor  # (N,)
    origin: str

    @property
    def size(self) -> int:
        """Bytes that it takes on disk, or a little more."""
        return HEADER_LIMIT + sum(tensor.nbytes for tensor in self._tensors().values())

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        from safetensors.torch import save_file

        meta = {"format": FORMAT, "size": json.dumps(self.features.size), "origin": self.origin}
        meta["reasons"] = json.dumps(dict(self.features.reasons))
        with atomic(path) as temporary:
            save_file(self._tensors(), temporary, metadata=meta)

    def _tensors(self) -> dict[str, Tensor]:
        stored = {name: self.features.require(name).contiguous() for name in STORED if self.features.has(name)}
        extras = {f"extras.{name}": value.contiguous() for name, value in self.features.extras.items()}
        return {"times": self.times, **stored, **extras}

    @classmethod
    def load(cls, path: Path) -> FeatureFile:
        """Read the file.

        Raises:
            InputError: it is missing, too large, of another format, or its tensors do not fit together.
        """
        from safetensors import SafetensorError, safe_open

        check_tensor_file(path, LIMIT, "feature file")
        try:
            with safe_open(path, framework="pt") as stream:
                meta: dict[str, str] = stream.metadata() or {}
                tensors = {key: stream.get_tensor(key) for key in stream.keys()}  # noqa: SIM118
        except SafetensorError as error:
            raise InputError(path, "", f"not a feature file: {error}") from None
        if meta.get("format") != FORMAT:
            raise InputError(path, "format", f"expected {FORMAT!r}, got {meta.get('format')!r}")
        return cls(_features(path, tensors, meta), _times(path, tensors), meta.get("origin", ""))


def _times(path: Path, tensors: dict[str, Tensor]) -> Tensor:
    times = tensors.get("times")
    if (
        times is None
        or times.dim() != 1
        or len(times) == 0
        or not bool((times.diff() > 0).all() and times.isfinite().all())
    ):
        raise InputError(path, "times", "expected a list of increasing times")
    return times.double()


def _features(path: Path, tensors: dict[str, Tensor], meta: dict[str, str]) -> Features:
    count = len(_times(path, tensors))
    try:
        width, height = (int(v) for v in json.loads(meta["size"]))
    except (KeyError, ValueError, TypeError, OverflowError):
        width = height = 0
    if width < 1 or height < 1:
        raise InputError(path, "size", "expected [width, height]")
    for name, value in tensors.items():
        if value.dim() == 0 or len(value) != count:
            got = "a single value" if value.dim() == 0 else len(value)
            raise InputError(path, name, f"expected {count} frames, got {got}")
        shape = _SHAPES.get(name)
        if shape is not None and (value.dim() != len(shape) + 1 or not _fits(value.shape[1:], shape)):
            raise InputError(path, name, f"expected (N, {shape}), got {tuple(value.shape)}")
    own: dict[str, Any] = {name: tensors[name] for name in STORED if name in tensors}
    extras = {key[len("extras.") :]: value for key, value in tensors.items() if key.startswith("extras.")}
    return replace(Features((width, height)), **own, extras=extras, reasons=_reasons(path, meta))


def _reasons(path: Path, meta: dict[str, str]) -> dict[str, str]:
    """Why features are missing; a file from before they were noted has none."""
    try:
        told = json.loads(meta.get("reasons", "{}"))
    except ValueError:
        told = None
    if not isinstance(told, dict) or not all(isinstance(reason, str) for reason in told.values()):
        raise InputError(path, "reasons", "expected reasons by feature")
    return told


_SHAPES: dict[str, tuple[int | None, ...]] = {
    "keypoints": (14, 3),
    "box": (5,),
    "subject": (None, None),
    "layers": (3, None, None),
    "depth": (None, None),
    "flow": (2, None, None),
    "flow_confidence": (None, None),
    "orientation": (3,),
}


def _fits(got: torch.Size, shape: tuple[int | None, ...]) -> bool:
    return all(want is None or have == want for have, want in zip(got, shape))
