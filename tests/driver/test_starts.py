"""Where a search starts: what was given is enough, whatever else is blocked."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.driver.guard import Guard
from cltransfer.driver.initial_view import any_view
from cltransfer.driver.schedule import make_schedule
from cltransfer.driver.stage import Stage, read_path
from cltransfer.driver.starts import Starting
from cltransfer.errors import InputError
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.scenes.builtin import named_scene
from cltransfer.search.subject_orbit import SubjectOrbit
from cltransfer.shots import shot

SIZE = (96, 54)


class Walls(Guard):
    """Something stands before every view."""

    def blocked(self, features: Features, reference: Features | None = None) -> Tensor:
        return torch.ones(len(features), dtype=torch.bool)


@pytest.mark.parametrize("given", [True, False])
def test_a_given_view_is_a_start_where_all_others_are_blocked(given: bool) -> None:
    scene = named_scene("plaza")
    assert scene.subject is not None
    config = load_config(overrides=["preset=fast"])
    parts = Components.build(config)
    objective, search = Objective(parts.losses), SubjectOrbit()
    stage = Stage(scene, parts.renderer, parts.plan("scene"), objective, SIZE)
    reference = read_path(stage, shot("push_in", scene.subject, SIZE, 2).camera)
    walled = Stage(scene, parts.renderer, parts.plan("scene"), objective, SIZE, guard=Walls(scene.subject.height))
    view: Camera | None = any_view(scene.subject, SIZE) if given else None
    starting = Starting(search, make_schedule(config, search, objective, reference), 0, view, SIZE, by_networks=True)
    if view is None:
        with pytest.raises(InputError, match=r"--init: no view around the subject shows it \(give one: --init FILE\)$"):
            starting.starts(walled, reference)
    else:
        torch.testing.assert_close(starting.starts(walled, reference).homes.w2c, view.w2c)


def test_where_the_near_plane_may_hide_the_subject_the_line_says_so() -> None:
    """In a scene of a small unit a view that is given shows nothing either."""
    scene = named_scene("plaza")
    geometry, person = scene.geometry, scene.person
    parts = Components.build(config := load_config(overrides=["preset=fast"]))
    objective, search = Objective(parts.losses), SubjectOrbit()
    metres = Stage(scene, parts.renderer, parts.plan("scene"), objective, SIZE)
    reference = read_path(metres, shot("push_in", person, SIZE, 2).camera)
    small = replace(
        scene,
        geometry=replace(geometry, means=geometry.means / 1000, scales=geometry.scales / 1000),
        subject=replace(person, joints=person.joints / 1000, height=person.height / 1000),
    )
    guard = Guard(small.person.height)
    starting = Starting(search, make_schedule(config, search, objective, reference), 0, None, SIZE, by_networks=True)
    stage = replace(metres, scene=small, guard=guard)
    with pytest.raises(InputError, match="no view around the subject shows it") as refused:
        starting.starts(stage, reference)
    told = re.search(r"\(if it is cut off before the lens, (.+); else give one: --init FILE\)$", str(refused.value))
    assert told is not None
    drawn = Components.build(load_config(overrides=["preset=fast", *told[1].split()])).renderer
    assert len(starting.starts(replace(stage, renderer=drawn), reference).homes) > 0
