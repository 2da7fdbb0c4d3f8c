"""Plain values to a dataclass, each by the type of its field; what does not fit is told in plain words."""

from __future__ import annotations

import dataclasses
import difflib
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from ..errors import ModelError, UsageError

T = TypeVar("T")
REQUIRED = "???"  # what OmegaConf takes for a value that is still to come
WORDS: dict[Any, str] = {
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    str: "text",
    NoneType: "null",
    Any: "a value",
}
CLOSE = 0.7  # of two words, in [0, 1]: a letter or two apart; "out" and "joint" are 0.5
MANY: dict[Any, str] = {int: "whole numbers", float: "numbers", bool: "true or false", str: "texts"}
IN_QUOTES = "YAML takes yes, on and 1.10 for other things: text in quotes"


def typed(cls: type[T], values: Mapping[str, Any]) -> T:
    """A ``cls``, a dataclass, of plain ``values``. A list or a mapping that is given replaces the default.

    Raises:
        UsageError: a key that ``cls`` has not, a value that does not fit, or one that is missing; ``field`` is its key.
            Or what ``cls`` itself refuses, with its reason.
        ModelError: ``cls`` has an option that no config can hold.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    for key in _keys_of(lambda text: text == REQUIRED, values):
        raise UsageError("", key, "is required", "write its value")
    for key in _keys_of(lambda text: "${" in text, values):
        raise UsageError("", key, "interpolation is not part of the grammar", "write the value")
    try:
        schema = OmegaConf.structured(cls)
    except OmegaConfBaseException as error:
        expected = "options that are numbers, text, true or false, or lists and mappings of them"
        raise ModelError("", f"class {cls.__name__}", f"expected {expected}, got {_first_line(error)}") from error
    for mistake in _altered(cls, values):
        raise mistake
    try:
        merged = OmegaConf.merge(schema, dict(values))
        merged = _given_alone(merged, values)
    except (OmegaConfBaseException, ValueError, TypeError, OverflowError) as error:
        raise _mistake(cls, values) or UsageError("", "", _first_line(error)) from None
    try:
        return OmegaConf.to_object(merged)  # type: ignore[return-value]
    except OmegaConfBaseException as error:
        raise _mistake(cls, values) or UsageError("", "", _first_line(error)) from None
    except (ValueError, TypeError) as error:
        raise UsageError("", _named(cls, str(error)), _first_line(error)) from None


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint that names the known word nearest to ``name``, or all of them."""
    options = sorted(known)
    close = difflib.get_close_matches(str(name), options, n=1, cutoff=CLOSE)
    return f"did you mean {close[0]!r}?" if close else f"known: {', '.join(options)}"


def in_words(hint: Any) -> str:
    """What a value of a type is, for a person.

    >>> in_words(float | None)
    'a number or null'
    >>> in_words(tuple[float, float])
    'a list of 2 numbers'
    """
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Literal:
        return f"one of {', '.join(map(str, inner))}"
    if origin in (Union, UnionType):
        return " or ".join(in_words(each) for each in inner)
    if origin in (tuple, list):
        count = f"{len(inner)} " if origin is tuple and ... not in inner else ""
        of = next(iter(inner), None)
        return f"a list of {count}{'mappings' if dataclasses.is_dataclass(of) else MANY.get(of, 'values')}"
    if dataclasses.is_dataclass(hint) or origin in (dict, Mapping):
        return "a mapping of keys to values"
    return WORDS.get(hint, getattr(hint, "__name__", str(hint)))


def _mistake(cls: Any, values: Any, above: str = "") -> UsageError | None:
    """The first of ``values`` that is no value of ``cls``, or that it lacks; ``above`` is the key they stand under.

    None of what is no dataclass, or not given as a mapping.
    """
    if not dataclasses.is_dataclass(cls) or not isinstance(values, Mapping):
        return None
    hints, fields = get_type_hints(cls), {field.name: field for field in dataclasses.fields(cls)}
    for key, value in values.items():
        if key not in fields:
            return UsageError("", f"{above}{key}", "no such key", nearest(key, fields))
        for inner, part, where in _parts(hints[key], value, f"{above}{key}"):
            if found := _mistake(_not_null(inner), part, f"{where}."):
                return found
        if not _fits(fields[key], hints[key], value):
            return UsageError("", f"{above}{key}", f"expected {in_words(hints[key])}, got {shown(value)}")
    for name, field in fields.items():
        if name not in values and field.default is field.default_factory is dataclasses.MISSING:
            return UsageError("", f"{above}{name}", "is required", f"expected {in_words(hints[name])}")
    return None


def _altered(cls: type[Any], values: Mapping[str, Any]) -> Iterator[UsageError]:
    """Those of ``values``, and of what is inside them, that would be taken for another one.

    What was text once, and would be another as text again: yes as True, 1.10 as 1.1; and numbers as flags.
    """
    for hint, value, key in _parts(cls, values):
        if _not_null(hint) is bool and isinstance(value, int | float) and not isinstance(value, bool):
            yield UsageError("", key, f"expected {in_words(hint)}, got {shown(value)}")
        if isinstance(value, bool if _is_choice(hint) else bool | float) and _is_text(hint):
            yield UsageError("", key, f"expected {in_words(hint)}, got {shown(value)}", IN_QUOTES)


