"""Which shape each feature has, what is said of one that has another, and maps of fewer pixels on another grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from .subject import Subject

if TYPE_CHECKING:
    from .features import Features

SHAPES: dict[str, tuple[int | None, ...]] = {  # behind the batch; None may be anything
    "image": (3, None, None),
    "alpha": (None, None),
    "label": (None, None),
    "depth": (None, None),
    "expected_depth": (None, None),
    "keypoints": (14, 3),
    "box": (5,),
    "subject": (None, None),
    "layers": (3, None, None),
    "flow": (2, None, None),
    "flow_confidence": (None, None),
    "orientation": (3,),
}
FIXED = [
    (name, 1 + len(shape), tuple(want for want in shape if want is not None), None in shape)
    for name, shape in SHAPES.items()
]


def check_shapes(own: Mapping[str, Any], extras: Mapping[str, Any]) -> None:
    """Refuse fields of other shapes, or of unlike numbers of frames.

    Args:
        own: fields of :class:`~cltransfer.features.Features` by name, the camera among them.
        extras: plugins' own.

    Raises:
        ValueError: a field has another shape, or another number of frames than the others; an extra has a field's name;
            the size is (H, W) beside a map.
        TypeError: one that should be a tensor is none, a mask is not bool, or an image has no floats.
    """
    wide, high = own["size"]
    first, count = "", -1
    for name, dimensions, fixed, is_map in FIXED:  # 7 us of 10 with all there; every evaluation makes some
        if (value := own[name]) is None:
            continue
        shape: tuple[int, ...] = getattr(value, "shape", ())
        if len(shape) != dimensions or shape[1 : 1 + len(fixed)] != fixed or not isinstance(value, Tensor):
            raise _misshapen(name, value)
        if is_map and wide * shape[-1] == high * shape[-2] and shape[-1] != shape[-2]:
            raise _transposed(own["size"], name, shape)
        if count < 0:
            first, count = name, shape[0]
        elif shape[0] != count:
            raise _unequal(first, count, name, shape[0])
    if (image := own["image"]) is not None and not image.is_floating_point():
        raise TypeError(f"image must be RGB in [0, 1], got {image.dtype}; image / 255 makes it so of bytes")
    for name in ("subject", "layers"):
        if own[name] is not None:
            check_mask(name, own[name])
    for name, value in (("camera", own["camera"]), *extras.items()):
        if name in extras and name in own:
            raise ValueError(f"{name} is a field of its own, expected another name among extras; give {name}=...")
        if name in extras and not (isinstance(value, Tensor) and value.ndim):
            raise _rowless(name, value)
        if count < 0 and value is not None:
            first, count = name, len(value)
        elif value is not None and len(value) != count:
            raise _unequal(first, count, name, len(value))


def check_mask(name: str, value: Tensor) -> None:
    """Refuse a mask that is not bool.

    Raises:
        TypeError: it is of another type.
    """
    if value.dtype is not torch.bool:
        raise TypeError(f"{name} must be bool, got {value.dtype}; {name} > 0.5 makes it so")


def on_grid(maps: Tensor, grid: Sequence[int]) -> Tensor:
    """``maps`` (B, h, w) or (B, K, h, w) of any type at ``grid`` (H, W): each pixel has what is nearest to it."""
    if tuple(maps.shape[-2:]) == tuple(grid):
        return maps
    values = maps if maps.is_floating_point() else maps.float()
    planes = values.flatten(0, -3)[:, None]
    return interpolate(planes, tuple(grid), mode="nearest-exact")[:, 0].unflatten(0, maps.shape[:-2]).to(maps.dtype)


def layers_on(features: Features, name: str) -> Tensor:
    """Layers on the pixels of the feature ``name``, (B, 3, H, W) bool: either may have fewer."""
    return on_grid(features.require("layers"), features.require(name).shape[-2:])


def _misshapen(name: str, value: object) -> Exception:
    """What is wrong with a field that is not of its shape, and what to do."""
    wanted = ", ".join(["B", *("any" if want is None else str(want) for want in SHAPES[name])])
    if not isinstance(value, Tensor):
        hint = "that is the field person" if isinstance(value, Subject) else "torch.as_tensor makes one"
        return TypeError(f"{name} must be a tensor ({wanted}), got {type(value).__name__}; {hint}")
    hint = "see the fields of Features"
    if value.ndim == len(SHAPES[name]):
        hint = "add a batch dimension"
    elif name == "keypoints" and value.shape[-2:-1] == (17,):
        hint = "cltransfer.skeleton.from_coco makes 14 of COCO's 17"
    elif name == "keypoints" and value.shape[-2:-1] in ((33,), (39,)):
        hint = "cltransfer.skeleton.from_blazepose makes 14 of BlazePose's"
    return ValueError(f"{name} must be ({wanted}), got {tuple(value.shape)}; {hint}")


def _transposed(size: tuple[int, int], name: str, shape: Sequence[int]) -> ValueError:
    got = f"got {size} where {name} has {shape[-2]} rows and {shape[-1]} columns"
    return ValueError(f"size must be (W, H), {got}; is one of them transposed?")


def _rowless(name: str, value: object) -> TypeError:
    came = "a single value" if isinstance(value, Tensor) else type(value).__name__
    hint = "add a batch dimension" if isinstance(value, Tensor) else "torch.as_tensor makes one"
    return TypeError(f"{name} must be a tensor with one row a frame, got {came}; {hint}")


def _unequal(first: str, count: int, name: str, other: int) -> ValueError:
    return ValueError(f"features must have one number of frames, got {count} in {first} and {other} in {name}")
