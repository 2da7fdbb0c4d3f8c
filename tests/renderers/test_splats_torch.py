"""The oracle itself: its slopes and its harmonics. Its values are checked beside the kernels'."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.camera import Camera, intrinsics
from cltransfer.renderers._splats_torch import render_one, sh_basis
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.renderers.kernels.splats import Settings
from cltransfer.scenes import Scene
from cltransfer.scenes.splats import Splats


@pytest.mark.parametrize("name", ["alpha", "expected_depth", "image"])
def test_the_oracles_gradient_in_the_pose_is_the_slope_of_its_values(name):
    torch.manual_seed(0)
    n = 6
    splats = Splats(
        torch.rand(n, 3).double() * torch.tensor([1.0, 1.0, 2.0]).double() + torch.tensor([-0.5, -0.5, 3.0]).double(),
        torch.full((n, 3), 0.35).double() + torch.rand(n, 3).double() * 0.1,
        torch.nn.functional.normalize(torch.randn(n, 4).double(), dim=-1),
        torch.full((n,), 0.5).double(),
        torch.randn(n, 4, 3).double() * 0.3,
        torch.zeros(n).double(),
    )
    size = (12, 10)
    camera = Camera(torch.eye(4).double()[None], intrinsics(torch.tensor([12.0]).double(), size), size)

    def mean(w2c: Tensor) -> Tensor:
        moved = Camera(w2c[None], camera.K, camera.size)
        return render_one(splats, moved, Settings(0.1, 0.3, True))[name][..., 2:8, 2:8].mean()

    w2c = camera.w2c[0].clone().requires_grad_()
    (gradient,) = torch.autograd.grad(mean(w2c), w2c)
    assert gradient[:3].abs().min() > 0
    for row in range(3):
        for column in range(4):
            step = torch.zeros(4, 4).double()
            step[row, column] = 1e-5
            slope = (mean(camera.w2c[0] + step) - mean(camera.w2c[0] - step)) / 2e-5
            assert float(gradient[row, column]) == pytest.approx(float(slope), rel=1e-3, abs=1e-6)


def test_gradients_reach_intrinsics_and_every_part_of_the_gaussians():
    room = synthetic_room(300, degree=1)
    names = ("means", "scales", "quats", "opacity", "sh", "label")
    leaves = {n: getattr(room, n).clone().requires_grad_() for n in names}
    cameras = room_cameras(1, (24, 16))
    K = cameras.K.clone().requires_grad_()
    scene = Scene(Splats(**leaves), None, torch.tensor([0.0, 0.0, 1.0]), "room", "0" * 64)
    got = GaussianSplats(backend="torch").render(scene, replace(cameras, K=K), frozenset({"image", "label"}))
    (got.image.sum() + got.label.sum()).backward()
    for leaf in (*leaves.values(), K):
        assert leaf.grad is not None
        assert leaf.grad.isfinite().all()
        assert leaf.grad.abs().max() > 0


def test_harmonics_are_orthonormal_on_the_sphere():
    steps = torch.arange(200).double() + 0.5
    z = 2 * steps / 200 - 1
    angle = 2 * math.pi * steps / 200
    z, angle = torch.meshgrid(z, angle, indexing="ij")
    ring = (1 - z**2).sqrt()
    basis = sh_basis(torch.stack([ring * angle.cos(), ring * angle.sin(), z], -1).reshape(-1, 3), 3)
    gram = basis.T @ basis * (4 * math.pi / len(basis))
    torch.testing.assert_close(gram, torch.eye(16).double(), atol=1e-3, rtol=0)
