"""Names of files that are no UTF-8, and a terminal that knows few letters, break nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.clips.clip import write_video
from cltransfer.features import Features
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.storage.files import content_hash, write_text

LATIN = os.fsdecode(b"wom\xe9n")
TINY = ("frames=2", "output_side=96")
BOTH = """
import sys
from cltransfer.cli.app import main
said = sys.argv[1:]
while said:
    sys.argv[1:], said = said[: said.index("end")], said[said.index("end") + 1 :]
    try:
        main()
    except SystemExit as end:
        assert not end.code, sys.argv
print("both")
"""


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """A clip by a name that is no UTF-8."""
    generator = torch.Generator().manual_seed(0)
    write_video(tmp_path / "a.mp4", torch.randint(0, 255, (4, 3, 36, 64), generator=generator).byte(), torch.arange(4))
    return (tmp_path / "a.mp4").rename(tmp_path / f"{LATIN}.mp4")


def test_text_and_hashes_and_features_hold_any_name(tmp_path: Path) -> None:
    write_text(tmp_path / "page.html", f"<h1>{LATIN} ü</h1>")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "<h1>wom\\udce9n ü</h1>"
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / f"{LATIN}.png").touch()
    assert len(content_hash(tmp_path / "frames")) == 64
    features = Features((8, 4), keypoints=torch.rand(1, 14, 3))
    FeatureFile(features, torch.zeros(1), f"{LATIN}.mp4").save(tmp_path / "a.safetensors")
    assert FeatureFile.load(tmp_path / "a.safetensors").origin == "wom\\udce9n.mp4"


def test_a_study_of_a_clip_by_any_name_has_its_key(clip: Path, fresh: Callable[..., Any], tmp_path: Path) -> None:
    page = tmp_path / LATIN
    write_video(tmp_path / "b.mp4", torch.zeros(4, 3, 36, 64, dtype=torch.uint8), torch.arange(4))
    answer = fresh("study", clip, tmp_path / "b.mp4", "--reference", clip, "--out", page)
    assert answer.code == 0, answer.err
    assert (page / "README.txt").is_file()
    assert str(clip) in json.loads((tmp_path / f"{LATIN}.key.json").read_text())["runs"][0].values()
    assert "wom\\udce9n" in answer.out


@pytest.mark.slow  # a process; inspections and studies under such names run by default
def test_a_run_and_an_inspection_may_lie_under_any_name(cache: Path, tmp_path: Path) -> None:
    """OpenCV ends the interpreter when it is given such a name: so in one of its own, that both share."""
    run, page = tmp_path / LATIN / "run", tmp_path / LATIN / "page"
    words = (
        ("transfer", "--out", str(run), "preset=fast", "search_side=48"),
        ("inspect", "builtin:static", "--out", str(page)),
    )
    done = subprocess.run(
        [sys.executable, "-c", BOTH, *(word for verb in words for word in (*verb, "--quiet", *TINY, "end"))],
        env={**os.environ, "CLTRANSFER_CACHE": str(cache)},
        capture_output=True,
        timeout=120,
    )
    assert (done.returncode, done.stdout.split()[-1:]) == (0, [b"both"]), done.stderr
    assert (run / "DONE").is_file()
    assert (run / "strip.jpg").read_bytes()[:2] == b"\xff\xd8"
    assert (page / "frames" / "0000.png").read_bytes()[1:4] == b"PNG"


def test_what_a_narrow_terminal_cannot_show_is_escaped(fresh: Callable[..., Any]) -> None:
    network = "extractors={depth_onnx: {model: dír.onnx, kind: disparity}}"
    answer = fresh("transfer", network, "--print-config", PYTHONIOENCODING="ascii")
    assert answer.code == 0, answer.err
    assert "model: d\\xedr.onnx" in answer.out
