"""Along the clip: a path that is one motion is one in the search's parameters too."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.driver.follow import follow
from cltransfer.driver.initial_view import any_view
from cltransfer.driver.schedule import make_schedule
from cltransfer.driver.stage import Stage
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.run.readback import read_path
from cltransfer.scenes.load import load_scene
from cltransfer.search.subject_orbit import SubjectOrbit
from cltransfer.shots import builtin_reference
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, transfer

PLACED = ("preset=fast", "losses.filmic_space=null", "losses.camera_movement=null")
MOTION = tuple(f"losses.{name}=null" for name in ("shot_size", "framing", "filmic_space", "camera_angle"))
SIZE = (96, 54)


def test_a_guide_from_behind_is_not_left_by_a_whole_turn() -> None:
    config, scene = load_config(overrides=PLACED), load_scene("builtin:plaza")
    parts, search = Components.build(config), SubjectOrbit()
    objective = Objective(parts.losses)
    stage = Stage(scene, parts.renderer, parts.plan("scene"), objective, SIZE)
    view = any_view(scene.subject, SIZE)
    guide = search.vector(view, view, scene.subject).repeat(8, 1)
    guide[:, 0] = 3.15 + 0.01 * torch.arange(8)  # a vector of a camera there has -3.13
    wanted = guide.clone()
    wanted[:, 0] += torch.linspace(0.06, -0.05, 8)  # so that the guide leads best to some frames and not to others
    reference = read_path(stage, search.cameras(wanted, view, scene.subject))
    homes = search.cameras(guide[:1], view, scene.subject)
    schedule = make_schedule(config, search, objective, reference)
    found = follow(stage, search, reference, homes, schedule, guide=guide[:, :6])
    assert float((found.x[:, 0] - wanted[:, 0]).abs().max()) < 0.05


@pytest.mark.parametrize(("shot", "most"), [("pan", 0.2), ("orbit", 0.8)])  # metres
def test_where_only_motion_is_known_each_frame_goes_on_from_the_one_before(
    shot: str, most: float, tmp_path: Path
) -> None:
    true = builtin_reference(shot, SIZE, 8)[1]
    Trajectory(true.camera[:1], true.times[:1]).save(tmp_path / "view.json")
    small = ("preset=fast", "frames=8", "search_side=96", "output_side=96", "threads=1", "extract.verify=false")
    given = Inputs("builtin:plaza", f"builtin:{shot}", str(tmp_path / "view.json"))
    found = transfer(given, load_config(overrides=[*small, *MOTION]))
    away = (found.trajectory.camera.center - true.camera.center).norm(dim=1)
    assert float(away.max()) < most  # each from the view that was given they are 1.4 and more away
