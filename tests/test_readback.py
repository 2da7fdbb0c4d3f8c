"""Frames of a video are counted before any is rendered."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from cltransfer import memory, readback
from cltransfer.bench.synthetic_room import room_cameras
from cltransfer.components import Components
from cltransfer.errors import ResourceError
from cltransfer.features import Features
from cltransfer.readback import RENDER_BATCH, check_frames, check_result, render_frames

HINT = r"lower output_side or frames\)$"


class Counting:
    """Draws frame k of its life in grey k / 255, and keeps how many were asked for."""

    def __init__(self) -> None:
        self.batches: list[int] = []

    def render(self, scene: Any, cameras: Any, buffers: frozenset[str]) -> Any:
        first = sum(self.batches)
        self.batches.append(len(cameras))
        grey = torch.arange(first, first + len(cameras)) / 255
        return Features(cameras.size, image=grey[:, None, None, None].expand(-1, 3, *cameras.size[::-1]))


def rendered(count: int, renderer: Counting) -> torch.Tensor:
    scene: Any = None
    return render_frames(scene, Components(renderer, {}, {}), room_cameras(count, (8, 6)))


def test_all_frames_are_rendered_in_turn_a_batch_at_a_time() -> None:
    renderer = Counting()
    image = rendered(RENDER_BATCH + 3, renderer)
    assert (image.shape, image.dtype) == ((RENDER_BATCH + 3, 3, 6, 8), torch.uint8)
    assert image[:, 0, 0, 0].tolist() == list(range(RENDER_BATCH + 3))
    assert renderer.batches == [RENDER_BATCH, 3]


def test_frames_that_do_not_fit_are_refused_before_one_is_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    renderer = Counting()
    monkeypatch.setattr(readback, "BYTE_LIMIT", 3 * 5 * 8 * 6 - 1)
    with pytest.raises(ResourceError, match=rf"^frames: 5 of 8x6 need 720 bytes, the limit is 719 \({HINT}"):
        rendered(5, renderer)
    monkeypatch.setattr(memory, "free_bytes", lambda: 2 * 2**20)
    monkeypatch.setattr(readback, "BYTE_LIMIT", 2**32)
    with pytest.raises(ResourceError, match=rf"memory: 10 frames of 1000x100 need 3 MB, 2 MB are free .*{HINT}"):
        check_frames(10, (1000, 100))
    monkeypatch.setattr(memory, "free_bytes", lambda: 20 * 2**20)
    check_frames(10, (1000, 100))
    with pytest.raises(ResourceError, match=rf"the maps of 10 frames of 1000x100 need 86 MB, 20 MB are free .*{HINT}"):
        check_result(10, (1000, 100))
    assert renderer.batches == []


def test_a_transfer_says_so_before_it_searches(command: Any, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readback, "BYTE_LIMIT", 1000)
    said = command("transfer", "-q", "--out", tmp_path / "run", "frames=2", "search_side=48", "output_side=96")
    assert said.code == 5
    assert "frames: 2 of 96x54 need 31104 bytes, the limit is 1000 (lower output_side or frames)" in said.err
