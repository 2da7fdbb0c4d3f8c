"""YAML from strangers, looked at before it is read: no anchors, no deep nesting, no key that is named twice."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

YAML_VALUES = 2**15  # keys too, lists and mappings; those of a scene of 256 parts are 6,000
YAML_LEVELS = 64  # a config takes six; a parser's own stack ends at some thousand
MOST_BITS = 2**13  # Python writes no whole number of more than 4300 digits


def check_yaml(text: str, loader: Any) -> None:
    """Refuse anchors, of which a short file makes a huge value, deep nesting, and more than is read in seconds.

    Args:
        text: as it was written.
        loader: by which it will be read.

    Raises:
        ValueError: it names an anchor or an alias, is nested deeper than :data:`YAML_LEVELS`, or has more than
            :data:`YAML_VALUES` keys and values.
        YAMLError: it is no YAML.
    """
    import yaml

    deep, depth, values = ValueError(f"expected at most {YAML_LEVELS} levels"), 0, 0
    try:
        for event in yaml.parse(text, loader):
            if getattr(event, "anchor", None):
                raise ValueError("expected no anchors and aliases (& and *), write the values")
            values += isinstance(event, yaml.NodeEvent)
            if values > YAML_VALUES:
                raise ValueError(f"expected at most {YAML_VALUES} keys and values")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > YAML_LEVELS:
                raise deep
    except yaml.YAMLError as error:
        # newer releases of libyaml look ahead for the end of a key and stop at a depth of their own before it is seen
        raise (deep if "nesting depth" in str(getattr(error, "problem", "")) else error) from None


def plain_values(text: str) -> Any:
    """What ``yaml.safe_load`` makes of a text.

    Raises:
        ValueError: a value is not of the kind that its form or its tag says, as in ``!!bool x`` and ``!!int ''``.
        YAMLError: it is no YAML.
    """
    import yaml

    try:
        return yaml.safe_load(text)
    except (LookupError, AttributeError, ArithmeticError):  # its constructors check none of them
        raise ValueError("a value is not of the kind that its form or its tag (!!) says") from None


def long_numbers(value: Any) -> Iterator[int]:
    """Whole numbers of more than :data:`MOST_BITS` in values of YAML, its keys too; they cannot be shown."""
    if isinstance(value, dict | list | tuple | set):
        for part in (*value, *value.values()) if isinstance(value, dict) else value:
            yield from long_numbers(part)
    elif isinstance(value, int) and value.bit_length() > MOST_BITS:
        yield value


def named_twice(node: Any) -> Iterator[str]:
    """Keys that a mapping has twice in a node of YAML; ``yaml.safe_load`` takes the last."""
    below = node.value if node is not None and node.id != "scalar" else []
    if below and node.id == "mapping":
        names = Counter(key.value for key, _ in below if key.id == "scalar")
        yield from (name for name, times in names.items() if times > 1)
        below = [value for _, value in below]
    for part in below:
        yield from named_twice(part)
