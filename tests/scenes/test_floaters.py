"""Gaussians that touch nothing are told from surfaces, whatever the scene's unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.computer.memory import VARIABLE
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes import floaters as module
from cltransfer.scenes.floaters import MEMBERS, floaters, without_floaters
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.simplify import joined, subset
from cltransfer.scenes.splats import Splats


@pytest.fixture(scope="module")
def room() -> Splats:
    geometry = load_scene("builtin:room").geometry
    assert isinstance(geometry, Splats)
    return geometry


def blobs(means: Tensor, scale: float, coefficients: int) -> Splats:
    """Round ones that belong to nobody."""
    n = len(means)
    return Splats(
        means.float(),
        torch.full((n, 3), scale),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
        torch.full((n,), 0.7),
        torch.zeros(n, coefficients, 3),
        torch.zeros(n),
    )


def hung(room: Splats, count: int) -> Splats:
    """The room and ``count`` more between its walls, of no thing."""
    low, high = room.means.quantile(0.2, dim=0), room.means.quantile(0.8, dim=0)
    where = torch.from_numpy(np.random.default_rng(3).uniform(0, 1, (count, 3)))
    return joined(room, blobs(low + where * (high - low), 0.06, room.sh.shape[1]))


def test_what_hangs_in_the_air_is_found_and_what_stands_in_the_room_is_not(room: Splats) -> None:
    found = floaters(hung(room, 60))
    assert float(found[len(room) :].float().mean()) > 0.75  # the others touch a wall or a table
    assert int(found[: len(room)].sum()) <= 0.005 * len(room)


def test_a_few_in_touch_float_and_many_do_not(room: Splats) -> None:
    middle = room.means.mean(0)

    def found(count: int) -> int:
        line = torch.arange(count)[:, None] * torch.tensor([0.0, 0.0, 0.002])
        both = joined(room, blobs(middle + 5 + line, 0.005, room.sh.shape[1]))
        return int(floaters(both)[len(room) :].sum())

    assert found(MEMBERS - 1) == MEMBERS - 1
    assert found(MEMBERS) == 0


def test_many_at_one_place_take_no_longer_than_apart(room: Splats, within: Callable[[float, float], bool]) -> None:
    heap = blobs(room.means.mean(0).expand(40_000, 3) + 9, 0.005, room.sh.shape[1])
    heap = joined(subset(room, torch.arange(1000)), heap)
    start = process_time()
    assert not floaters(heap)[1000:].any()
    assert within(process_time() - start, 1.0)


def test_what_coincides_is_in_touch_with_all_that_one_of_it_touches(room: Splats) -> None:
    places = torch.arange(4).repeat_interleave(10)[:, None] * torch.tensor([0.0, 0.0, 0.002])
    heaps = blobs(room.means.mean(0) + 5 + places, 0.005, room.sh.shape[1])
    heaps = replace(heaps, scales=torch.where(torch.arange(40)[:, None] % 10 == 0, heaps.scales, 1e-5))
    assert not floaters(joined(room, heaps))[len(room) :].any()
    assert floaters(joined(room, subset(heaps, torch.arange(30))))[len(room) :].all()
    alone = floaters(replace(heaps, means=heaps.means[:1].expand(40, 3)))
    assert not alone.any()


def test_the_unit_of_the_scene_changes_nothing(room: Splats) -> None:
    scene = hung(room, 20)
    larger = replace(scene, means=1000 * scene.means, scales=1000 * scene.scales)
    assert torch.equal(floaters(scene), floaters(larger))


def test_the_person_never_floats(room: Splats) -> None:
    scene = hung(room, 20)
    marked = torch.cat([torch.zeros(len(room)), torch.ones(20)])
    assert floaters(scene)[len(room) :].any()
    assert not floaters(scene.with_label(marked))[len(room) :].any()


@pytest.mark.parametrize("share", [0.03, 0.1])
def test_a_scene_that_comes_apart_stays_as_it_is(room: Splats, share: float) -> None:
    chosen = torch.from_numpy(np.random.default_rng(0).permutation(len(room))[: round(share * len(room))])
    assert not floaters(subset(room, chosen.sort().values)).any()


@pytest.mark.parametrize("count", [0, 1, 8, 9])
def test_scenes_of_next_to_nothing(room: Splats, count: int) -> None:
    assert not floaters(subset(room, torch.arange(count))).any()


def test_what_memory_does_not_hold_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene("builtin:room")
    monkeypatch.setenv(VARIABLE, "1")
    with pytest.raises(ResourceError, match=r"the neighbours of \d+ Gaussians need .* set floaters=keep"):
        without_floaters(scene)


def test_only_the_geometry_of_splats_changes(room: Splats) -> None:
    scene = load_scene("builtin:room")
    hanging = replace(scene, geometry=hung(room, 60))
    assert 40 < len(hanging.geometry) - len(without_floaters(hanging).geometry) <= 60 + 0.005 * len(room)
    assert without_floaters(hanging).subject is scene.subject
    mesh = load_scene("builtin:room-0-mesh")
    assert without_floaters(mesh) is mesh


def test_of_a_large_scene_the_answer_is_kept_by_its_content(
    room: Splats, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path))
    both = hung(room, 61)
    expected = floaters(both)
    assert expected.any()
    assert not list(tmp_path.rglob("*.bits"))
    monkeypatch.setattr(module, "KEPT", len(both))
    assert torch.equal(floaters(both), expected)
    (kept,) = tmp_path.rglob("*.bits")
    moved = replace(both, means=both.means + 1e-3)
    floaters(moved)
    assert len(list(tmp_path.rglob("*.bits"))) == 2

    kept.write_bytes(bytes(kept.stat().st_size))  # nothing small: so it is read
    assert not floaters(both).any()
    kept.write_bytes(b"short")
    with pytest.raises(InputError, match=r"\.bits: expected \d+ bytes, got 5 .delete it"):
        floaters(both)


def test_a_cache_that_cannot_be_written_costs_no_more_than_another_look(
    room: Splats, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    both = hung(room, 61)
    expected = floaters(both)
    monkeypatch.setattr(module, "KEPT", len(both))
    (tmp_path / "file").touch()
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "file"))
    assert torch.equal(floaters(both), expected)
    assert caplog.messages[0].endswith("Not a directory: the next run looks for floaters anew")
