"""Filmic space of a clip whose depth comes from a network with a shift of its own, as it is and aligned."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from cltransfer.extractors._disparity import aligned, depth_from_disparity
from cltransfer.extractors.layers import Layers
from cltransfer.extractors.scene_subject import SceneSubject
from cltransfer.features import Features
from cltransfer.losses.filmic_space import FilmicSpace
from cltransfer.reading.depth_alignment import align_depth
from cltransfer.registry import RENDERERS
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import shot

SHIFTS = (0.0, 0.05, 0.1, 0.2)  # that a network takes off, of the largest disparity
TOLERANCE = 0.05


def filmed(scene_name: str, name: str) -> Features:
    scene = builtin_scene(scene_name)
    cameras = shot(name, scene.subject, (160, 90), 6).camera
    return RENDERERS.build("gaussian_splats").render(scene, cameras, frozenset({"depth", "label"}))


@pytest.fixture(scope="module")
def clip() -> Features:
    """The reference, with its true depth and layers."""
    return Layers()(SceneSubject()(filmed("plaza", "push_in"), None), None)


@pytest.fixture(scope="module")
def views() -> Features:
    """The scene, where depth is known."""
    return filmed("courtyard", "orbit")


def network(depth: torch.Tensor, shift: float, by_frame: bool) -> torch.Tensor:
    """Disparity (B, H, W) of a network without noise; ``shift`` is of the frame's largest, or of one for all frames."""
    inverse = (1 / depth).nan_to_num(0.0)
    largest = inverse.amax(dim=(1, 2), keepdim=True) if by_frame else torch.tensor(0.5)
    return inverse / largest - shift


def space(clip: Features, disparity: torch.Tensor) -> float:
    """What filmic space says of the clip with its true depth against the same clip as the network sees it."""
    depth = depth_from_disparity(disparity, 1e-3)
    seen = Layers()(replace(clip, depth=depth, layers=None), None)
    return float(FilmicSpace()(clip, seen).mean())


@pytest.mark.parametrize("by_frame", [True, False])
@pytest.mark.parametrize("shift", SHIFTS)
def test_alignment_takes_the_shift_out_and_raw_pays_for_it(
    clip: Features, views: Features, shift: float, by_frame: bool
) -> None:
    align = "shift" if by_frame else "metric"
    said = network(views.require("depth"), shift, by_frame)
    found = align_depth(said, views.require("depth"), align)
    disparity = network(clip.require("depth"), shift, by_frame)
    raw, fixed = space(clip, disparity), space(clip, aligned(disparity, found.align, found.affine))
    assert fixed < 0.2 * TOLERANCE
    assert found.error[1] < 0.002
    if shift == 0:
        assert raw < 0.2 * TOLERANCE
    else:
        assert raw > 2 * TOLERANCE


@pytest.mark.parametrize("shift", SHIFTS[1:])
def test_the_wrong_policy_still_takes_most_of_the_shift_out(clip: Features, views: Features, shift: float) -> None:
    found = align_depth(network(views.require("depth"), shift, False), views.require("depth"), "shift")
    disparity = network(clip.require("depth"), shift, False)
    assert space(clip, aligned(disparity, "shift", found.affine)) < 0.5 * space(clip, disparity)


def test_noise_in_the_network_leaves_the_alignment_within_the_tolerance(clip: Features, views: Features) -> None:
    random = torch.Generator().manual_seed(0)

    def noisy(depth: torch.Tensor) -> torch.Tensor:
        said = network(depth, 0.1, True)
        return said * (1 + 0.05 * torch.randn(said.shape, generator=random))

    found = align_depth(noisy(views.require("depth")), views.require("depth"), "shift")
    assert space(clip, aligned(noisy(clip.require("depth")), "shift", found.affine)) < TOLERANCE
