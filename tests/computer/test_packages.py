"""A package is there by whichever distribution it was installed from; a run notes which."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from cltransfer.computer.packages import PACKAGES, installed, versions
from cltransfer.storage.run_files import DONE, MANIFEST

TINY = ("frames=3", "generations=2", "output_side=96", "search_side=48")


@pytest.fixture
def gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after ``pip uninstall onnxruntime; pip install onnxruntime-gpu``."""
    _only(monkeypatch, "onnxruntime-gpu")


def _only(monkeypatch: pytest.MonkeyPatch, *there: str) -> None:
    real = metadata.version

    def version(name: str) -> str:
        if name.startswith("onnxruntime"):
            if name not in there:
                raise metadata.PackageNotFoundError(name)
            return "9.8.7"
        return real(name)

    monkeypatch.setattr(metadata, "version", version)


def test_any_distribution_will_do(gpu: None) -> None:
    assert installed("onnxruntime") == ("onnxruntime-gpu", "9.8.7")
    assert len(versions()) == len(PACKAGES)


def test_without_a_distribution_the_module_says_and_what_is_not_there_is_null(monkeypatch: pytest.MonkeyPatch) -> None:
    import onnxruntime

    _only(monkeypatch)
    assert installed("onnxruntime") == ("onnxruntime", onnxruntime.__version__)
    monkeypatch.setitem(PACKAGES, "onnxruntime", ("no_such_module", "onnxruntime"))
    assert versions()["onnxruntime"] is None


@pytest.mark.slow  # processes
def test_a_run_ends_and_doctor_is_content_whatever_brought_onnxruntime(
    gpu: None, command: Callable[..., Any], tmp_path: Path
) -> None:
    answer = command("transfer", "--quiet", "--out", tmp_path / "run", *TINY)
    assert (answer.code, (tmp_path / "run" / DONE).is_file()) == (0, True), answer.err
    assert json.loads((tmp_path / "run" / MANIFEST).read_text())["packages"]["onnxruntime-gpu"] == "9.8.7"
    answer = command("doctor")
    assert answer.code == 0
    assert "9.8.7, of onnxruntime-gpu" in answer.out
