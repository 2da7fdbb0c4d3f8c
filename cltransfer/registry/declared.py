"""What a class declares to be a component, looked at when it registers: a mistake shows before anything runs."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import reprlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from types import MemberDescriptorType
from typing import Any

from ..errors import ModelError

FAMILIES = ("image", "scene", "both")
BUILTIN = "builtin:"  # before the name of a scene that is made from code
SCENE_SUFFIXES = (
    ".ply",
    ".splat",
    ".spz",
    ".safetensors",
    ".glb",
    ".gltf",
    ".obj",
    ".yaml",
    ".yml",
)  # of what we read ourselves
HEAVIEST = 1e12  # of a loss beside others: squares of what is weighted stay numbers
OF_RESIDUALS = ("residuals", "beyond", "directions")  # the others tell of the first
_ABSENT = object()


def _always(cls: type[Any]) -> bool:
    return True


@dataclass(frozen=True)
class Declared:
    """An attribute, an option or a method of a component's class.

    Args:
        name: of it.
        expected: what it says, in words.
        example: how it is written.
        right: whether a value of it can be meant.
        option: it is a field, so that a config can set it.
        of_class: it is asked of the class, before there is any component.
        when: of which classes it is expected.
    """

    name: str
    expected: str
    example: str
    right: Callable[[Any], bool] = callable
    option: bool = False
    of_class: bool = False
    when: Callable[[type[Any]], bool] = _always

    def found(self, cls: type[Any]) -> str:
        """What ``cls`` has instead, empty where it is as expected."""
        value = next((vars(c)[self.name] for c in cls.__mro__ if self.name in vars(c)), _ABSENT)
        is_option = self.name in {field.name for field in dataclasses.fields(cls)}
        if self.option and not is_option:
            return f"has no option {self.name}"
        if value is _ABSENT:
            return "" if is_option else f"has no {self.name}"
        told_by_each = not self.of_class and isinstance(value, property | cached_property | MemberDescriptorType)
        return "" if told_by_each or self.right(value) else f"has {self.name} = {reprlib.repr(value)}"


def odd_options(cls: type[Any]) -> tuple[str, str] | None:
    """What of the options that are written in a class would be none, or have its base's default, and what to do.

    That its base is a dataclass a class inherits, with the base's options: its own are none then. None if all is well.
    """
    params, wanted = vars(cls).get("__dataclass_params__"), "expected @dataclass(frozen=True) below @register"
    if params is None or not params.frozen:
        came = "one that is not frozen" if params else "that of its base" if dataclasses.is_dataclass(cls) else "none"
        return f"{wanted}, class {cls.__name__} has {came}", f"write it above class {cls.__name__}"
    for option in dataclasses.fields(cls):
        owner = [base for base in cls.__mro__ if _own_options(base).get(option.name) is option][-1]
        for base in cls.__mro__[: cls.__mro__.index(owner)]:
            value = vars(base).get(option.name, option.default)
            kept = isinstance(value, MemberDescriptorType) or getattr(value, "fset", None) is not None
            if not kept and value != option.default:
                came = f"class {base.__name__} has {option.name} = {reprlib.repr(value)}"
                reason = f"expected options with their types, {came}: without one it stays as {owner.__name__} has it"
                hint = option.type if isinstance(option.type, str) else inspect.formatannotation(option.type)
                return reason, f"write {option.name}: {hint} = ..."
    return None


def _own_options(cls: type[Any]) -> dict[str, dataclasses.Field[Any]]:
    options: dict[str, dataclasses.Field[Any]] = vars(cls).get("__dataclass_fields__", {})
    return options


def check_declared(what: str, cls: type[Any], wanted: Iterable[Declared]) -> None:
    """Refuse a class that is no component.

    Args:
        what: the component, for the line.
        cls: its class.
        wanted: what such a class declares.

    Raises:
        ModelError: it is no frozen dataclass, something is missing or cannot be meant, or what tells of residuals is of
            a base with other ones; the line says how it is written.
    """
    if odd := odd_options(cls):
        raise ModelError("", what, *odd)
    _check_residuals(what, cls)
    for declared in wanted:
        found = declared.found(cls) if declared.when(cls) else ""
        if found:
            reason = f"class {cls.__name__} {found}, expected {declared.expected}"
            raise ModelError("", what, reason, f"write {declared.example} in the class")


def _check_residuals(what: str, cls: type[Any]) -> None:
    """Refuse a loss whose residuals are its own, and what is told beside them its base's: a search would mix both."""
    places = [next((i for i, base in enumerate(cls.__mro__) if name in vars(base)), -1) for name in OF_RESIDUALS]
    for name, place in zip(OF_RESIDUALS[1:], places[1:]):
        if place > places[0] >= 0:
            own, base = (cls.__mro__[i].__name__ for i in (places[0], place))
            reason = f"expected {name} of the residuals of class {own}, it is that of {base}"
            raise ModelError("", what, reason, f"write {name} beside them, or {name} = {base}.{name} if it holds")


