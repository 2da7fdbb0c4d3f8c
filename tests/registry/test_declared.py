"""The options of a component are those that are written in its class, or it is refused when it registers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar

import pytest

from cltransfer.errors import ModelError
from cltransfer.losses.filmic_space import FilmicSpace
from cltransfer.registry import LOSSES


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """The loss that a test registers is forgotten after it."""
    yield
    LOSSES._classes.pop("mine", None)


def method(*arguments: object) -> None:
    """Stands for any method."""


@dataclass(frozen=True)
class Base:
    """A loss with options, one of them a mapping."""

    weight: float = 10.0
    table: dict[str, float] = field(default_factory=dict)
    requires, unit, penalty, groups = ("keypoints",), "frame", 1.0, (0,)
    __call__ = residuals = method


class Undecorated(Base):
    weight: float = 20.0
    extra: float = 3.0


@dataclass(frozen=True)
class Untyped(Base):
    weight = 20.0


@dataclass(frozen=True)
class UntypedTable(Base):
    table = {"head": 1.0}


class Mixed:
    weight: float = 20.0


@dataclass(frozen=True)
class OfMixed(Mixed, Base): ...


@dataclass(frozen=True)
class Told(Base):
    weight = property(lambda self: 20.0)  # type: ignore[assignment]


@dataclass
class Thawed:
    weight: float = 1.0


STAYS = "without one it stays as Base has it"
UNLIKE = {
    Undecorated: "expected @dataclass(frozen=True) below @register, class Undecorated has that of its base "
    "(write it above class Undecorated)",
    Thawed: "expected @dataclass(frozen=True) below @register, class Thawed has one that is not frozen "
    "(write it above class Thawed)",
    Mixed: "expected @dataclass(frozen=True) below @register, class Mixed has none (write it above class Mixed)",
    Untyped: f"expected options with their types, class Untyped has weight = 20.0: {STAYS} (write weight: float = ...)",
    UntypedTable: f"expected options with their types, class UntypedTable has table = {{'head': 1.0}}: {STAYS} "
    "(write table: dict[str, float] = ...)",
    OfMixed: f"expected options with their types, class Mixed has weight = 20.0: {STAYS} (write weight: float = ...)",
}


@pytest.mark.parametrize("cls", UNLIKE)
def test_a_class_whose_options_are_not_those_written_in_it_is_refused(cls: type[Any]) -> None:
    with pytest.raises(ModelError) as caught:
        LOSSES.register("mine")(cls)
    assert str(caught.value) == f"loss 'mine': {UNLIKE[cls]}"


def test_a_property_that_takes_no_value_is_no_option() -> None:
    with pytest.raises(ModelError, match="class Told has weight = <property"):
        LOSSES.register("mine")(Told)


@dataclass(frozen=True)
class FromBehind(Base):
    groups = (0, -1)


def test_groups_are_counted_from_0() -> None:
    told = r"class FromBehind has groups = \(0, -1\), expected the group of each residual, counted from 0"
    with pytest.raises(ModelError, match=told):
        LOSSES.register("mine")(FromBehind)


@dataclass(frozen=True)
class Squared(FilmicSpace):
    residuals = method  # type: ignore[assignment]


@dataclass(frozen=True)
class Crossed(Squared):
    beyond = FilmicSpace.beyond


@dataclass(frozen=True)
class Directed(Squared):
    directions = method  # type: ignore[assignment]


@dataclass(frozen=True)
class Whole(Directed):
    beyond = method  # type: ignore[assignment]


@dataclass(frozen=True)
class Alike(FilmicSpace):
    beyond = directions = method  # type: ignore[assignment]


def test_what_is_told_of_other_residuals_than_a_class_has_is_refused() -> None:
    for cls, name in ((Squared, "beyond"), (Directed, "beyond"), (Crossed, "directions")):
        with pytest.raises(ModelError) as caught:
            LOSSES.register("mine")(cls)
        told = f"expected {name} of the residuals of class Squared, it is that of FilmicSpace"
        hint = f"write {name} beside them, or {name} = FilmicSpace.{name} if it holds"
        assert str(caught.value) == f"loss 'mine': {told} ({hint})"


@pytest.mark.parametrize("cls", [Whole, Alike])
def test_a_class_that_tells_all_of_its_residuals_is_taken(cls: type[Any]) -> None:
    LOSSES.register("mine")(cls)
    assert LOSSES.get("mine") is cls


@dataclass(frozen=True)
class Typed(Base):
    """All that may be told of an option anew."""

    weight: float = 20.0
    extra: float = 3.0
    table: ClassVar[dict[str, float]] = {"head": 1.0}


@dataclass(frozen=True, slots=True)
class Slots(Base):
    weight: float = 30.0
    table: dict[str, float] = field(default_factory=lambda: {"head": 1.0})


@dataclass(frozen=True)
class Later(Slots):
    extra: float = 3.0


class Stored:
    """Where an option is kept by a property of its own."""

    @property
    def weight(self) -> float:
        return float(vars(self)["_weight"])

    @weight.setter
    def weight(self, value: float) -> None:
        vars(self)["_weight"] = value


@dataclass(frozen=True)
class OfStored(Stored, Base): ...


@pytest.mark.parametrize(("cls", "weight"), [(Typed, 20.0), (Slots, 30.0), (Later, 30.0), (OfStored, 10.0)])
def test_a_class_that_tells_its_options_with_their_types_is_taken(cls: type[Any], weight: float) -> None:
    LOSSES.register("mine")(cls)
    assert LOSSES.build("mine").weight == weight
    assert LOSSES.build("mine", {"weight": 5}).weight == 5.0
