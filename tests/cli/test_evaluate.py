"""How clips and methods are named for `evaluate`, and what is said of those that it cannot take."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cltransfer.cli.evaluate import methods_of
from cltransfer.clips.clip import write_video
from cltransfer.errors import UsageError


@pytest.fixture
def clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a folder ``refs`` of two clips, and ``ours`` of one, in which the test works."""
    for name in ("refs/a", "refs/b", "ours/a"):
        image = torch.zeros(2, 3, 16, 16, dtype=torch.uint8)
        write_video(tmp_path / f"{name}.mkv", image, torch.arange(2).double() / 8, lossless=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", ["", " ", "\t"])
def test_a_method_without_a_name_is_refused(clips: Path, name: str) -> None:
    for words in ([f"{name}=ours"], ["ours", f"{name}=refs"]):
        with pytest.raises(UsageError, match=r"=(ours|refs): expected the name of a method before the ="):
            methods_of("refs", words[0], words[1:])
