"""A doctor looks at everything, whatever the first thing is that it finds broken."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

import pytest


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
