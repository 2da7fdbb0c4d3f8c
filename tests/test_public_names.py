"""The names of ``cltransfer`` are what the documentation says, in whatever order modules were imported before."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch

import cltransfer
from cltransfer import registry
from cltransfer.features import SHAPES
from cltransfer.skeleton import key_joints

ROOT = Path(__file__).resolve().parents[1]
NAMES = "from cltransfer import transfer, evaluate"
MODULES = "import cltransfer.transfer, cltransfer.evaluate"
LOOP = "assert (Components.__name__, clip_features.__name__) == ('Components', 'clip_features')"
FUNCTIONS = "assert type(transfer) is type(evaluate) is type(lambda: 0), (transfer, evaluate)"
SAME = "assert cltransfer.transfer is cltransfer.transfer is sys.modules['cltransfer.transfer'].transfer"
ORDERS = {
    "names alone": [NAMES, FUNCTIONS],
    "modules first": [MODULES, NAMES, FUNCTIONS],
    "names first": [NAMES, MODULES, NAMES, FUNCTIONS],
    "from the modules": ["from cltransfer.transfer import Inputs", NAMES, FUNCTIONS],
    "as attributes": ["import cltransfer", SAME, "from cltransfer import *", FUNCTIONS, LOOP],
    "plugins": ["import cltransfer", "assert cltransfer.plugins.allow([]) == []"],
    "pickled": [NAMES, "assert pickle.loads(pickle.dumps(transfer)) is transfer"],
}


EACH = """
from multiprocessing import get_context
import cv2, kornia, numba, onnxruntime, scipy.optimize, torch  # what takes long to import, once
for name, lines in ORDERS.items():
    own = get_context("fork").Process(target=exec, args=("import sys, pickle; " + "; ".join(lines), {}))
    own.start()
    own.join()
    print(name, own.exitcode)
"""


def there(name: str) -> bool:
    """Whether ``name``, in full, is that of a module or of something in one."""
    try:
        pkgutil.resolve_name(name)
    except (ImportError, AttributeError):
        return False
    return True


def test_what_docstrings_and_pages_name_in_full_is_there() -> None:
    told = {
        r":\w+:`~?(cltransfer(?:\.\w+)+)`": [*ROOT.glob("cltransfer/**/*.py"), *ROOT.glob("plugins/*.py")],
        r"\b(cltransfer(?:\.[a-zA-Z_]\w*)+)": [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("plugins/*.md")],
    }
    for pattern, files in told.items():
        named = {name: path for path in files for name in re.findall(pattern, path.read_text(encoding="utf-8"))}
        assert len(named) > 5
        assert {name: str(path) for name, path in named.items() if not there(name)} == {}
    assert not there("cltransfer.losses.depth_mode")


def python(*code: str) -> subprocess.CompletedProcess[str]:
    """Lines of code in a process of its own, where nothing is imported yet."""
    line = "\n".join(["import sys", *code])
    command = [sys.executable, "-W", "error::ImportWarning", "-c", line]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT)


def test_the_functions_of_tensors_that_the_docs_name_are_there() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    text = page.partition("| in `cltransfer.losses` |")[2]
    named = re.findall(r"`(\w+)\.(\w+)`", text.partition("\n\n")[0])
    assert len(named) == 5
    for module, function in named:
        formula = getattr(importlib.import_module(f"cltransfer.losses.{module}"), function)
        assert list(inspect.signature(formula).parameters)[:2] == ["reference", "rendered"]


def test_the_joints_that_the_docs_name_are_the_keypoints_of_features() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8").partition("## Features\n")[2]
    ((name, module),) = re.findall(r"the 14 are `(\w+)` of `([\w.]+)`, in that order", page)
    joints = getattr(importlib.import_module(module), name)
    assert (len(joints), 3) == SHAPES["keypoints"]
    keypoints = torch.arange(14 * 3.0).reshape(14, 3)
    assert torch.equal(key_joints(keypoints)[0], keypoints[joints.index("head_top")])


def test_transfer_and_evaluate_are_the_functions() -> None:
    """In a process for each order, that none of the project was imported in."""
    done = python(f"{ORDERS=}", EACH)
    assert (done.stdout, done.stderr) == ("".join(f"{order} 0\n" for order in ORDERS), "")


def test_every_registry_is_among_the_names_and_in_the_tutorial() -> None:
    page = (ROOT / "plugins" / "README.md").read_text(encoding="utf-8")
    names = {name for name, value in vars(registry).items() if isinstance(value, registry.Registry)}
    assert len(names) == 5
    assert names <= set(cltransfer.__all__)
    assert [name for name in names if f"`{name}`" not in page and f"@{name}." not in page] == []
    assert cltransfer.FITTERS is registry.FITTERS


def test_a_type_checker_knows_every_public_name_from_its_home() -> None:
    """With ``as``, or it takes a name for no public one; loaded on first use alone each is Any to it."""
    tree = ast.parse((ROOT / "cltransfer" / "__init__.py").read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    lines = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    told = {alias.asname: node.module for node in lines for alias in node.names if alias.asname == alias.name}
    assert told == cltransfer._HOME


def test_what_a_loop_of_ones_own_needs_is_there_and_nothing_is_loaded_before() -> None:
    names = {"Inputs", "Components", "clip_features", "camera_language_metrics", "Features", "LOSSES", "load_config"}
    done = python(
        f"import cltransfer; assert {names} <= set(cltransfer.__all__) & set(dir(cltransfer))",
        "assert 'torch' not in sys.modules; print('there')",
    )
    assert (done.stdout, done.stderr) == ("there\n", "")


def test_the_transfer_that_the_docs_show_leaves_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    snippet = page.partition("## A transfer\n\n```python\n")[2].partition("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(snippet, {})
    assert (tmp_path / "run" / "report.html").is_file()
    assert (tmp_path / "run" / "DONE").is_file()
