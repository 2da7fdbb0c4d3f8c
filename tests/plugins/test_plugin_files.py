"""Plugins of several files: a folder is a package, and nothing beside what was named runs."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cltransfer.errors import ModelError
from cltransfer.plugins import allow
from cltransfer.registry import LOSSES, SEARCHES
from cltransfer.registry.plugin_code import code_of


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """The loss that a test registers is forgotten after it."""
    yield
    LOSSES._classes.pop("mine", None)


@pytest.fixture
def package(tmp_path: Path, own_loss: str) -> Path:
    """A folder in a package, with a loss that takes its weight from another file."""
    folder = tmp_path / "outer" / "mine"
    folder.mkdir(parents=True)
    (folder.parent / "__init__.py").write_text("raise RuntimeError('it lies beside what was named')\n")
    (folder / "__init__.py").write_text("from .loss import Mine\n")
    (folder / "tools.py").write_text("W = 3.0\n")
    (folder / "loss.py").write_text(f"from .tools import W\n{own_loss.replace('float = 1.0', 'float = W')}")
    return folder


def test_a_folder_that_is_a_package_imports_from_itself_and_runs_once(package: Path) -> None:
    assert allow([package / "loss.py", package]) == [str(package / f"{n}.py") for n in ("__init__", "loss", "tools")]
    mine = LOSSES.build("mine")
    assert mine.weight == 3
    before = code_of(mine)
    assert len(allow([package])) == 3
    assert LOSSES.get("mine") is type(mine)
    (package / "tools.py").write_text("W = 4.25\n")
    assert code_of(mine) == before  # it is what was imported that answers
    allow([package])
    assert LOSSES.build("mine").weight == 4.25
    assert code_of(LOSSES.build("mine")) != before


def test_a_file_of_a_package_is_refused_with_what_to_name(package: Path, own_loss: str) -> None:
    with pytest.raises(ModelError) as caught:
        allow([package / "loss.py"])
    assert "attempted relative import with no known parent package (name the folder" in str(caught.value)
    assert str(caught.value).endswith(f"--allow-plugin {package})")
    (package / "loss.py").write_text(f"from ..tools import W\n{own_loss}")
    with pytest.raises(ModelError, match=f"beyond top-level package .*--allow-plugin {package.parent}\\)$"):
        allow([package])
    (package / "__init__.py").unlink()
    (package / "loss.py").write_text("from .tools import W\n")
    with pytest.raises(ModelError, match=f"write an empty __init__.py beside it and .*--allow-plugin {package}\\)$"):
        allow([package])
    strange = package.rename(package.with_name("$(mine)"))
    with pytest.raises(ModelError) as caught:
        allow([strange / "loss.py"])
    assert str(caught.value).endswith(f"--allow-plugin '{strange}')")


@pytest.mark.parametrize(
    ("right", "wrong", "line"),
    [
        ('"mine"', '"Head-room"', "loss 'Head-room': expected small letters, digits and _"),
        ('"mine"', '"framing"', "loss 'framing': the name is taken"),
        ("(frozen=True)", "", "loss 'mine': expected @dataclass(frozen=True)"),
        ("    __call__ = print\n", "", "loss 'mine': class Mine has no "),
    ],
)
def test_a_component_that_is_refused_is_told_with_its_file(
    package: Path, tmp_path: Path, own_loss: str, right: str, wrong: str, line: str
) -> None:
    (tmp_path / "lone.py").write_text(own_loss.replace(right, wrong))
    (package / "loss.py").write_text(own_loss.replace(right, wrong))
    for named, file in ((tmp_path / "lone.py", tmp_path / "lone.py"), (package, package / "loss.py")):
        with pytest.raises(ModelError) as caught:
            allow([named])
        assert str(caught.value).startswith(f"{file}: {line}")
        assert "mine" not in LOSSES.names()


def announced(folder: Path, plugin: str, package: str, version: str) -> None:
    """Write what pip leaves in ``folder`` of an installed package that announces its own module as ``plugin``."""
    info = folder / f"{package}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(f"[cltransfer.plugins]\n{plugin} = {package}\n")


def test_a_name_that_two_installed_packages_announce_runs_neither(
    tmp_path: Path, own_loss: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package, version in (("cl_two", "2.0"), ("cl_one", "1.0")):
        announced(tmp_path, "twice", package, version)
        (tmp_path / f"{package}.py").write_text(own_loss)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModelError) as caught:
        allow(["twice"])
    told = "expected one installed plugin of this name, it is announced by cl_one 1.0 and cl_two 2.0 (uninstall the "
    assert str(caught.value).startswith(f"twice: --allow-plugin: {told}")
    assert not {"cl_one", "cl_two"} & sys.modules.keys()


def test_a_component_of_an_installed_plugin_that_is_refused_is_told_with_its_module(
    tmp_path: Path, own_loss: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    announced(tmp_path, "refused", "cl_refused", "1.2")
    (tmp_path / "cl_refused.py").write_text(own_loss.replace('"mine"', '"framing"'))
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModelError, match=r"^cl_refused: loss 'framing': the name is taken; choose another$"):
        allow(["refused"])


def test_an_installed_plugin_that_was_edited_goes_on_as_it_was_imported_and_is_told(
    tmp_path: Path, own_loss: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    announced(tmp_path, "kept", "cl_kept", "1.0")
    (tmp_path / "cl_kept.py").write_text(own_loss)
    monkeypatch.syspath_prepend(tmp_path)
    for _ in range(2):
        allow(["kept"])
    assert not caplog.messages
    mine = LOSSES.get("mine")
    (tmp_path / "cl_kept.py").write_text(f"{own_loss}# edited\n")
    allow(["kept"])
    assert caplog.messages == ["kept: was edited since it was imported, which stays: restart the kernel or worker"]
    assert LOSSES.get("mine") is mine
    del sys.modules["cl_kept"]


def test_a_package_that_failed_is_imported_whole_when_it_is_mended(package: Path) -> None:
    tools = (package / "tools.py").read_text()
    (package / "tools.py").write_text("V = 3.0\n")
    with pytest.raises(ModelError, match="failed at import, line 1: ImportError: cannot import name 'W'"):
        allow([package])
    (package / "tools.py").write_text(f"{tools}# mended\n")
    allow([package])
    assert LOSSES.build("mine").weight == 3


def test_what_a_plugin_registered_before_it_failed_is_forgotten(tmp_path: Path, own_loss: str) -> None:
    file = tmp_path / "mine.py"
    file.write_text(f"{own_loss}\n1 / 0\n")
    with pytest.raises(ModelError, match=r"failed at import, line \d+: ZeroDivisionError"):
        allow([file])
    assert "mine" not in LOSSES.names()
    file.write_text(own_loss)
    allow([file])
    assert "mine" in LOSSES.names()
    file.write_text("")
    allow([file])
    assert "mine" not in LOSSES.names()


def test_the_same_file_is_imported_once_a_process_and_again_when_it_was_edited(tmp_path: Path, own_loss: str) -> None:
    (tmp_path / "mine.py").write_text(own_loss)
    first = allow([tmp_path / "mine.py"])
    mine = LOSSES.get("mine")
    assert allow([tmp_path]) == first
    assert LOSSES.get("mine") is mine
    (tmp_path / "mine.py").write_text(f"{own_loss}# edited\n")
    assert allow([tmp_path / "mine.py"]) == first
    assert LOSSES.get("mine") is not mine


def test_a_file_that_registers_nothing_runs_once_too_until_it_is_edited(tmp_path: Path, own_loss: str) -> None:
    """It lies beside a plugin in a folder that is no package."""
    folder, runs = tmp_path / "plugins", tmp_path / "runs"
    folder.mkdir()
    (folder / "mine.py").write_text(own_loss)
    count = f"with open({str(runs)!r}, 'a') as stream:\n    stream.write('1')\n"
    (folder / "numbers.py").write_text(count)
    for _ in range(3):
        assert allow([folder]) == [str(folder / "mine.py"), str(folder / "numbers.py")]
    assert runs.read_text() == "1"
    (folder / "numbers.py").write_text(f"{count}# edited\n")
    allow([folder])
    assert runs.read_text() == "11"
    (folder / "numbers.py").write_text(f"{count}{own_loss.replace('mine', 'other')}")
    allow([folder])
    assert "other" in LOSSES.names()
    LOSSES.forget(LOSSES.get("other").__module__)
    allow([folder])
    assert "other" in LOSSES.names()
    LOSSES.forget(LOSSES.get("other").__module__)


def test_a_file_that_was_imported_is_allowed_too(
    tmp_path: Path, own_loss: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own_imported.py").write_text(own_loss)
    monkeypatch.syspath_prepend(tmp_path)
    mine = importlib.import_module("own_imported").Mine
    assert LOSSES.get("mine") is mine
    allow([tmp_path / "own_imported.py"])
    assert LOSSES.get("mine") is not mine
    del sys.modules["own_imported"]


@pytest.mark.parametrize("names", [[""], [" "], [Path("none.py")], "none.py"])
def test_nothing_runs_where_nothing_that_is_there_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: str | list[str | Path]
) -> None:
    (tmp_path / "bystander.py").write_text("raise SystemExit('ran')")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelError, match=r"expected a plugin's name|^none\.py: "):
        allow(names)


SEARCH = """
from dataclasses import dataclass
from cltransfer.registry import SEARCHES
from cltransfer.search.subject_orbit import SubjectOrbit

@SEARCHES.register("mine")
@dataclass(frozen=True)
class Mine(SubjectOrbit):
    def cameras(self, x, home, subject):
        raise KeyError("x")
"""


def test_a_search_of_a_plugin_that_fails_is_not_our_fault(command: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(SEARCH)
    small = ["frames=2", "search_side=32", "output_side=48", "preset=fast", "search.mine={}"]
    plugin = ["--allow-plugin", tmp_path / "mine.py", "--out", tmp_path / "run", "-q"]
    try:
        answer = command("transfer", "builtin:courtyard", "builtin:orbit", *small, *plugin)
    finally:
        SEARCHES._classes.pop("mine", None)
    assert (answer.code, answer.err.strip()) == (
        4,
        "error: KeyError: 'x' (a fault of the plugin mine.py; CLTRANSFER_DEBUG=1 shows where)",
    )


def test_a_private_file_of_a_folder_is_not_run(tmp_path: Path) -> None:
    (tmp_path / "_half.py").write_text("raise SystemExit('was run')")
    (tmp_path / "mine.py").write_text("")
    assert allow([str(tmp_path)]) == [str(tmp_path / "mine.py")]
