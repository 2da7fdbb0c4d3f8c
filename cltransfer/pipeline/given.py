"""What extractors make of what they were given: refused where it is of other frames, or no longer what was given."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from torch import Tensor

from ..camera import Camera
from ..errors import ModelError
from ..feature_values import odd_values, same_values
from ..features import Features
from ..subject import Subject


def checked(got: Any, given: Features, count: int, name: str, provides: Collection[str]) -> Features:
    """``got``, which extractor ``name`` has made of ``count`` frames of which it was ``given`` something, or nothing.

    Raises:
        ModelError: it is nothing that an extractor gives, of other frames than it was given, or what was given is gone
            or another, though the extractor does not say that it ``provides`` that.
    """
    who, hint = f"extractor {name}", "return features.having(NAME, VALUE)"
    if not isinstance(got, Features):
        reason = f"expected {', '.join(provides)}, got {type(got).__name__}"
        raise ModelError("", who, reason, "return Features")
    lost = sorted(given.names() - got.names())
    if got.names() and len(got) != count:
        reason = f"expected the {count} frames that it was given, got {len(got)}"
    elif got.size != given.size:
        reason = f"expected frames of {_by(given.size)} px as it was given, got {_by(got.size)}"
    elif lost:
        reason = f"expected what it was given and its own, {lost[0]!r} is gone"
    elif other := replaced(got, given, provides):
        reason = f"expected what it was given and its own, {other[0]!r} is another"
        hint = f"give it a name of its own, or name {other[0]!r} in provides"
    else:
        return got
    raise ModelError("", who, reason, hint)


def check_values(found: Features, name: str, provides: Collection[str]) -> None:
    """Refuse what extractor ``name`` has read of a clip if it has values that the feature cannot have.

    Raises:
        ModelError: it has.
    """
    if odd := odd_values(found, provides):
        raise ModelError("", f"extractor {name}", f"{odd[0]}: {odd[1]}", odd[2])


def replaced(got: Features, given: Features, provides: Collection[str]) -> list[str]:
    """What was ``given`` and is another in ``got``, by name, but for what is provided; one object takes no time."""
    names = sorted((given.names() & got.names()).difference(provides))
    return [name for name in names if not _alike(got.require(name), given.require(name))]


def _alike(one: Any, other: Any) -> bool:
    """Whether both have the same values, NaN where both are."""
    if one is other:
        return True
    if isinstance(one, Camera) and isinstance(other, Camera):
        return one.size == other.size and _alike(one.w2c, other.w2c) and _alike(one.K, other.K)
    if isinstance(one, Subject) and isinstance(other, Subject):
        return one.to_json() == other.to_json()
    if not (isinstance(one, Tensor) and isinstance(other, Tensor)):
        return False
    return same_values(one.to(other.device), other)


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"
