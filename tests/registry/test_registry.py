"""A component's class is looked at when it registers: what it lacks is told by name, before anything runs."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import torch

from cltransfer.ablate.outcome import Case, Metric, Outcome
from cltransfer.ablate.summary import summarise
from cltransfer.ablate.tables import COST, values_table
from cltransfer.errors import ModelError, UsageError
from cltransfer.evaluate_kept import ClipScore
from cltransfer.evaluate_table import clips_csv
from cltransfer.pipeline.scores import Scores, Term
from cltransfer.plugins import allow
from cltransfer.registry import EXTRACTORS, LOSSES, RENDERERS, SEARCHES, Registry
from cltransfer.registry.plugin_code import code_of
from cltransfer.report.data import ReportData
from cltransfer.report.metrics import metrics_csv


def method(*arguments: object) -> None:
    """Stands for any method."""


LOSS = {"weight": 1.0, "requires": ("keypoints",), "unit": "frame", "penalty": 1.0, "__call__": method}
EXTRACTOR = {"requires": ("image",), "provides": ("gaze",), "family": "image", "__call__": method}
RENDERER = {"provides": frozenset({"image"}), "render": method}
SEARCH = {"dimensions": 7, "needs_subject": True, "bounds": method, "cameras": method, "vector": method}
GOOD: dict[str, tuple[Registry[Any], dict[str, Any]]] = {
    "loss": (LOSSES, LOSS),
    "extractor": (EXTRACTORS, EXTRACTOR),
    "renderer": (RENDERERS, RENDERER),
    "search": (SEARCHES, SEARCH),
}


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """What a test registers is forgotten after it."""
    yield
    for registry, _ in GOOD.values():
        for name in ("mine", "first", "second"):
            registry._classes.pop(name, None)


def register(kind: str, **changes: Any) -> None:
    """Register a class as ``mine``: a good one but for ``changes``, None leaves out."""
    registry, good = GOOD[kind]
    body = {name: value for name, value in {**good, **changes}.items() if value is not None}
    options = {"weight": float} if kind == "loss" and "weight" in body else {}
    registry.register("mine")(dataclass(frozen=True)(type("Mine", (), {**body, "__annotations__": options})))


@pytest.mark.parametrize("kind", GOOD)
def test_a_class_that_declares_what_its_kind_does_is_taken(kind: str) -> None:
    register(kind)
    assert GOOD[kind][0].get("mine").__name__ == "Mine"


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, (_, good) in GOOD.items() for name in good])
def test_what_a_class_lacks_is_named_with_how_it_is_written(kind: str, name: str) -> None:
    with pytest.raises(ModelError) as caught:
        register(kind, **{name: None})
    assert str(caught.value).startswith(f"{kind} 'mine': class Mine has no ")
    assert f"{name}, expected" in str(caught.value)
    assert f"{name}" in caught.value.hint
    assert caught.value.hint.startswith("write ")


WRONG: list[tuple[str, dict[str, Any], str]] = [
    ("loss", {"requires": "keypoints"}, "has requires = 'keypoints', expected a tuple of feature names"),
    ("loss", {"requires": ()}, r"has requires = \(\), expected"),
    ("loss", {"uses": "flow"}, "has uses = 'flow', expected a tuple of feature names"),
    ("loss", {"penalty": 0.0}, "has penalty = 0.0, expected a finite number above 0"),
    ("loss", {"penalty": float("inf")}, "has penalty = inf, expected a finite number above 0"),
    ("loss", {"weight": -1.0}, "has weight = -1.0, expected a number from 0 to 1e12"),
    ("loss", {"unit": 3}, "has unit = 3, expected"),
    ("loss", {"residuals": method}, r"has no groups, expected .* \(write groups = \(0,\) in the class\)"),
    ("loss", {"residuals": method, "groups": 0}, "has groups = 0, expected"),
    ("extractor", {"family": "picture"}, "has family = 'picture', expected one of image, scene, both"),
    ("extractor", {"provides": ()}, r"has provides = \(\), expected"),
    ("extractor", {"whole_clip": True}, "has no read_clip, expected"),
    (
        "loss",
        {"residuals": method, "groups": (0,), "signs": "larger"},
        "has signs = 'larger', expected a tuple",
    ),
    ("loss", {"signs": ("larger",)}, "has no residuals, expected the signed residuals"),
    ("renderer", {"provides": frozenset({"depth"})}, "has provides = .*, expected .* image among them"),
    ("renderer", {"render": "fast"}, "has render = 'fast', expected"),
    ("search", {"dimensions": 0}, "has dimensions = 0, expected"),
]


@pytest.mark.parametrize(("kind", "changes", "words"), WRONG)
def test_what_a_class_cannot_mean_is_told_with_what_was_expected(
    kind: str, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(ModelError, match=f"^{kind} 'mine': class Mine {words}"):
        register(kind, **changes)
    assert "mine" not in GOOD[kind][0].names()


def test_what_every_component_tells_for_itself_is_left_to_it() -> None:
    register("extractor", provides=property(lambda self: ("gaze",)))
    register("search", **{"dimensions": property(lambda self: 7)})
    register("loss", residuals=method, groups=(0, 1), uses=("flow",))


def test_a_plugin_that_is_no_component_is_refused_when_it_is_allowed(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from dataclasses import dataclass\nfrom cltransfer.registry import LOSSES\n\n"
        "@LOSSES.register('mine')\n@dataclass(frozen=True)\nclass Mine:\n    weight = 1.0\n"
        "    requires, unit, penalty = ('keypoints',), 'frame', 1.0\n    __call__ = print\n"
    )
    with pytest.raises(ModelError, match=r"has no option weight, expected .* \(write weight: float = 1.0 in the class"):
        allow([tmp_path / "mine.py"])


@pytest.mark.parametrize("weight", [-3.0, 1e13, 1e308])
def test_a_weight_that_rewards_a_difference_or_that_no_total_holds_is_refused(weight: float) -> None:
    told = f"losses.framing.weight: expected a number from 0 to 1e12, got {weight}"
    with pytest.raises(UsageError, match=f"^{re.escape(told)}$"):
        LOSSES.build("framing", {"weight": weight})
    assert LOSSES.build("framing", {"weight": 0}).weight == 0


def test_options_that_are_no_mapping_are_refused() -> None:
    options: Any = 10
    with pytest.raises(UsageError, match=r"losses\.framing: expected a mapping of options, got 10"):
        LOSSES.build("framing", options)


@pytest.mark.parametrize("text", ["nan", "inf"])
def test_a_number_that_is_none_is_refused_as_text_too(text: str) -> None:
    with pytest.raises(UsageError, match=r"^losses\.filmic_space\.mismatch: expected a finite number, got "):
        LOSSES.build("filmic_space", {"mismatch": text})


@dataclass(frozen=True)
class Part:
    least: float = 0.0
    most: float = float("inf")


@dataclass(frozen=True)
class OfParts:
    weight: float = 1.0
    part: Part = Part()
    parts: list[Part] = field(default_factory=list)
    table: dict[str, float] = field(default_factory=dict)
    requires, unit, penalty = ("keypoints",), "frame", 1.0
    __call__ = method


@pytest.mark.parametrize("number", ["inf", float("inf")])
@pytest.mark.parametrize(
    ("key", "options"),
    [
        ("part.least", lambda number: {"part": {"least": number}}),
        ("parts[1].most", lambda number: {"parts": [{}, {"most": number}]}),
        ("table.head", lambda number: {"table": {"foot": 1.0, "head": number}}),
    ],
)
def test_a_number_inside_an_option_that_is_none_is_refused(
    key: str, options: Callable[[Any], dict[str, Any]], number: Any
) -> None:
    LOSSES.register("mine")(OfParts)
    assert LOSSES.build("mine", options(2)).weight == 1.0  # a default may be infinite
    with pytest.raises(UsageError, match=re.escape(f"losses.mine.{key}: expected a finite number, got inf")):
        LOSSES.build("mine", options(number))


@pytest.mark.parametrize("name", ["", "a-b", "a.b", "a b", "a|b", "Mine", "3d", "_mine", "mine\n", "größe"])
def test_a_name_that_no_config_can_write_is_refused(name: str) -> None:
    with pytest.raises(ModelError) as caught:
        LOSSES.register(name)
    assert str(caught.value).startswith(f"loss {name!r}: expected small letters, digits and _, a letter first")


def columns() -> list[str]:
    """Whatever stands beside ``framing`` in the tables that have a column for each loss, and what tells ways to err."""
    one, zeros = Metric(0.0, "", 1, ""), torch.zeros(1, dtype=torch.float64)
    outcome = Outcome("key", "full", Case("room", "pan", 0), "", {"framing": one, "total": one}, 1)
    score = ClipScore("ours", "pan", {"framing": 0.0, "total": 0.0}, {"framing": 1, "total": 1}, 1)
    scores = Scores((Term("framing", "frame", 1.0, zeros),), zeros)
    report = ReportData("pan", zeros, scores, None, None, None, None, torch.zeros(1, 3, 2, 2, dtype=torch.uint8))
    tables = (metrics_csv(report), clips_csv([score]))
    heads = [name for table in tables for name in table.partition("\n")[0].split(",")]
    heads += ["framing_coverage", "jerk", "method", *values_table(summarise(["full"], [outcome])).header]
    return sorted(set(heads) - {"framing", *COST})


@pytest.mark.parametrize("name", columns())
def test_no_loss_is_called_as_another_column_is(name: str) -> None:
    with pytest.raises(ModelError) as caught:
        LOSSES.register(name)
    assert str(caught.value) == f"loss {name!r}: the name is that of another column; choose another"


def test_what_only_resembles_a_column_is_a_name_and_so_is_one_of_what_has_no_column() -> None:
    for name in ("defined", "frame_rate", "clip_length"):
        LOSSES.register(name)
    for registry in (EXTRACTORS, RENDERERS, SEARCHES):
        registry.register("frames")


def test_two_plugins_of_one_name_are_told_with_their_files(tmp_path: Path, own_loss: str) -> None:
    for name in ("a.py", "b.py"):
        (tmp_path / name).write_text(own_loss)
    with pytest.raises(ModelError) as caught:
        allow([tmp_path / "a.py", tmp_path / "b.py"])
    line = f"{tmp_path / 'b.py'}: loss 'mine': the name is taken by {tmp_path / 'a.py'}; choose another"
    assert str(caught.value) == line


CELL = (
    "from dataclasses import dataclass\nfrom cltransfer.registry import LOSSES\n"
    "@LOSSES.register('mine')\n@dataclass(frozen=True)\nclass Mine:\n    weight: float = {weight}\n"
    "    requires, unit, penalty = ('keypoints',), 'frame', 1.0\n    __call__ = print\n"
)


def test_a_cell_that_runs_twice_defines_its_loss_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("a_notebook")
    monkeypatch.setitem(sys.modules, "a_notebook", module)
    notebook = vars(module)
    for weight in (1.0, 2.0):
        exec(CELL.format(weight=weight), notebook)
        assert LOSSES.build("mine") == notebook["Mine"](weight)
    with pytest.raises(ModelError, match="the name is taken by a_notebook; choose another"):
        exec(CELL.replace("Mine", "Other").format(weight=1.0), notebook)
    assert LOSSES.get("mine") is notebook["Mine"]


def test_a_module_that_is_reloaded_defines_its_loss_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for weight in (1.0, 2.5):
        (tmp_path / "own_reloaded.py").write_text(CELL.format(weight=weight))
        importlib.invalidate_caches()
        module = sys.modules.get("own_reloaded")
        importlib.reload(module) if module else importlib.import_module("own_reloaded")
        assert LOSSES.build("mine").weight == weight
    del sys.modules["own_reloaded"]


FAILS = {
    "    def __post_init__(self):\n        assert self.weight < 5, 'heavy'\n": "it raised AssertionError: heavy",
    "    def __post_init__(self):\n        self.squared = self.weight**2\n": "it raised FrozenInstanceError",
    "    path: 'PurePath | None' = None\n": "it raised NameError: name 'PurePath' is not defined",
}


@pytest.mark.parametrize("more", FAILS)
def test_a_class_that_cannot_be_built_is_named(tmp_path: Path, own_loss: str, more: str) -> None:
    (tmp_path / "mine.py").write_text(own_loss + more)
    allow([tmp_path / "mine.py"])
    with pytest.raises(ModelError) as caught:
        LOSSES.build("mine", {"weight": 7.0})
    assert str(caught.value).startswith(f"loss 'mine': expected a component of these options, {FAILS[more]}")


def test_plugins_of_one_file_name_are_told_apart_and_tests_beside_them_are_none(tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "loss.py").write_text(
            "from __future__ import annotations\n"
            "from dataclasses import dataclass\nfrom typing import Literal as Only\n"
            "from cltransfer.registry import LOSSES\n"
            f'@LOSSES.register("{name}")\n@dataclass(frozen=True)\n'
            f'class Mine:\n    """A loss."""\n    kind: Only["{name}"] = "{name}"\n    weight: float = 1.0\n'
            '    requires, unit, penalty = ("depth",), "m", 1.0\n'
            "    def __call__(self, reference, rendered):\n        return rendered.depth.mean((1, 2))\n"
        )
    for beside in ("test_loss.py", "conftest.py"):
        (tmp_path / "first" / beside).write_text("raise RuntimeError('a test is no plugin')\n")
    both = [tmp_path / name / "loss.py" for name in ("first", "second")]
    assert len(allow([tmp_path / "first", *both])) == 2  # the first by its folder and by its name
    assert [LOSSES.build(name).kind for name in ("first", "second")] == ["first", "second"]
    assert code_of(LOSSES.build("first")) != code_of(LOSSES.build("second"))
    with pytest.raises(UsageError, match="first"):
        LOSSES.build("first", {"kind": "second"})


def test_what_a_plugin_has_registered_is_told_by_its_module_its_file_and_its_folder(mean_flow: tuple[str, ...]) -> None:
    here = Path(__file__).parents[1]
    module = LOSSES.get("mean_flow").__module__
    for plugin in (module, str(here / "conftest.py"), str(here)):
        assert "mean_flow" in LOSSES.given_by(plugin)
    for plugin in ("mean_flow", module[:-1], "framing", str(here / "plugins"), str(here.parent / "cltransfer")):
        assert LOSSES.given_by(plugin) == []
