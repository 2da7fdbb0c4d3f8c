"""Verbs on a scene take the keys that they look at, and no others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


@pytest.mark.parametrize("key", ["frames=12", "losses.framing=null", "output_side=33"])
def test_a_lift_refuses_a_key_that_changes_nothing_of_it(command: Callable[..., Any], key: str) -> None:
    named = key.partition("=")[0].partition(".")[0]
    refused = command("lift", "missing.ply", key)
    reason = "changes nothing of a lift, expected a key that it looks at"
    hint = "renderer, extractors, threads, preset; --views for how many are looked from"
    assert (refused.code, refused.err) == (2, f"error: {named}: {reason} ({hint})\n")


def test_a_lift_takes_the_keys_that_it_looks_at(command: Callable[..., Any]) -> None:
    words = ("renderer.mesh={}", "extractors.pose_blazepose.model=a.onnx", "threads=1", "preset=fast")
    assert "missing.ply: no such file" in command("lift", "missing.ply", *words).err
