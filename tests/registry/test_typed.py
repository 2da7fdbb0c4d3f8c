"""Plain values become a dataclass, or one line says which of them does not fit, what was expected and what came."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Literal

import pytest

from cltransfer.errors import ModelError, UsageError
from cltransfer.registry.typed import IN_QUOTES, nearest, typed


@dataclass
class Inner:
    rate: float = 1.0
    word: str | None = None

    def __post_init__(self) -> None:
        if self.rate < 0:
            raise ValueError(f"rate must not be negative, got {self.rate}")


@dataclass(frozen=True)
class Outer:
    name: str
    kind: Literal["near", "far"] = "near"
    count: int | None = None
    sure: bool = False
    budget: int | str = "auto"
    point: tuple[float, float] | None = None
    words: tuple[str, ...] = ()
    inner: Inner = field(default_factory=Inner)
    inners: list[Inner] = field(default_factory=list)
    more: dict[str, Any] = field(default_factory=dict)
    surely: bool | None = None
    flags: tuple[bool, ...] = ()
    pair: tuple[int, bool] = (0, False)
    rows: list[list[str]] = field(default_factory=list)
    named: dict[str, bool] = field(default_factory=dict)
    other: Inner | None = None
    others: dict[str, Inner] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.count == 13:
            raise ValueError("count must not be 13")
        if self.count == 14:
            raise ValueError("count must not be 14 where name is given")


@dataclass
class Unfit:
    call: Callable[[int], int] | None = None


def test_values_are_converted_by_the_types_of_their_fields() -> None:
    made = typed(Outer, {"name": 3, "count": "4", "point": [1, 2], "inner": {"rate": 2}, "inners": [{"rate": 3}]})
    assert made == Outer("3", count=4, point=(1.0, 2.0), inner=Inner(2.0), inners=[Inner(3.0)])


WRONG: list[tuple[dict[str, Any], str]] = [
    ({}, "name: is required (expected text)"),
    ({"name": "???"}, "name: is required (write its value)"),
    (
        {"name": "a", "more": {"x": ["${name}"]}},
        "more.x[0]: interpolation is not part of the grammar (write the value)",
    ),
    ({"name": "a${oc.env:HOME}"}, "name: interpolation is not part of the grammar (write the value)"),
    ({"name": "a", "sure": 1}, "sure: expected true or false, got 1"),
    ({"name": "a", "sure": 0.0}, "sure: expected true or false, got 0.0"),
    ({"name": None}, "name: expected text, got null"),
    ({"name": [1]}, "name: expected text, got [1]"),
    ({"name": True}, "name: expected text, got true (YAML takes yes, on and 1.10 for other things: text in quotes)"),
    ({"name": 1.1}, "name: expected text, got 1.1 (YAML takes yes, on and 1.10 for other things: text in quotes)"),
    (
        {"kind": False},
        "kind: expected one of near, far, got false (YAML takes yes, on and 1.10 for other things: text in quotes)",
    ),
    ({"surely": 7}, "surely: expected true or false or null, got 7"),
    ({"flags": [True, 0]}, "flags[1]: expected true or false, got 0"),
    ({"pair": [3, 1]}, "pair[1]: expected true or false, got 1"),
    ({"named": {"head": 2}}, "named.head: expected true or false, got 2"),
    ({"words": ["a", 1.1]}, f"words[1]: expected text, got 1.1 ({IN_QUOTES})"),
    ({"words": [True]}, f"words[0]: expected text, got true ({IN_QUOTES})"),
    ({"rows": [["a"], ["b", False]]}, f"rows[1][1]: expected text, got false ({IN_QUOTES})"),
    ({"inner": {"word": True}}, f"inner.word: expected text or null, got true ({IN_QUOTES})"),
    ({"other": {"word": 1.1}}, f"other.word: expected text or null, got 1.1 ({IN_QUOTES})"),
    ({"others": {"x": {"word": True}}}, f"others.x.word: expected text or null, got true ({IN_QUOTES})"),
    ({"other": {"rate": "fast"}}, "other.rate: expected a number, got 'fast'"),
    ({"others": {"x": {"rte": 1}}}, "others.x.rte: no such key (did you mean 'rate'?)"),
    ({"nme": "a"}, "nme: no such key (did you mean 'name'?)"),
    ({"kind": 1.5}, "kind: expected one of near, far, got 1.5"),
    ({"kind": "middle"}, "kind: expected one of near, far, got 'middle'"),
    ({"count": 1.5}, "count: expected a whole number or null, got 1.5"),
    ({"sure": "perhaps"}, "sure: expected true or false, got 'perhaps'"),
    ({"budget": True}, "budget: expected a whole number or text, got true"),
    ({"point": 3}, "point: expected a list of 2 numbers or null, got 3"),
    ({"point": [1]}, "point: expected a list of 2 numbers or null, got [1]"),
    ({"point": [1, "x"]}, "point: expected a list of 2 numbers or null, got [1, 'x']"),
    ({"point": {"x": 1}}, "point: expected a list of 2 numbers or null, got {'x': 1}"),
    ({"point": [1, "???"]}, "point[1]: is required (write its value)"),
    ({"words": "one"}, "words: expected a list of texts, got 'one'"),
    ({"inner": 3}, "inner: expected a mapping of keys to values, got 3"),
    ({"inner": {"rte": 3}}, "inner.rte: no such key (did you mean 'rate'?)"),
    ({"inner": {"rate": "fast"}}, "inner.rate: expected a number, got 'fast'"),
    ({"inner": {"rate": 10**400}}, f"inner.rate: expected a number, got 1{'0' * 17}...{'0' * 19}"),
    ({"inner": {"rate": -1}}, "rate must not be negative, got -1.0"),
    ({"inner": {"rate": -1}, "count": 1.5}, "count: expected a whole number or null, got 1.5"),
    ({"inners": [{}, {"rate": "fast"}]}, "inners[1].rate: expected a number, got 'fast'"),
    ({"inners": 3}, "inners: expected a list of mappings, got 3"),
    ({"more": 3}, "more: expected a mapping of keys to values, got 3"),
    ({"more": {"a": {"b": "???"}}}, "more.a.b: is required (write its value)"),
    ({"count": 13}, "count: count must not be 13"),
    ({"count": 14}, "count must not be 14 where name is given"),
]


class Side(Enum):
    LEFT = 1
    RIGHT = 2


@dataclass(frozen=True)
class Joints:
    table: dict[str, float] = field(default_factory=lambda: {"head": 1.0, "foot": 2.0})
    sides: dict[Side, float] = field(default_factory=lambda: {Side.LEFT: 1.0, Side.RIGHT: 2.0})
    loose: Any = field(default_factory=lambda: {"head": {"x": 1}})
    words: list[str] = field(default_factory=lambda: ["a", "b"])


@dataclass(frozen=True)
class Bodies:
    one: Joints = field(default_factory=Joints)
    more: dict[str, Joints] = field(default_factory=lambda: {"first": Joints()})
    row: list[Joints] = field(default_factory=list)
    none: Joints | None = None


def test_a_mapping_that_is_given_replaces_the_default_as_a_list_does() -> None:
    given = {"table": {"head": 5}, "sides": {"RIGHT": 3}, "loose": {"foot": {"y": 2}}, "words": ["c"]}
    wanted = Joints({"head": 5.0}, {Side.RIGHT: 3.0}, {"foot": {"y": 2}}, ["c"])
    assert typed(Joints, given) == wanted
    within = {"one": given, "more": {"other": given}, "row": [given, {}], "none": given}
    assert typed(Bodies, within) == Bodies(wanted, {"other": wanted}, [wanted, Joints()], wanted)
    assert typed(Joints, {"table": {}}) == Joints(table={})
    assert typed(Bodies, {"one": {"table": {"hip": 1}}}).one == Joints(table={"hip": 1.0})


@dataclass(frozen=True)
class Several:
    bodies: dict[str, Joints] = field(default_factory=lambda: {"a": Joints(), "b": Joints()})


def test_a_mapping_is_as_it_is_given_in_whatever_order_its_keys_stand_there() -> None:
    made = typed(Several, {"bodies": {"b": {"table": {"hip": 1}}, "a": {}}}).bodies
    assert list(made.items()) == [("b", Joints({"hip": 1.0})), ("a", Joints())]


def test_values_inside_others_are_taken_as_they_are_meant() -> None:
    more = {"flags": [True, False], "pair": [3, True], "rows": [["1.10", 3]], "surely": None, "named": {"head": False}}
    made = typed(Outer, {"name": "a", **more, "other": {"rate": 3}, "others": {"x": {"word": "yes"}}})
    assert (made.flags, made.pair, made.surely, made.named) == ((True, False), (3, True), None, {"head": False})
    assert (made.rows, made.other, made.others) == ([["1.10", "3"]], Inner(3.0), {"x": Inner(word="yes")})


@pytest.mark.parametrize(("values", "line"), WRONG)
def test_what_does_not_fit_is_told_in_plain_words(values: dict[str, Any], line: str) -> None:
    with pytest.raises(UsageError) as caught:
        typed(Outer, values if not values or {"name", "nme"} & set(values) else {"name": "a", **values})
    assert str(caught.value) == line


def test_a_class_whose_options_no_config_can_hold_is_named() -> None:
    with pytest.raises(ModelError, match=r"^class Unfit: expected options that are numbers, text, true or false"):
        typed(Unfit, {})


def test_a_word_is_a_hint_where_it_is_a_letter_or_two_apart() -> None:
    assert nearest("jont", ["joint", "head"]) == "did you mean 'joint'?"
    assert nearest("out", ["joint", "head"]) == "known: head, joint"
