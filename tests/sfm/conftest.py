"""Rendered clips whose cameras and depth are known."""

from __future__ import annotations

import pytest
import torch

pytest.importorskip("pycolmap", reason="needs the extra sfm")

from cltransfer.registry import RENDERERS
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import Setup, shot

SIZE = (480, 270)


@pytest.fixture(scope="session")
def filmed():
    """A function: name of a shot -> trajectory, frames (N, H, W, 3) uint8, depth (N, H, W), subject (N, H, W) bool."""
    scene = builtin_scene("courtyard")
    renderer = RENDERERS.build("gaussian_splats")
    clips = {}

    def film(name, frames=8, seed=0):
        if (name, frames, seed) not in clips:
            path = shot(name, scene.subject, SIZE, frames, setup=Setup(seed=seed))
            seen = renderer.render(scene, path.camera, frozenset({"image", "depth", "label"}))
            image = (seen.image.clamp(0, 1) * 255).round().to(torch.uint8).permute(0, 2, 3, 1).numpy()
            clips[name, frames, seed] = (path, image, seen.depth, seen.label > 0.5)
        return clips[name, frames, seed]

    return film