def _parts(hint: Any, value: Any, key: str = "") -> Iterator[tuple[Any, Any, str]]:
    """A value and all that is inside it, each with its type and its key; of keys that are none nothing."""
    yield hint, value, key
    for inner, part, where in _inside(hint, value, key):
        yield from _parts(inner, part, where)


def _given_alone(merged: Any, values: Any) -> Any:
    """``merged`` without what is a default in its mappings beside the ``values`` that are given, as lists are."""
    from omegaconf import DictConfig, ListConfig, OmegaConf, flag_override

    pairs: Iterable[tuple[Any, Any]] = ()
    if isinstance(merged, DictConfig) and isinstance(values, Mapping):
        if (plain := OmegaConf.get_type(merged) is dict) and [*map(str, merged)] != [*map(str, values)]:
            with flag_override(merged, "readonly", False):  # as what is inside a frozen class is
                merged.clear()
            merged = OmegaConf.merge(merged, dict(values))
        pairs = zip(list(merged) if plain else values, values.values())  # keys as they are there, a number or a text
    elif isinstance(merged, ListConfig) and isinstance(values, list | tuple):
        pairs = enumerate(values)
    for key, part in pairs:
        if isinstance(part, Mapping | list | tuple) and (alone := _given_alone(merged[key], part)) is not merged[key]:
            with flag_override(merged, "readonly", False):
                merged[key] = alone
    return merged


def _is_choice(hint: Any) -> bool:
    return get_origin(hint) is Literal


def _is_text(hint: Any) -> bool:
    """Whether a field takes text and nothing else, null perhaps."""
    if get_origin(hint) is Literal:
        return all(isinstance(value, str) for value in get_args(hint))
    if get_origin(hint) in (Union, UnionType):
        return all(part is type(None) or _is_text(part) for part in get_args(hint))
    return hint is str


def _not_null(hint: Any) -> Any:
    """What a field takes besides null, if that is of one type."""
    if get_origin(hint) in (Union, UnionType):
        others = [part for part in get_args(hint) if part is not NoneType]
        return others[0] if len(others) == 1 else hint
    return hint


def _inside(hint: Any, value: Any, key: str) -> Iterator[tuple[Any, Any, str]]:
    """What stands in a mapping or a list, each with its type and its key."""
    hint = _not_null(hint)
    origin, inner = get_origin(hint), get_args(hint)
    if isinstance(value, Mapping) and dataclasses.is_dataclass(hint):
        hints = get_type_hints(hint)
        for name, part in value.items():
            if name in hints:
                yield hints[name], part, f"{key}.{name}" if key else name
    elif isinstance(value, Mapping) and origin in (dict, Mapping) and len(inner) == 2:
        for name, part in value.items():
            yield inner[1], part, f"{key}.{name}"
    elif isinstance(value, list | tuple) and origin in (list, tuple):
        each = inner if origin is tuple and ... not in inner else inner[:1] * len(value)
        for i, (of, part) in enumerate(zip(each, value)):
            yield of, part, f"{key}[{i}]"


def _fits(field: dataclasses.Field[Any], hint: Any, value: Any) -> bool:
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    default: Any = dataclasses.field(default=field.default, default_factory=field.default_factory)
    alone = dataclasses.make_dataclass("Alone", [(field.name, hint, default)])
    try:
        merged = OmegaConf.merge(OmegaConf.structured(alone), {field.name: value})
    except (OmegaConfBaseException, ValueError, TypeError, OverflowError):
        return False
    try:
        OmegaConf.to_object(merged)
    except OmegaConfBaseException:
        return False
    except (ValueError, TypeError):  # a dataclass inside refuses what has the right types
        return True
    return True


def _keys_of(meant: Callable[[str], bool], value: Any, key: str = "") -> Iterator[str]:
    """Keys in ``value`` whose own is a text that is ``meant``."""
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _keys_of(meant, part, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list | tuple):
        for i, part in enumerate(value):
            yield from _keys_of(meant, part, f"{key}[{i}]")
    elif isinstance(value, str) and meant(value):
        yield key


def _named(cls: type[Any], reason: str) -> str:
    """The option that a class speaks of when it refuses its values; empty where it is none or several."""
    words = set("".join(c if c.isalnum() or c == "_" else " " for c in reason).split())
    told = [field.name for field in dataclasses.fields(cls) if field.name in words]
    return told[0] if len(told) == 1 else ""


def shown(value: Any) -> str:
    """A value as YAML has it, cut where it is long."""
    plain = {None: "null", True: "true", False: "false"}
    return plain[value] if value is None or isinstance(value, bool) else reprlib.repr(value)


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
