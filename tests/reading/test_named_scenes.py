"""What this computer remembers of scenes helps later, and costs nothing that is finished."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.errors import InputError
from cltransfer.reading.named_scenes import recall, remember


def test_a_scene_is_recalled_by_its_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    remember("ab12", str(tmp_path / "scene.ply"))
    assert recall("ab12") == str(tmp_path / "scene.ply")
    with pytest.raises(InputError, match="has not seen the scene"):
        recall("ab13")


def test_a_cache_that_cannot_be_written_is_told_and_loses_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "cache").write_text("a file where the folder should be")
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    remember("ab12", "builtin:courtyard")
    (line,) = caplog.messages
    assert "ab12.json" in line
    assert "a later render needs --scene builtin:courtyard" in line
