"""A doctor looks at everything, whatever the first thing is that it finds broken."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import onnxruntime
import pytest

from cltransfer import doctor


@pytest.mark.parametrize(
    "module", ["cltransfer.extractors.detect_yolox", "cltransfer.models.onnx", "cltransfer.computer.threads"]
)
def test_a_part_that_cannot_be_loaded_is_one_line_of_the_table(
    command: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)  # as where it imports torch or cv2, and that is missing
    answer = command("doctor", "--json")
    assert answer.err == ""
    found = {finding["what"]: finding for finding in json.loads(answer.out)}
    assert {"cltransfer", "torch", "video codecs", "CUDA"} <= set(found)
    assert any(module in finding["says"] for finding in found.values() if not finding["ok"])
    assert answer.code == 4


def test_a_network_that_every_command_would_refuse_is_not_ok(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    (tmp_path / "yolox_nano.onnx").write_bytes(b"x")  # as a download by hand that broke off
    found = {finding.what: finding for finding in doctor._models()}
    damaged, missing = found["yolox_nano.onnx"], found["mp_pose_landmark_lite.onnx"]
    assert (damaged.ok, missing.ok) == (False, False)
    assert "yolox_nano.onnx: sha256: expected " in damaged.says
    assert "no such file" in missing.says


@pytest.mark.needs("models/yolox_nano.onnx")
def test_a_network_that_can_be_run_is_ok_and_says_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    models = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "models"
    monkeypatch.setenv("CLTRANSFER_MODELS", str(models))
    assert [(finding.ok, finding.says) for finding in doctor._models()] == [
        (True, str(models / name)) for name in ("yolox_nano.onnx", "mp_pose_landmark_lite.onnx")
    ]


@pytest.mark.skipif("CUDAExecutionProvider" in onnxruntime.get_available_providers(), reason="onnxruntime has CUDA")
def test_a_build_for_cuda_whose_driver_is_missing_is_not_ok(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor._providers() == "CPU"
    listed = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: listed)
    found = doctor._try("networks run on", doctor._providers)
    assert not found.ok
    assert "CUDA: did not start (CLTRANSFER_NETWORKS=cpu runs it on the CPU)" in found.says