def names_of(cls: type[Any], attribute: str) -> list[str]:
    """The names that a class tells, sorted; none where only its components do, by a property."""
    names = getattr(cls, attribute, ())
    return sorted(names) if _names(names) else []


def _names(value: Any) -> bool:
    return isinstance(value, tuple | list | set | frozenset) and all(isinstance(name, str) for name in value)


def _some_names(value: Any) -> bool:
    return _names(value) and len(value) > 0


def _with_image(value: Any) -> bool:
    return _names(value) and "image" in value


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _positive(value: Any) -> bool:
    return _number(value) and value > 0


def _weight(value: Any) -> bool:
    return _number(value) and 0 <= value <= HEAVIEST


def _count(value: Any) -> bool:
    return isinstance(value, int) and value > 0


def _flag(value: Any) -> bool:
    return isinstance(value, bool)


def _groups(value: Any) -> bool:
    return isinstance(value, tuple | list) and bool(value) and all(isinstance(g, int) and g >= 0 for g in value)


def _family(value: Any) -> bool:
    return value in FAMILIES


def _suffixes(value: Any) -> bool:
    if not (isinstance(value, tuple | list) and value and all(isinstance(suffix, str) for suffix in value)):
        return False
    return all(re.fullmatch(r"\.[a-z0-9_]+", suffix) and suffix not in SCENE_SUFFIXES for suffix in value)


def _of_the_class(value: Any) -> bool:
    return isinstance(value, staticmethod | classmethod)


def _reads(cls: type[Any]) -> bool:
    return hasattr(cls, "suffixes")


def _whole_clip(cls: type[Any]) -> bool:
    return bool(getattr(cls, "whole_clip", False))


USES = Declared("uses", "a tuple of feature names", 'uses = ("depth",)', _names, when=lambda cls: hasattr(cls, "uses"))
LOSS = (
    Declared("requires", "a tuple of feature names", 'requires = ("keypoints",)', _some_names),
    USES,
    Declared("unit", "the unit of the raw value as text", 'unit = "frame"', _text),
    Declared("penalty", "a finite number above 0", "penalty = 1.0", _positive),
    Declared("weight", "a number from 0 to 1e12", "weight: float = 1.0", _weight, option=True),
    Declared("__call__", "the raw loss, (B,)", "def __call__(self, reference, rendered)"),
    Declared(
        "groups", "the group of each residual, counted from 0", "groups = (0,)", _groups,
        when=lambda cls: hasattr(cls, "residuals"),
    ),
    Declared(
        "signs", "a tuple of what a positive residual means, in words", 'signs = ("larger",)', _some_names,
        when=lambda cls: hasattr(cls, "signs"),
    ),
    Declared(
        "residuals", "the signed residuals (B, R) that it has signs for", "def residuals(self, reference, rendered)",
        when=lambda cls: hasattr(cls, "signs"),
    ),
)  # fmt: skip
EXTRACTOR = (
    Declared("requires", "a tuple of feature names", 'requires = ("image",)', _names),
    USES,
    Declared("provides", "a tuple of feature names, at least one", 'provides = ("keypoints",)', _some_names),
    Declared("family", f"one of {', '.join(FAMILIES)}", 'family = "image"', _family),
    Declared(
        "__call__", "frames with what it provides", "def __call__(self, now, before)",
        when=lambda cls: not _whole_clip(cls),
    ),
    Declared("read_clip", "a whole clip with what it provides", "def read_clip(self, found, load)", when=_whole_clip),
)  # fmt: skip
RENDERER = (
    Declared(
        "provides", "the names of its buffers, image among them, which every result is kept as",
        'provides = frozenset({"image", "depth"})', _with_image,
    ),
    Declared("render", "what cameras see", "def render(self, scene, cameras, buffers)"),
    Declared(
        "draws", "a tuple of the renderers whose scenes it draws, at least one", 'draws = ("gaussian_splats",)',
        _some_names, when=lambda cls: hasattr(cls, "draws"),
    ),
    Declared(
        "suffixes", f"a tuple of suffixes in small letters, none of {', '.join(SCENE_SUFFIXES)}",
        'suffixes = (".mine",)', _suffixes, of_class=True, when=_reads,
    ),
    Declared(
        "read", "a static or class method that reads a file of its suffixes", "@staticmethod def read(path)",
        _of_the_class, of_class=True, when=_reads,
    ),
)  # fmt: skip
SEARCH = (
    Declared("dimensions", "the length of x, 1 or more", "dimensions = 7", _count),
    Declared("needs_subject", "True or False", "needs_subject = True", _flag),
    Declared("bounds", "the lowest and highest x", "def bounds(self)"),
    Declared("cameras", "the cameras of x", "def cameras(self, x, home, subject)"),
    Declared("vector", "the x of cameras", "def vector(self, camera, home, subject)"),
)
FITTER = (
    Declared("side", "the images' longer side in px", "side: int = 200", _count, option=True),
    Declared("require", "a look at what the computer has", "def require(self)"),
    Declared("fit", "levels of detail", "def fit(self, views, folder, report)"),
)
