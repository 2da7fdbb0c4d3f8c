"""Along the clip: a path that is one motion is one in the search's parameters too."""

from __future__ import annotations

import torch

from cltransfer.components import Components
from cltransfer.config import load_config
from cltransfer.driver.follow import follow
from cltransfer.driver.initial_view import any_view
from cltransfer.driver.schedule import make_schedule
from cltransfer.driver.stage import Stage
from cltransfer.objective import Objective
from cltransfer.readback import read_path
from cltransfer.scenes.load import load_scene
from cltransfer.search.subject_orbit import SubjectOrbit

PLACED = ("preset=fast", "losses.filmic_space=null", "losses.camera_movement=null")
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
