"""What the cache holds is counted, and thrown away by kind and nothing else."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cltransfer
from cltransfer.cli.cache import app
from cltransfer.errors import InputError, UsageError
from cltransfer.reading.named_scenes import recall, remember
from cltransfer.storage.cache import KINDS, MADE, NOTED, clear, held


@pytest.fixture
def cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    for name in (
        "features/a.safetensors",
        "features/b.safetensors",
        "lifts/x/subject.json",
        "models/yolox.onnx",
        "pins.json",
    ):
        file = tmp_path / "cache" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"12345")
    return tmp_path / "cache"


def test_each_kind_is_counted(cached: Path) -> None:
    counts = {row.kind: (row.files, row.size) for row in held()}
    assert counts == {
        **dict.fromkeys(KINDS, (0, 0)), "features": (2, 10), "lifts": (1, 5), "models": (1, 5),
    }  # fmt: skip


def test_what_a_run_makes_again_goes_and_what_was_pulled_stays(cached: Path) -> None:
    assert sum(row.files for row in clear()) == 3
    assert sorted(str(file.relative_to(cached)) for file in cached.rglob("*") if file.is_file()) == [
        "models/yolox.onnx", "pins.json",
    ]  # fmt: skip
    assert sum(row.files for row in clear()) == 0


def test_where_a_scene_lies_is_forgotten_only_by_name(cached: Path) -> None:
    remember("ab12", "builtin:courtyard")
    clear()
    assert recall("ab12") == "builtin:courtyard"
    clear(["scenes"])
    with pytest.raises(InputError, match=r"\(name it: --scene FILE or builtin:NAME\)"):
        recall("ab12")


def test_one_kind_is_thrown_away_by_its_name(cached: Path) -> None:
    clear(["models"])
    assert not (cached / "models").exists()
    assert (cached / "features" / "a.safetensors").is_file()
    with pytest.raises(UsageError, match=r"\.\./\.\.: expected a kind .* \(features, lifts, "):
        clear(["../.."])


def test_nothing_is_deleted_through_a_link(cached: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "work.txt").write_text("mine")
    (cached / "scenes").symlink_to(tmp_path / "mine")
    (cached / "features" / "link").symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="scenes: is a link"):
        clear(["scenes"])
    clear(["features"])
    assert (tmp_path / "mine" / "work.txt").read_text() == "mine"


def test_every_folder_that_is_written_is_of_a_kind() -> None:
    named = set()
    for file in Path(cltransfer.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div) and ast.unparse(node.left) == "cache_dir()":
                named.add(
                    ast.literal_eval(node.right) if isinstance(node.right, ast.Constant) else ast.unparse(node.right)
                )
    assert named == {
        *MADE,
        *NOTED,
        "models",
        "pins.json",
        "f'{self.kind}s'",
        "f'{self.path.name}.part.lock'",
        "kind",
        "row.kind",
    }


def test_the_verbs(cached: Path) -> None:
    said = CliRunner().invoke(app, ["list"])
    assert said.exit_code == 0
    assert said.stdout.splitlines()[:2] == [
        str(cached),
        "features        2 files       0.0 MB  clips as they were read",
    ]
    assert json.loads(CliRunner().invoke(app, ["list", "--json"]).stdout)["kinds"][0]["files"] == 2
    assert CliRunner().invoke(app, ["clear", "lifts"]).stdout == "1 files, 0.0 MB thrown away\n"
    assert (cached / "features").is_dir()
