"""Extracted features on disk, as safetensors: read once a clip, used by every run after."""

from __future__ import annotations

import itertools
import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..computer.memory import require_free
from ..errors import InputError
from ..feature_values import odd_values
from ..features import NAMES, SHAPES, Features
from ..registry.typed import nearest
from ..storage.tensor_file import HEADER_LIMIT, check_tensor_file, save_tensors

_log = logging.getLogger("cltransfer")
KIND = "cltransfer.features."
FORMAT = f"{KIND}1"
LIMIT = 4 * 2**30  # bytes
WIDEST = 2**16  # pixels of a side, far above what a decoder takes
SHOWN, TOLD = 40, 5  # characters of what a file says, in an error; tensors that are no feature, by name
EXTRAS = "extras."
STORED = ("keypoints", "box", "subject", "layers", "depth", "flow", "flow_confidence", "orientation")

MASKS = ("subject", "layers")


@dataclass(frozen=True, eq=False)
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

    @property
    def lasts(self) -> bool:
        """Whether another run finds all of it here, but the pixels, and nothing that it may tell better itself."""
        lost = self.features.names() - {*STORED, *self.features.extras, "image"}
        return not lost and self.features.lasts

    def save(self, path: str | Path) -> None:
        """Write the file, whole or not at all."""
        origin = self.origin.encode(errors="backslashreplace").decode()  # a file's name may be no UTF-8
        meta = {"format": FORMAT, "size": json.dumps(self.features.size), "origin": origin}
        meta["reasons"] = json.dumps(dict(self.features.reasons))
        save_tensors(Path(path), self._tensors(), meta)

    def _tensors(self) -> dict[str, Tensor]:
        stored = {name: self.features.require(name).contiguous() for name in STORED if self.features.has(name)}
        extras = {f"{EXTRAS}{name}": value.contiguous() for name, value in self.features.extras.items()}
        return {"times": self.times, **stored, **extras}

    @classmethod
    def load(cls, path: str | Path) -> FeatureFile:
        """Read the file; a tensor of a name that no feature has is left out, and told.

        Raises:
            InputError: it is missing, too large, of another format, or its tensors are of a wrong type, do not fit
                together or have values that the feature cannot have.
            ResourceError: there is not memory enough for it.
        """
        from safetensors import SafetensorError, safe_open

        path = Path(path)
        check_tensor_file(path, LIMIT, "feature file")
        require_free(path.stat().st_size, path, "the features", "take fewer frames")
        try:
            with safe_open(path, framework="pt") as stream:
                meta: dict[str, str] = stream.metadata() or {}
                # a copy each: what it gives is a map of the file, whose values change where another is copied over it
                tensors = {key: stream.get_tensor(key).clone() for key in stream.keys()}  # noqa: SIM118
        except SafetensorError as error:
            raise InputError(path, "", f"not a feature file: {error}") from None
        if meta.get("format") != FORMAT:
            known = meta.get("format", "").startswith(KIND)
            hint = "another version has written it, write it anew by this one" if known else "docs/python.md writes one"
            raise InputError(path, "format", f"expected {FORMAT!r}, got {meta.get('format')!r}", hint)
        return cls(_features(path, tensors, meta), _times(path, tensors), meta.get("origin", ""))


def _times(path: Path, tensors: dict[str, Tensor]) -> Tensor:
    times = tensors.get("times")
    if (
        times is None
        or not _counts(times.dtype)
        or times.dim() != 1
        or len(times) == 0
        or not bool((times.double().diff() > 0).all() and times.isfinite().all())
    ):
        raise InputError(path, "times", "expected a list of increasing times", "store them as float64")
    return times.double()


def _counts(dtype: torch.dtype) -> bool:
    """Whether it is a type of numbers that seconds may be stored as: floats of 16 bits and more, and integers."""
    return dtype.itemsize > 1 if dtype.is_floating_point else not (dtype.is_complex or dtype is torch.bool)


def _features(path: Path, tensors: dict[str, Tensor], meta: dict[str, str]) -> Features:
    count, size = len(_times(path, tensors)), _size(path, meta)
    given = {name: value for name, value in tensors.items() if name in ("times", *STORED) or name.startswith(EXTRAS)}
    for name, value in given.items():
        if value.dim() == 0 or len(value) != count:
            got = "a single value" if value.dim() == 0 else len(value)
            raise InputError(path, name, f"expected {count} frames, got {got}")
        shape = SHAPES.get(name)
        if shape is not None and (value.dim() != len(shape) + 1 or not _fits(value.shape[1:], shape)):
            raise InputError(path, name, f"expected (N, {shape}), got {tuple(value.shape)}")
        if shape is not None and 0 in value.shape:
            raise InputError(path, name, f"expected at least one pixel, got {tuple(value.shape)}")
    own: dict[str, Any] = {name: _typed(path, name, tensors[name]) for name in STORED if name in tensors}
    _check_grids(path, own)
    _check_layers(path, own)
    extras = {name.removeprefix(EXTRAS): value for name, value in given.items() if name.startswith(EXTRAS)}
    for name in sorted(NAMES & extras.keys()):
        hint = f"store it as {name}" if name in STORED else "leave it out"
        raise InputError(path, f"{EXTRAS}{name}", "is a feature of its own, not an extra", hint)
    reasons = _reasons(path, meta)
    _check_known(path, [*own, *extras], sorted(tensors.keys() - given.keys()))
    features = replace(Features(size), **own, extras=extras, reasons=reasons)
    if odd := odd_values(features, own):
        raise InputError(path, *odd)
    return features


