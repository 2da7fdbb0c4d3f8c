"""What frames show: the one value that flows between renderers, extractors and losses."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, SupportsIndex, TypeVar

import torch
from torch import Tensor

from .camera import Camera, batch_index, concatenate, frame_size
from .feature_shapes import SHAPES, check_shapes
from .subject import Subject

T = TypeVar("T")
NOTHING = "nothing"  # of zero width, (N, 0): frames of which no feature could be read are counted by it


class OfThisRun(str):
    """A reason due to this run, not the clip (a timeout): not cached."""


@dataclass(frozen=True, eq=False)
class Features:
    """What B frames show. Pixels are (x, y); the centre of the top-left pixel is (0.5, 0.5).

    A field that is None was not extracted; a NaN in it is undefined for that frame or pixel.

    Args:
        size: (W, H) that pixel coordinates and flow vectors refer to; maps may have fewer pixels.
        image: RGB in [0, 1], (B, 3, H, W).
        alpha: coverage of the scene in [0, 1], (B, H, W).
        label: coverage by the subject in [0, 1], (B, H, W).
        depth: along the optical axis, > 0, larger is farther, (B, H, W); NaN where nothing is seen. The
            median along the ray where a renderer made it; up to scale where a network did.
        expected_depth: the mean along the ray instead, (B, H, W).
        keypoints: the 14 joints of :mod:`cltransfer.skeleton`, (B, 14, 3) as x, y [px], confidence in [0, 1].
            Coordinates are kept for joints that are unseen or out of the frame. A joint that was not found is NaN, and
            all are where there is no person; (0, 0) is a place in the picture.
        box: person box as x, y, width, height [px], score, (B, 5); NaN where there is no person. The score is 0 where
            nobody was detected and the place is a guess, from the frames around (:func:`cltransfer.clips.gaps.filled`).
        subject: the person's pixels, (B, H, W) bool; the :class:`~cltransfer.subject.Subject` is ``person``.
        layers: foreground, character, background, (B, 3, H, W) bool, disjoint.
        flow: backward flow, frame i -> i-1, (B, 2, H, W) [px of ``size``]; NaN where undefined (first frame).
        flow_confidence: how far ``flow`` can be trusted, (B, H, W) in [0, 1] on its pixels; NaN where it is undefined.
        orientation: yaw, pitch, roll of the camera about the subject, (B, 3) [rad]. Yaw is 0 in front of the
            body and grows to its left, pitch is positive from above, roll is positive when the body leans right
            as a camera shows it that is turned to look at it (:func:`cltransfer.orientation.orientation_from_axes`).
        camera: who looks, where known (a renderer knows, a clip does not).
        person: who stands in the scene, where known.
        extras: plugins' own features, each with batch first, none of them called like a field.
        reasons: why a feature is not there, by name, where an extractor looked and could not tell; see
            :class:`OfThisRun`.

    Raises:
        ValueError: a field has another shape, or another number of frames than the others; an extra has a field's name;
            ``size`` is none.
        TypeError: one that should be a tensor is none, a mask is not bool, or an image has no floats.
    """

    size: tuple[int, int]
    image: Tensor | None = None
    alpha: Tensor | None = None
    label: Tensor | None = None
    depth: Tensor | None = None
    expected_depth: Tensor | None = None
    keypoints: Tensor | None = None
    box: Tensor | None = None
    subject: Tensor | None = None
    layers: Tensor | None = None
    flow: Tensor | None = None
    flow_confidence: Tensor | None = None
    orientation: Tensor | None = None
    camera: Camera | None = None
    person: Subject | None = None
    extras: Mapping[str, Tensor] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    _known: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", frame_size(self.size))
        check_shapes(self.__dict__, self.extras)

    def __len__(self) -> int:
        for name in (*SHAPES, "camera"):
            if (value := getattr(self, name)) is not None:
                return len(value)
        for value in self.extras.values():
            return len(value)
        raise ValueError("features are empty: no field is set")

    def __getitem__(self, index: SupportsIndex | slice | Sequence[int] | Tensor) -> Features:
        """Frames of ``index``; an integer keeps a batch of one, the same object each time.

        Raises:
            IndexError: there is no such frame.
        """
        rows = batch_index(index)
        if not isinstance(rows, int):
            return self._map(lambda value: value[rows])
        if not -len(self) <= rows < len(self):  # a slice of one would be empty, and no loop over frames would end
            raise IndexError(f"expected a frame from {-len(self)} to {len(self) - 1}, got {rows}")
        one = slice(rows, rows + 1 or None)
        return self.once(("frame", rows), lambda: self._map(lambda value: value[one]))

    def once(self, key: Hashable, compute: Callable[[], T]) -> T:
        """What ``compute`` makes of these features, kept by ``key``: one reference is compared with many batches.

        Tensors that torch has changed in place since are other features. What numpy changes in their memory no tensor
        tells: make new features then, or what was kept is that of the old values. Of some that ask for a gradient
        nothing is kept, since each of its users goes back through it, nor of some made in inference mode, which do not
        tell of changes.
        """
        values = [value for value in self._batched().values() if isinstance(value, Tensor)]
        if any(value.requires_grad or value.is_inference() for value in values):
            return compute()
        versions = [value._version for value in values]
        if key not in self._known or self._known[key][0] != versions:
            self._known[key] = (versions, compute())
        known: T = self._known[key][1]
        return known

    @property
    def lasts(self) -> bool:
        """Whether another run tells no more; see :class:`OfThisRun`."""
        return not any(isinstance(reason, OfThisRun) for reason in self.reasons.values())

    def __getstate__(self) -> dict[str, Any]:
        """Without what :meth:`once` keeps: a frame that was looked at would bring the whole clip along."""
        return {**self.__dict__, "_known": {}}

    def has(self, name: str) -> bool:
        """Whether feature ``name`` was extracted."""
        return name in self.extras or (name in NAMES and getattr(self, name) is not None)

    def require(self, name: str) -> Any:
        """Feature ``name``.

        Raises:
            KeyError: it was not extracted.
        """
        if not self.has(name):
            raise KeyError(f"feature {name!r} was not extracted; add an extractor that provides it")
        return self.extras[name] if name in self.extras else getattr(self, name)

    def names(self) -> frozenset[str]:
        """Names of all features that are there."""
        return frozenset(n for n in NAMES if getattr(self, n) is not None) | frozenset(self.extras)

    def having(self, name: str, value: Any) -> Features:
        """The same with ``value`` as feature ``name``, a plugin's own among the extras; None takes it away."""
        if name in NAMES:
            return replace(self, **{name: value})
        others = {n: v for n, v in self.extras.items() if n != name}
        return replace(self, extras=others if value is None else {**others, name: value})

    def only(self, names: Iterable[str]) -> Features:
        """The same without any feature but ``names``, or one; where none of them is there, still of as many frames."""
        keep = {names} if isinstance(names, str) else set(names)
        blank: dict[str, Any] = {n: None for n in self.names() - keep if n not in self.extras}
        extras = {n: v for n, v in self.extras.items() if n in keep}
        if not self.names() & keep:
            extras = {NOTHING: torch.zeros(len(self), 0)}
        return replace(self, **blank, extras=extras)

    def to(self, device: torch.device | str, non_blocking: bool = False) -> Features:
        """The same on ``device``; cameras and the person stay on the CPU, where they are reckoned with in float64.

        Raises:
            TypeError: it is a type; what each feature is of, it stays.
        """
        if isinstance(device, torch.dtype):
            raise TypeError(f"expected a device, got {device}: features keep their types")
        return self._map(lambda v: v.to(device, non_blocking=non_blocking) if isinstance(v, Tensor) else v)

    def cpu(self) -> Features:
        """The same on the CPU."""
        return self.to("cpu")

    def pin_memory(self) -> Features:
        """The same in memory from which a GPU copies fast, as a loader asks for it."""
        return self._map(lambda value: value.pin_memory() if isinstance(value, Tensor) else value)

    def detach(self) -> Features:
        """The same without gradients."""

        def without(value: Any) -> Any:
            if isinstance(value, Camera):
                return replace(value, w2c=value.w2c.detach(), K=value.K.detach())
            return value.detach()

        return self._map(without)

    def _batched(self) -> dict[str, Any]:
        own = {n: getattr(self, n) for n in NAMES if n != "person" and getattr(self, n) is not None}
        return {**own, **self.extras}

    def _map(self, change: Callable[[Any], Any]) -> Features:
        new = {n: change(v) for n, v in self._batched().items()}
        extras = {n: new.pop(n) for n in self.extras}
        return replace(self, **new, extras=extras)

    @staticmethod
    def concatenate(parts: Sequence[Features]) -> Features:
        """One batch of several that hold the same features of one shape; of no person where they are of several.

        Raises:
            ValueError: they do not.
        """
        if unlike := _unlike(parts):
            raise ValueError(f"features of a batch must be of one size and have the same names and shapes, {unlike}")
        first = parts[0]

        def join(name: str) -> Any:
            values = [p.require(name) for p in parts]
            return concatenate(values) if name == "camera" else torch.cat(values)

        new = {n: join(n) for n in first._batched()}
        extras = {n: new.pop(n) for n in first.extras}
        person = first.person if all(p.person is first.person for p in parts) else None
        return replace(first, **new, extras=extras, person=person)


