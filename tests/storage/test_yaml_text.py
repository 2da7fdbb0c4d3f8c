"""YAML that a parser would choke on, or take the half of, is refused before."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
import yaml

from cltransfer.storage.yaml_text import (
    MOST_BITS,
    YAML_LEVELS,
    YAML_VALUES,
    check_yaml,
    long_numbers,
    named_twice,
    plain_values,
)

LOADERS = (yaml.SafeLoader, getattr(yaml, "CSafeLoader", yaml.SafeLoader))


@pytest.mark.parametrize("loader", LOADERS)
def test_yaml_that_is_broken_beside_words_on_nesting_is_told_as_broken(loader: type) -> None:
    with pytest.raises(yaml.YAMLError):
        check_yaml("a: [1, nesting depth: 2", loader)


@pytest.mark.parametrize("loader", LOADERS)
@pytest.mark.parametrize("opened", ["[", "{a: ", "- "])
def test_yaml_of_too_many_levels_is_refused_as_that_by_every_loader(opened: str, loader: type) -> None:
    check_yaml(opened * YAML_LEVELS + "1" + {"[": "]", "{a: ": "}"}.get(opened, "") * YAML_LEVELS, loader)
    for levels in (YAML_LEVELS + 1, 2000, 100_000):  # libyaml has a limit of its own between
        with pytest.raises(ValueError, match=f"expected at most {YAML_LEVELS} levels"):
            check_yaml(opened * levels, loader)


@pytest.mark.parametrize("loader", LOADERS)
@pytest.mark.parametrize("value", ["0,", "a: 0,", "[],"])
def test_yaml_of_too_many_values_is_refused_before_all_of_it_is_read(
    value: str, loader: type, within: Callable[[float, float], bool]
) -> None:
    opened, closed = "{}" if ":" in value else "[]"
    check_yaml(f"{opened}{value.strip(',')}{closed}", loader)
    begun = time.process_time()
    with pytest.raises(ValueError, match=f"expected at most {YAML_VALUES} keys and values"):
        check_yaml(f"{opened}{value * (2**20 // len(value))}{closed}", loader)
    assert within(time.process_time() - begun, 5)


@pytest.mark.parametrize(
    "text", ["!!bool x", "!!timestamp x", "!!int ''", "!!float ''", "!!int +", "1:" * 300 + "1.5", "2001-99-99"]
)
def test_a_value_that_is_not_what_it_is_tagged_as_is_a_bad_value(text: str) -> None:
    with pytest.raises(ValueError, match=r"kind that its form or its tag|month must be"):
        plain_values(f"a: [{{b: {text}}}]")


def test_plain_values_are_those_of_yaml() -> None:
    assert plain_values("a: [1, 2.5, !!bool yes, !!int '7']") == {"a": [1, 2.5, True, 7]}
    with pytest.raises(yaml.YAMLError):
        plain_values("a: [")


def test_numbers_that_cannot_be_shown_are_found_wherever_they_stand() -> None:
    longest, longer = 2**MOST_BITS - 1, 2**MOST_BITS
    assert len(str(longest)) > 2000
    assert not list(long_numbers({"a": [longest, True, 1.5, "text", None]}))
    assert list(long_numbers({longer: {"b": [1, (longer, 2)]}, "c": {-longer}})) == [longer, longer, -longer]


def test_keys_named_twice_are_found_among_very_many(within: Callable[[float, float], bool]) -> None:
    node = yaml.compose("\n".join(f"k{i}: 0" for i in (*range(20_000), 7)), Loader=LOADERS[1])
    begun = time.process_time()
    assert list(named_twice(node)) == ["k7"]
    assert within(time.process_time() - begun, 0.5)  # 4 s by looking through all those before