def _check_known(path: Path, known: list[str], unknown: list[str]) -> None:
    """Tell of ``unknown`` tensors, which are left out, and refuse a file without any that is ``known``."""
    names = [_shown(name) for name in unknown[:TOLD]]
    shown = names + [f"{len(unknown) - TOLD} more"] * (len(unknown) > TOLD)
    if not known:
        raise InputError(path, "features", f"expected at least one, it holds {', '.join(['times', *shown])} alone")
    if unknown:
        what = "are no features" if len(unknown) > 1 else "is no feature"
        hints = [nearest(name, [*STORED, f"{EXTRAS}{name}"]) for name in names]
        meant = next((hint for hint in hints if hint.startswith("did you mean")), hints[0])
        _log.warning("%s: %s: %s and left out (%s)", path, ", ".join(shown), what, meant)


def _shown(name: str) -> str:
    """What a stranger calls a tensor, on one line and cut."""
    line = " ".join(name.split())
    return line if len(line) <= SHOWN else f"{line[:SHOWN]}..."


def _size(path: Path, meta: dict[str, str]) -> tuple[int, int]:
    """Width and height [px] of the frames that were read."""
    try:
        told = json.loads(meta.get("size", "null"))
    except (ValueError, RecursionError):
        told = None
    whole = isinstance(told, list) and all(type(side) is int and 1 <= side <= WIDEST for side in told)
    if not (whole and len(told) == 2):
        expected = f"expected [width, height], whole numbers from 1 to {WIDEST}"
        raise InputError(path, "size", f"{expected}, got {meta.get('size', 'none')[:SHOWN]}")
    return told[0], told[1]


def _typed(path: Path, name: str, value: Tensor) -> Tensor:
    """The tensor with the type that the feature has: a mask is bool, all else floats of 32 bits or more.

    Raises:
        InputError: it is of another type, and nothing says what its values mean.
    """
    if name in MASKS:
        if value.dtype is torch.bool or (value.dtype is torch.uint8 and not bool((value > 1).any())):
            return value.bool()
        raise InputError(
            path, name, f"expected bool, or uint8 of 0 and 1, got {_type(value)}", "store the mask as bool"
        )
    if not value.is_floating_point():
        raise InputError(path, name, f"expected floats, got {_type(value)}", "store it as float32")
    return value.float() if value.dtype.itemsize < 4 else value  # float64 stays: what was kept comes back to the bit


def _type(value: Tensor) -> str:
    return str(value.dtype).removeprefix("torch.")


def _check_grids(path: Path, features: dict[str, Tensor]) -> None:
    """Refuse a confidence that has not the pixels of its flow; other maps may have fewer than one another."""
    if not {"flow", "flow_confidence"} <= features.keys():
        return
    got, want = (tuple(features[name].shape[-2:]) for name in ("flow_confidence", "flow"))
    if got != want:
        reason = f"expected the {want[1]}x{want[0]} pixels of flow, got {got[1]}x{got[0]}"
        raise InputError(path, "flow_confidence", reason, "extract or resize both on one grid")


def _check_layers(path: Path, features: dict[str, Tensor]) -> None:
    """Refuse layers of which two hold the same pixel."""
    if "layers" in features:
        pairs = itertools.combinations(features["layers"].unbind(1), 2)  # a sum would take 8 bytes a pixel and layer
        twice = torch.stack([(one & other).flatten(1).any(1) for one, other in pairs]).any(0)
        if bool(twice.any()):
            frame = int(twice.nonzero()[0])
            raise InputError(path, "layers", f"expected each pixel in one layer at most, frame {frame} has one in two")


def _reasons(path: Path, meta: dict[str, str]) -> dict[str, str]:
    """Why features are missing; a file from before they were noted has none."""
    try:
        told = json.loads(meta.get("reasons", "{}"))
    except (ValueError, RecursionError):
        told = None
    if not isinstance(told, dict) or not all(isinstance(reason, str) for reason in told.values()):
        raise InputError(path, "reasons", "expected reasons by feature")
    return told


def _fits(got: torch.Size, shape: tuple[int | None, ...]) -> bool:
    return all(want is None or have == want for have, want in zip(got, shape))
