"""The tutorial runs as it is written: its loss, its test and the names it promises."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.plugins import allow
from cltransfer.registry import LOSSES
from cltransfer.testing import sample_features

README = Path(__file__).resolve().parents[2] / "plugins" / "README.md"
PLUGIN, TEST = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "headroom.py").write_text(PLUGIN)
    (tmp_path / "test_headroom.py").write_text(TEST)
    return tmp_path


def test_tutorial_loss_measures_the_room_above_the_head(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LOSSES, "_classes", dict(LOSSES._classes))
    allow([folder / "headroom.py"])
    features = sample_features(1, 2)
    lower = replace(features, keypoints=features.keypoints + torch.tensor([0, 0.25 * features.size[1], 0]))
    value = LOSSES.build("headroom", {"weight": 20.0})(features, lower)
    torch.testing.assert_close(value, torch.full((2,), 0.25, dtype=value.dtype))


def test_tutorial_test_passes_the_contract(folder: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rootdir", str(folder), "test_headroom.py"]
    home = os.pathsep.join([str(folder), str(README.parents[1])])
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": home}, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stdout
    assert re.search(r"\b10 passed", done.stdout)


def test_tutorial_fits_on_a_page() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 80
