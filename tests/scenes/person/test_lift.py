"""A person is lifted from given views, whoever else is told apart in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.features import Features
from cltransfer.pipeline.components import SCENE_SOURCE, Components
from cltransfer.pipeline.graph import run
from cltransfer.scenes.builtin import named_scene
from cltransfer.scenes.person.find_people import ring
from cltransfer.scenes.person.lift import LiftOptions, lift


def test_who_is_lifted_counts_though_no_boxes_meet() -> None:
    scene, parts = named_scene("courtyard"), Components.build(load_config())
    person, plan = scene.subject, parts.plan("scene")
    assert person is not None

    def look(cameras: Camera, box: Tensor | None) -> Features:
        seen = run(plan, parts.renderer.render(scene, cameras, plan.buffers - SCENE_SOURCE), None)
        return replace(seen, box=torch.ones(len(cameras), 5))

    cameras = ring(person.anchor, person.height, scene.up, 4)
    nobody = [np.zeros((0, 5)) for _ in range(4)]
    lifted = lift(scene, parts.renderer, look, lambda cameras: nobody, LiftOptions(given=cameras))
    assert lifted.subject.people == 1
