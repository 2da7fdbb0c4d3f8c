"""YAML that a parser would choke on, or take the half of, is refused before."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
import yaml

from cltransfer.storage.yaml_text import YAML_LEVELS, check_yaml, named_twice

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


def test_keys_named_twice_are_found_among_very_many(within: Callable[[float, float], bool]) -> None:
    node = yaml.compose("\n".join(f"k{i}: 0" for i in (*range(20_000), 7)), Loader=LOADERS[1])
    begun = time.process_time()
    assert list(named_twice(node)) == ["k7"]
    assert within(time.process_time() - begun, 0.5)  # 4 s by looking through all those before
