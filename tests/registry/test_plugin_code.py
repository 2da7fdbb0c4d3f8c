"""What a plugin's answers are known again by: its code, wherever in its package it stands."""

from __future__ import annotations

import hashlib
import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from cltransfer.plugins import allow
from cltransfer.registry import LOSSES
from cltransfer.registry.plugin_code import code_of

CELL = """
from dataclasses import dataclass
from functools import cache
from cltransfer.registry import LOSSES
SCALES, SHIFT = [1.0, 2.0], 0.5

def shifted(x):
    return x + SHIFT

@cache
def scaled(x):
    return [shifted(x * scale) for scale in SCALES if str(scale) in {"0.0", "1.0", "2.0"}]

class Usual:
    requires, unit, penalty = ("image",), "", 1.0

    @property
    def twice(self):
        return 2

@LOSSES.register("mine")
@dataclass(frozen=True)
class Mine(Usual):
    weight: float = 1.0

    def __call__(self, reference, rendered, power=1):
        return scaled(rendered.image.mean()) ** power * self.twice
"""


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """The loss that a test registers is forgotten after it."""
    yield
    LOSSES._classes.pop("mine", None)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own_loss: str) -> Iterator[Path]:
    """An installed package whose loss stands in one of its modules and takes its formula from another."""
    for name in ("", "losses", "maths"):
        (tmp_path / "own_plugins" / name).mkdir()
        (tmp_path / "own_plugins" / name / "__init__.py").touch()
    (tmp_path / "own_plugins" / "losses" / "mine.py").write_text(f"from ..maths import formula\n{own_loss}")
    (tmp_path / "own_plugins" / "maths" / "formula.py").write_text("SCALE = 1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / "own_plugins"
    for name in [name for name in sys.modules if name.partition(".")[0] == "own_plugins"]:
        del sys.modules[name]


def again() -> str:
    """The code of the loss when its module is run once more."""
    importlib.reload(importlib.import_module("own_plugins.losses.mine"))
    return code_of(LOSSES.build("mine"))


def test_the_code_of_a_plugin_is_all_of_its_package(package: Path) -> None:
    seen = [again()]
    mine = (package / "losses/mine.py").read_text() + "# edited"
    for file, text in (("losses/mine.py", mine), ("maths/formula.py", "SCALE = 2.0\n"), ("new.py", "")):
        assert again() == seen[-1]
        (package / file).write_text(text)
        assert code_of(LOSSES.build("mine")) == seen[-1]  # it is what was imported that answers
        seen.append(again())
    assert len(set(seen)) == 4
    (package / "notes.txt").touch()
    (package.parent / "beside.py").touch()
    assert again() == seen[-1]
    (package / "new.py").rename(package / "newer.py")
    assert again() != seen[-1]


@pytest.mark.parametrize("without", ["", "losses", "maths"])
def test_a_package_without_an_init_file_is_a_package(package: Path, without: str) -> None:
    (package / without / "__init__.py").unlink()
    seen = [again()]
    (package / "maths/formula.py").write_text("SCALE = 2.0\n")
    seen.append(again())
    (package / "env/lib/site-packages").mkdir(parents=True)
    (package / "env/lib/site-packages/of_others.py").touch()  # an environment that was made in it
    (package.parent / "beside.py").touch()
    assert seen[0] != seen[1] == again()


def test_the_code_of_a_plugin_is_that_of_the_classes_it_is_derived_from_too(
    package: Path, monkeypatch: pytest.MonkeyPatch, own_loss: str
) -> None:
    base = package.parent / "own_base.py"
    base.write_text("class Base:\n    scale = 1.0\n")
    mine = f"from own_base import Base\n{own_loss.replace('class Mine:', 'class Mine(Base):')}"
    (package / "losses/mine.py").write_text(mine)
    alone, seen = code_of(type("Alone", (), {"__module__": "own_plugins.losses"})), [again()]
    base.write_text("class Base:\n    scale = 2.0\n")
    seen.append(again())  # derived from what was imported before it was edited
    del sys.modules["own_base"]
    importlib.invalidate_caches()
    seen.append(again())
    monkeypatch.delitem(sys.modules, "own_base")
    assert seen[0] == seen[1] != seen[2]
    assert alone not in seen


def test_what_an_editor_leaves_in_a_package_is_no_code(package: Path) -> None:
    whole = again()
    (package / ".#mine.py").symlink_to("nobody@nowhere.1")  # Emacs' lock, which leads nowhere
    (package / "data.py").mkdir()
    (package / ".venv").mkdir()
    (package / ".venv" / "other.py").touch()
    assert again() == whole


def test_the_code_of_a_plugin_that_is_no_part_of_a_package_is_its_file(tmp_path: Path, own_loss: str) -> None:
    (tmp_path / "mine.py").write_text(own_loss)
    allow([tmp_path])
    alone = code_of(LOSSES.build("mine"))
    assert alone == hashlib.sha256(own_loss.encode()).hexdigest()
    (tmp_path / "other.py").touch()
    LOSSES._classes.pop("mine")
    allow([tmp_path / "mine.py"])
    assert code_of(LOSSES.build("mine")) == alone
    (tmp_path / "__init__.py").touch()
    LOSSES._classes.pop("mine")
    allow([tmp_path / "mine.py"])
    assert code_of(LOSSES.build("mine")) != alone


def test_a_plugin_that_is_edited_while_it_is_in_use_is_known_by_what_was_imported(
    tmp_path: Path, own_loss: str
) -> None:
    (tmp_path / "mine.py").write_text(own_loss)
    allow([tmp_path / "mine.py"])
    before = code_of(LOSSES.build("mine"))
    (tmp_path / "mine.py").unlink()
    assert code_of(LOSSES.build("mine")) == before
    (tmp_path / "mine.py").write_text(f"{own_loss}# edited\n")
    assert code_of(LOSSES.build("mine")) == before
    allow([tmp_path / "mine.py"])
    assert code_of(LOSSES.build("mine")) != before


@pytest.mark.parametrize(
    "edit",
    [
        ("2.0]", "3.0]"),
        ("SHIFT = [1.0, 2.0], 0.5", "SHIFT = [1.0, 2.0], 1"),
        ("x + SHIFT", "x - SHIFT"),
        ('{"0.0", ', "{"),
        ("return 2", "return 3"),
        ("power=1", "power=2"),
        ("** power", "* power"),
    ],
)
def test_a_loss_of_a_notebook_is_known_by_what_its_functions_do(
    monkeypatch: pytest.MonkeyPatch, edit: tuple[str, str]
) -> None:
    monkeypatch.setitem(sys.modules, "a_notebook", ModuleType("a_notebook"))
    seen = []
    for cell in (CELL, CELL.replace(*edit), f"\n# moved\n{CELL}"):
        exec(cell, vars(sys.modules["a_notebook"]))
        seen.append(code_of(LOSSES.build("mine")))
    assert seen[0] == seen[2] != seen[1]


def test_the_code_of_a_notebook_is_the_same_in_every_process() -> None:
    told = f"{CELL}\nfrom cltransfer.registry.plugin_code import code_of\nprint(code_of(Mine))"
    seen = set()
    for seed in ("1", "2", "3"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True, env=environment)
        seen.add(done.stdout)
    assert len(seen) == 1
    assert len(seen.pop()) == 65
