"""What goes into an ONNX network and what it gives, against what an extractor asks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..errors import ModelError

Shape = tuple[int | None, ...]
"""Expected sizes, batch first; None is any."""
Kind = Literal["input", "output"]


@dataclass(frozen=True)
class Port:
    """Where a file has an input or output.

    Args:
        name: what the file calls it.
        channels_last: its images are (B, H, W, C) in the file, (B, C, H, W) to us.
    """

    name: str
    channels_last: bool = False

    def fed(self, value: np.ndarray) -> np.ndarray:
        """``value`` (B, C, H, W) as the file wants it."""
        return np.ascontiguousarray(value.transpose(0, 2, 3, 1)) if self.channels_last else value

    def read(self, value: np.ndarray) -> np.ndarray:
        """``value`` of the file as (B, C, H, W)."""
        return value.transpose(0, 3, 1, 2) if self.channels_last and value.ndim == 4 else value


def ports(
    path: Path, kind: Kind, wanted: Mapping[str, Shape | None], given: Sequence[Any], by_shape: bool
) -> dict[str, Port]:
    """Where each of ``wanted`` is among what the file has.

    Args:
        path: the file, for errors.
        kind: of which of the two these are; a file must have no other inputs, but may have other outputs.
        wanted: shapes by our names.
        given: onnxruntime's descriptions (``name``, ``type``, ``shape``).
        by_shape: where the file has other names, each is known by its shape, channels first or last.

    Raises:
        ModelError: one is missing, of another type or shape, or by its shape it could be several.
    """
    names = {entry.name for entry in given}
    by_name = set(wanted) <= names and not (kind == "input" and names - set(wanted))
    if by_name:
        found = {name: Port(name) for name in wanted}
    elif by_shape and not (kind == "input" and len(given) != len(wanted)):
        found = {name: _by_shape(path, f"{kind} {name}", shape, given) for name, shape in wanted.items()}
    else:
        raise ModelError(
            path, f"{kind}s", f"expected {', '.join(wanted)}, got {', '.join(entry.name for entry in given)}"
        )
    entries = {entry.name: entry for entry in given}
    for name, port in found.items():
        _check(path, f"{kind} {name}", turned(wanted[name]) if port.channels_last else wanted[name], entries[port.name])
        batch = entries[port.name].shape[0] if kind == "input" else 1
        if isinstance(batch, int) and batch != 1:
            raise ModelError(path, f"{kind} {name}", f"expected a batch of 1 or free, got {batch}")
    return found


def turned(shape: Shape | None) -> Shape | None:
    """``shape`` with the channels last."""
    return shape if shape is None or len(shape) != 4 else (shape[0], shape[2], shape[3], shape[1])


def _by_shape(path: Path, field: str, shape: Shape | None, given: Sequence[Any]) -> Port:
    """The one of ``given`` with ``shape``; sizes that the file leaves open fit none but the batch."""
    ways = {False: shape, **({True: turned(shape)} if shape is not None and len(shape) == 4 else {})}
    fits = [Port(entry.name, last) for entry in given for last, way in ways.items() if _is(way, entry.shape)]
    if len(fits) != 1:
        there = ", ".join(f"{entry.name} {tuple(entry.shape)}" for entry in given)
        wanted = " or ".join(str(way) for way in ways.values())
        raise ModelError(path, field, f"expected one of shape {wanted}, got {there}")
    return fits[0]


def _is(wanted: Shape | None, given: Sequence[Any]) -> bool:
    return wanted is not None and len(wanted) == len(given) and all(w is None or w == g for w, g in zip(wanted, given))


def _check(path: Path, field: str, wanted: Shape | None, entry: Any) -> None:
    if entry.type != "tensor(float)":
        raise ModelError(path, field, f"expected tensor(float), got {entry.type}")
    if differs(wanted, entry.shape):
        raise ModelError(path, field, f"expected shape {wanted}, got {tuple(entry.shape)}")


def joined(path: Path, name: str, parts: Sequence[np.ndarray]) -> np.ndarray:
    """The output ``name`` (B, ...) of a batch that ran in ``parts``.

    Raises:
        ModelError: it has no rows, or rows of several shapes.
    """
    shapes = {part.shape[1:] for part in parts}
    if any(part.ndim == 0 for part in parts):
        raise ModelError(path, f"output {name}", "expected a row for each input, got a single value")
    if len(shapes) > 1:
        raise ModelError(path, f"output {name}", f"expected rows of one shape, got {sorted(shapes)}")
    return np.concatenate(parts)


def differs(wanted: Shape | None, given: Any) -> bool:
    """Whether ``given`` (whole numbers, or names and None for any) cannot be ``wanted``."""
    if wanted is None:
        return False
    pairs = zip(wanted, given)
    return len(wanted) != len(given) or any(w is not None and isinstance(g, int) and w != g for w, g in pairs)
