from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import pytest
import torch

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.stage import Stage
from cltransfer.driver.working_set import SHARES, WorkingSet
from cltransfer.errors import UsageError
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.plan import make_plan
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene
from cltransfer.scenes.simplify import working_set
from cltransfer.transfer import Inputs, transfer

UP = torch.tensor([0.0, 0, 1], dtype=torch.float64)


def room() -> Scene:
    return Scene(synthetic_room(30_000), None, UP, "room", "0" * 64)


def moved(camera: Camera, distance: float) -> Camera:
    w2c = camera.w2c.clone()
    w2c[:, 2, 3] += distance
    return replace(camera, w2c=w2c)


def test_frames_are_searched_coarse_first_and_finer_later() -> None:
    here = room_cameras(1, (160, 90))
    sets = [WorkingSet(room(), here, 4)]
    for _ in range(4):
        sets.append(sets[-1].about(here))
    counts = [len(one.scene.geometry) for one in sets]
    assert counts[0] < counts[1] < counts[2] < 30_000
    assert sets[2] is sets[3] is sets[4]
    whole = working_set(room(), here, 2)  # half as coarse in the end
    assert torch.equal(sets[-1].scene.geometry.means, whole.geometry.means)


def test_a_working_set_is_kept_near_its_view_and_built_anew_beyond() -> None:
    here = room_cameras(1, (160, 90))
    first = WorkingSet(room(), here, 4, frame=len(SHARES) - 1)
    assert first.about(moved(here, 0.2)) is first
    farther = first.about(moved(here, 2.0))
    assert farther is not first
    assert len(farther.scene.geometry) < len(first.scene.geometry)  # it stands farther back
    assert first.about(replace(here, K=here.K * torch.tensor([[1.1], [1.1], [1]]))) is first
    closer = first.about(replace(here, K=here.K * torch.tensor([[2.0], [2.0], [1]])))
    assert len(closer.scene.geometry) > len(first.scene.geometry)  # a longer lens sees more


def test_a_stage_without_level_of_detail_is_itself() -> None:
    plan = make_plan(frozenset(), {}, frozenset({"depth"}), "scene")
    stage = Stage(room(), GaussianSplats(), plan, Objective({}), (160, 90))
    here = room_cameras(1, (160, 90))
    assert stage.reduced(here, 0) is stage
    assert stage.about(here) is stage
    small = stage.reduced(here, 4)
    assert len(small.scene.geometry) < len(stage.scene.geometry)
    assert small.spent is stage.spent
    finest = small.about(here).about(here)
    assert finest.about(moved(here, 0.1)).scene is finest.scene
    assert finest.about(moved(here, 2.0)).scene is not finest.scene


@pytest.mark.parametrize("k", [0, 2])
def test_a_transfer_searches_in_the_working_set_and_is_rendered_in_full(k: float) -> None:
    budget = ["frames=2", "generations=2", "popsize=4", "search_side=64", "output_side=64", "extract.verify=false"]
    whole = [f"lod={k}", "floaters=keep"]
    result = transfer(Inputs("builtin:courtyard", "builtin:static"), load_config(None, [*budget, *whole]))
    from cltransfer.scenes.load import load_scene

    assert len(result.scene.geometry) == len(load_scene("builtin:courtyard").geometry)
    assert float(result.verified.totals.mean()) < 5


def test_a_negative_level_of_detail_is_refused() -> None:
    with pytest.raises(UsageError, match=r"lod: expected 0(.0)? to 16(.0)?, got -1"):
        load_config(None, ["lod=-1"])


def test_the_working_set_is_built_anew_along_a_long_move_and_kept_where_the_camera_stands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built: list[int] = []
    build = WorkingSet.scene.func  # type: ignore[attr-defined]

    def counted(self: WorkingSet) -> Scene:
        built.append(self.frame)
        return build(self)

    replacement = cached_property(counted)
    replacement.__set_name__(WorkingSet, "scene")
    monkeypatch.setattr(WorkingSet, "scene", replacement)
    small = ["preset=fast", "joint=0", "search_side=64", "output_side=64", "extract.verify=false", "floaters=keep"]
    config = load_config(None, [*small, f"frames={len(SHARES) + 1}", "lod=2"])
    shots = {}
    for name in ("static", "dolly_zoom"):
        transfer(Inputs("builtin:courtyard", f"builtin:{name}"), config)
        shots[name] = built.copy()
        built.clear()
    finer = list(range(len(SHARES)))  # each of the first frames has its own, wherever it looks from
    assert shots["static"] == finer
    assert shots["dolly_zoom"][: len(finer)] == finer
    assert len(shots["dolly_zoom"]) > len(finer)
