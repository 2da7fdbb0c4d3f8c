"""What a config is laid together from: YAML files and key=value, as plain mappings."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from ..errors import InputError, UsageError
from ..storage.files import read_text
from ..storage.yaml_text import check_yaml, named_twice, plain_values

COMMAND_LINE = "command line"
YAML_LIMIT = 2**20  # bytes
PLAIN = "a number, text, true, false, null, a list or a mapping"
MISREAD = re.compile(r"[-+]?(0[0-7_]+|[1-9][0-9_]*(:[0-5]?[0-9])+|[0-9][0-9_]*(:[0-5]?[0-9])+\.[0-9_]*)")
"""What YAML 1.1 reads in base 8 or 60."""
QUOTES = "what has spaces stands in quotes: 'key={a: b}'"
BITS = 64  # of a whole number; one of thousands of digits cannot even be shown
NAMED = ("renderer", "extractors", "losses", "search")  # sections of components by name
ONE_EACH = ("renderer", "search")  # sections of one component: naming another replaces it


@dataclass(frozen=True)
class Layer:
    """Values of a config, and where each was written.

    Args:
        values: plain, nested.
        origins: a file's name or the command line, by key as ``section.name.option``.
    """

    values: Mapping[str, Any]
    origins: Mapping[str, str]

    @classmethod
    def written(cls, values: Mapping[str, Any], where: str | Path) -> Layer:
        """A layer whose values are all written in one place."""
        return cls(values, dict.fromkeys(_keys(values), str(where)))

    def over(self, below: Layer) -> Layer:
        """This layer merged over another one."""
        return Layer(merge(below.values, self.values), {**below.origins, **self.origins})


def origin(origins: Mapping[str, str], key: str) -> str:
    """Where ``key``, or else what it stands under, was written last; empty where it was not."""
    while key and key not in origins:
        key = key.rpartition(".")[0]
    return origins.get(key, "")


def told(error: UsageError, origins: Mapping[str, str]) -> UsageError:
    """``error`` with where its key was written."""
    return UsageError(error.where or origin(origins, error.field), error.field, error.reason, error.hint)


def _keys(values: Mapping[str, Any], above: str = "") -> Iterator[str]:
    for key, value in values.items():
        yield f"{above}{key}"
        if isinstance(value, Mapping):
            yield from _keys(value, f"{above}{key}.")


def read_yaml(path: Any) -> dict[str, Any]:
    """The mapping in a YAML file, nothing resolved and nothing run.

    Raises:
        UsageError: it is missing, too large, no plain YAML, no mapping, asks for interpolation, or has a whole number
            of more than :data:`BITS`.
    """
    import yaml
    from omegaconf import OmegaConf

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # as omegaconf chooses
    try:
        text = read_text(path, YAML_LIMIT) if isinstance(path, Path) else path.read_text()
    except InputError as error:
        raise UsageError(path, error.field, error.reason) from None
    _refuse_interpolation(text, path, "${")
    try:
        check_yaml(text, loader)
    except (yaml.YAMLError, ValueError) as error:
        _refuse_tab(text, path, getattr(error, "problem_mark", None))
        raise UsageError(path, "", f"not a config: {_fault(error)}") from None
    _refuse_misread(text, path, "", loader)
    try:
        value = OmegaConf.to_container(OmegaConf.create(text), resolve=False) if text.strip() else {}
    except yaml.YAMLError as error:  # a key that is there twice, of which only the reader knows
        raise UsageError(path, "", f"not a config: {_fault(error)}") from None
    except Exception:  # omegaconf has one class per fault and no common base
        raise UsageError(path, "", f"not a config: expected keys with values, each {PLAIN}") from None
    if not isinstance(value, dict):
        raise UsageError(path, "", "expected a mapping of keys to values")
    _refuse_long(value, path, "")
    _refuse_interpolation(value, path, "${")
    return {str(key): entry for key, entry in value.items()}


def _fault(error: Exception) -> str:
    """What a reader of YAML says is wrong, in one line; it calls any text a string and not by its file's name."""
    return " ".join(str(error).replace('in "<unicode string>",', "at").split())[:200]


def parse_overrides(overrides: Iterable[str], apart: bool = False) -> dict[str, Any]:
    """``section.name.option=value`` as nested mappings; values are YAML, none is null.

    Of two searches or renderers the one that is named last counts.

    Args:
        overrides: in the order in which they are said.
        apart: keep both where one is named by its options, as of rows that have one or the other.

    Raises:
        UsageError: an item is no ``key=value``, is no plain YAML, asks for interpolation, has a whole number of more
            than :data:`BITS`, or names a part of what an earlier one says is no mapping.
    """
    import yaml

    nested: dict[str, Any] = {}
    for item in overrides:
        key, equals, text = item.partition("=")
        if not equals or not key:
            raise UsageError(COMMAND_LINE, item, "expected key=value")
        _refuse_interpolation(item, COMMAND_LINE, key)
        try:
            check_yaml(text, yaml.SafeLoader)
        except ValueError as error:
            raise UsageError(COMMAND_LINE, key, str(error)) from None
        except yaml.YAMLError:
            hint = QUOTES * is_cut(text)
            raise UsageError(COMMAND_LINE, key, f"not a YAML value: {text}", hint) from None
        for twice in named_twice(yaml.compose(text, yaml.SafeLoader)):
            raise UsageError(COMMAND_LINE, key, f"expected each key once, {twice!r} is there twice")
        try:
            value = plain_values(text) if text else None
        except (yaml.YAMLError, ValueError):  # a date without such a day, a number without digits
            raise UsageError(COMMAND_LINE, key, f"not a YAML value: {text}") from None
        _refuse_misread(text, COMMAND_LINE, key, yaml.SafeLoader)
        _refuse_interpolation(value, COMMAND_LINE, key)
        _refuse_long(value, COMMAND_LINE, key)
        for foreign in _foreign(value):
            raise UsageError(
                COMMAND_LINE, key, f"expected {PLAIN}, got {foreign!r}", "text stands in quotes of its own"
            )
        _refuse_part_of_none(nested, key)
        own = nest(key, value)
        nested = merge(nested, own, apart and _says_options(own))  # what was said of its parts before stays
    return nested