NAMES = tuple(f.name for f in fields(Features) if f.name not in ("size", "extras", "reasons", "_known"))


def _unlike(parts: Sequence[Features]) -> str:
    """Why ``parts`` are no batch; empty where they are."""
    if not parts:
        return "got no frames"
    if len(sizes := {part.size: None for part in parts}) > 1:
        return f"got {' and '.join(map(str, sizes))}; give all clips one size"
    names = [part.names() for part in parts]
    lacking = frozenset.union(*names) - frozenset.intersection(*names)
    if lacking:
        return f"not all have {', '.join(sorted(lacking))}; leave them out with only"
    for name in sorted(parts[0].names() - {"camera", "person"}):
        if len(shapes := {tuple(part.require(name).shape[1:]): None for part in parts}) > 1:
            return f"{name} has {' and '.join(map(str, shapes))} a frame; read all of them by one extractor"
    return ""


def check_pair(reference: object, rendered: object) -> None:
    """Refuse what a loss cannot compare.

    Raises:
        TypeError: a side is no :class:`Features`.
        ValueError: the reference has neither 1 nor as many frames as the render.
    """
    if not (isinstance(reference, Features) and isinstance(rendered, Features)):
        came = f"{type(reference).__name__} and {type(rendered).__name__}"
        raise TypeError(f"expected Features of the reference and of the render, got {came}; see clip_features")
    if len(reference) not in (1, len(rendered)):
        counts = f"the reference has {len(reference)} and the render {len(rendered)}"
        raise ValueError(f"expected as many frames of both, or 1 of the reference: {counts}")


def nobody(features: Features) -> Tensor:
    """Frames (N,) bool in which no person was found; none where nobody was looked for."""
    if not features.has("keypoints"):
        return torch.zeros(len(features), dtype=torch.bool)
    return ~torch.isfinite(features.require("keypoints")[..., 0]).any(1)