def _refuse_part_of_none(said: Mapping[str, Any], key: str) -> None:
    """Refuse a part of what was ``said`` before to be no mapping."""
    below: Any = said
    parents = key.split(".")[:-1]
    for i, parent in enumerate(parents):
        below, above = below.get(parent, {}), ".".join(parents[: i + 1])
        if isinstance(below, Mapping):
            continue
        came = f"{above}=null before it says that there is none" if below is None else f"{above}={below} before it"
        section = parent in NAMED and not any(name in NAMED for name in parents[:i])
        hint = f"{above}.NAME=null, one by one" if section else "leave one of them out"
        raise UsageError(COMMAND_LINE, key, f"expected {above} as a mapping, {came}", hint)


def _says_options(own: Mapping[str, Any]) -> bool:
    """Whether an override names a search or a renderer by its options: what says ``{}`` asks for it."""
    sections = [own[section] for section in ONE_EACH if isinstance(own.get(section), Mapping)]
    return any(options for section in sections for options in section.values())


def is_cut(text: str) -> bool:
    """Whether a value opens more brackets than it closes, as what a shell has cut at a space does.

    >>> is_cut("{model:"), is_cut("{model: a.onnx}")
    (True, False)
    """
    return sum(map(text.count, "{[")) > sum(map(text.count, "}]"))


def _refuse_interpolation(value: Any, where: Any, field: str) -> None:
    """``value`` is a text as it was written, or what was parsed of it: YAML can write ``${`` without these letters."""
    if _interpolates(value):
        raise UsageError(where, field, "interpolation is not part of the grammar", "write the value")


def _refuse_misread(text: str, where: Any, field: str, loader: Any) -> None:
    """Refuse a number that is another one in YAML than anywhere else: 010 would be 8, and 1:30 would be 90."""
    import yaml

    for token in yaml.scan(text, loader):
        if isinstance(token, yaml.ScalarToken) and token.plain and MISREAD.fullmatch(token.value):
            reason = f"YAML reads {token.value[:40]} in base {60 if ':' in token.value else 8}"
            raise UsageError(
                where, field, reason, "write a number without leading zeros and colons, and text in quotes"
            )


def _refuse_long(value: Any, where: Any, field: str) -> None:
    """Refuse a whole number of more than :data:`BITS`, as a value or as a key in it."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            _refuse_long(key, where, field)
            _refuse_long(part, where, f"{field}.{key}" if field else str(key))
    elif isinstance(value, (list, tuple, set)):
        for part in value:
            _refuse_long(part, where, field)
    elif isinstance(value, int) and value.bit_length() > BITS:
        reason = f"expected a number of at most {BITS} bits, got one of {value.bit_length()}"
        raise UsageError(where, field, reason, "a larger one has a point, and text stands in quotes")


def _refuse_tab(text: str, where: Any, mark: Any) -> None:
    """Tell of a tab that ``text`` is indented by where YAML could not go on, at ``mark``; None where nobody knows."""
    lines = text.splitlines()
    if mark is not None and mark.line < len(lines) and re.match(" *\t", lines[mark.line]):
        raise UsageError(where, f"line {mark.line + 1}", "a tab, expected spaces", "YAML is indented by spaces alone")


def _interpolates(value: Any) -> bool:
    if isinstance(value, Mapping):
        return any(_interpolates(key) or _interpolates(entry) for key, entry in value.items())
    if isinstance(value, (list, tuple, set)):
        return any(map(_interpolates, value))
    return isinstance(value, (str, PurePath)) and "${" in str(value)


def _foreign(value: Any) -> Iterator[Any]:
    """What in a value of YAML is more than plain: a date, a set, bytes."""
    if isinstance(value, dict | list):
        for part in value if isinstance(value, list) else (*value, *value.values()):
            yield from _foreign(part)
    elif not isinstance(value, str | int | float | None):
        yield value


def nest(key: str, value: Any) -> dict[str, Any]:
    """``section.name.option`` and its value as a file writes it.

    >>> nest("losses.framing.weight", 2.0)
    {'losses': {'framing': {'weight': 2.0}}}
    """
    *parents, last = key.split(".")
    own = {last: value}
    for parent in reversed(parents):
        own = {parent: own}
    return own


def merge(below: Mapping[str, Any], above: Mapping[str, Any], inside: bool = False) -> dict[str, Any]:
    """``above`` over ``below``, key by key; null stays, to be removed when all is merged.

    Args:
        below: values.
        above: values that count where both have one.
        inside: whether the keys stand inside a section, where ``search`` is the name of somebody's option.
    """
    merged = dict(below)
    for key, value in above.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            merged[key] = merge(old, value, inside or key in NAMED)
        else:
            merged[key] = value
        if not inside and key in ONE_EACH and isinstance(value, Mapping):
            named = [name for name, options in value.items() if options is not None]
            if len(named) == 1:  # naming another renderer replaces the one below
                merged[key] = {named[0]: merged[key][named[0]]}
    return merged
