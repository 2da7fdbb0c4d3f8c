"""Gaussian splats from posed images by gsplat, where a CUDA device and the extra [cuda] are there."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from scipy.spatial import KDTree
from torch import Tensor

from ..computer.cuda import require_gsplat
from ..progress import Progress
from ..registry import FITTERS
from ..renderers.gaussian_splats import GaussianSplats
from ..scenes.load import Z_UP
from ..scenes.ply import write_splats
from ..scenes.splats import Splats
from ._curve import Level, write_curve
from ._folder import begun, write_state
from ._upward import upward
from ._views import Views, mean_over, psnr

SCENE = "splats.ply"
RATES = {"means": 1.6e-4, "scales": 5e-3, "quats": 1e-3, "opacities": 5e-2, "sh0": 2.5e-3, "shN": 1.25e-4}
"""Of Adam, as Kerbl et al. 2023; that of the means in units of the box, and falling to a hundredth."""
GROWS = 0.5  # share of the steps in which Gaussians are added and removed; the rest settles what is there
WHOLE = 7000  # steps below which the next two are fewer, in proportion
FIRST, RESET = 500, 3000  # steps before gsplat adds the first, and after each of which it makes all faint again


@FITTERS.register("gaussian_splats")
@dataclass(frozen=True)
class GaussianSplatsFit:
    """Fits :class:`~cltransfer.scenes.splats.Splats` with gsplat's densification.

    Args:
        first: Gaussians to start from, drawn in the box.
        degree: of the spherical harmonics, 0..3.
        side: of the images, the longer one at most [px].
        hold_out: every so many-th view is scored on and not learnt from, >= 2.
        steps: of gradient descent; in their first half every hundredth adds Gaussians, of 202 or more.
        near: nothing nearer to a camera is learnt, scene units, > 0.
        seed: of the start and of the order of the views.

    Raises:
        ValueError: an option is out of range.
    """

    first: int = 50_000
    degree: int = 3
    side: int = 800
    hold_out: int = 8
    steps: int = 7000
    near: float = GaussianSplats.near
    seed: int = 0

    def __post_init__(self) -> None:
        if self.degree not in (0, 1, 2, 3):
            raise ValueError(f"degree must be 0, 1, 2 or 3, got {self.degree}")
        for name, least in (("first", 100), ("hold_out", 2), ("steps", 1), ("side", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}, got {getattr(self, name)}")
        _ = self.renderer  # checks near

    @property
    def renderer(self) -> GaussianSplats:
        """What draws as it was learnt: nothing fades before the near plane."""
        return GaussianSplats(near=self.near, near_fade=0.0)

    def require(self) -> None:
        """Whether splats can be fitted here.

        Raises:
            ModelError: there is no CUDA device, or gsplat is not installed.
        """
        require_gsplat("--as gaussian_splats", "--as nerf_grid, which needs no CUDA device")

    def fit(self, views: Views, folder: Path, progress: Progress) -> list[Level]:
        """Fit splats into ``folder``: splats.ply, fit.json, curve.csv and curve.svg; an unfinished fit begins anew.

        Raises:
            ModelError: there is no CUDA device, or gsplat is not installed.
            UsageError: the folder holds a fit with other options or views, or something else, or ``near`` hides the
                scene.
        """
        self.require()
        views.check_near(self.near)
        key = {"as": "gaussian_splats", "options": asdict(self), "views": views.digest}
        if done := begun(folder, key, SCENE):
            return done
        write_state(folder, key, [])
        learn, held_out = views.split(self.hold_out)
        random = torch.Generator().manual_seed(self.seed)
        parameters = start(views.aabb, self.first, self.degree, random)
        since = time.perf_counter()
        self._descend(parameters, learn, random, progress)
        splats = splats_of(parameters)
        score = psnr(splats, held_out, self.renderer)
        count, seconds = len(splats), time.perf_counter() - since
        levels = [Level(count, count, score, self.steps, seconds, True)]
        write_curve(folder, levels, "Gaussians")
        write_splats(folder / SCENE, splats, z_up=upward(views.camera) == Z_UP)
        write_state(folder, key, levels)  # last: by it the fit is done
        return levels

    def _descend(
        self, parameters: dict[str, torch.nn.Parameter], views: Views, random: torch.Generator, progress: Progress
    ) -> None:
        from gsplat import DefaultStrategy, rasterization

        extent = float((views.aabb[1] - views.aabb[0]).norm()) / 2
        scaled = {**RATES, "means": RATES["means"] * extent}
        optimizers = {name: torch.optim.Adam([parameters[name]], lr=rate, eps=1e-15) for name, rate in scaled.items()}
        fall = torch.optim.lr_scheduler.ExponentialLR(optimizers["means"], 0.01 ** (1 / self.steps))
        strategy = DefaultStrategy(**refinement(self.steps), verbose=False)
        strategy.check_sanity(parameters, optimizers)
        state = strategy.initialize_state(scene_scale=extent)
        w2c, K = views.camera.w2c.float().cuda(), views.camera.K.float().cuda()
        for step in range(self.steps):
            view = int(torch.randint(len(views), (1,), generator=random))
            drawn, _, info = rasterization(
                means=parameters["means"],
                quats=parameters["quats"],
                scales=parameters["scales"].exp(),
                opacities=parameters["opacities"].sigmoid(),
                colors=torch.cat([parameters["sh0"], parameters["shN"]], dim=1),
                viewmats=w2c[view, None],
                Ks=K[view, None],
                width=views.camera.size[0],
                height=views.camera.size[1],
                near_plane=self.near,
                sh_degree=min(self.degree, 5 * self.degree * step // self.steps),
                rasterize_mode="antialiased",
                packed=False,
            )
            strategy.step_pre_backward(parameters, optimizers, state, step, info)
            difference(drawn[0], views, view).backward()
            for optimizer in optimizers.values():
                optimizer.step()
                optimizer.zero_grad(set_to_none=True)
            fall.step()
            strategy.step_post_backward(parameters, optimizers, state, step, info, packed=False)
            progress("splats", step + 1, self.steps)


def difference(drawn: Tensor, views: Views, index: int) -> Tensor:
    """Mean absolute colour error of ``drawn`` (H, W, 3) from a view, over the pixels that count."""
    errors = (drawn.permute(2, 0, 1) - views.image[index].to(drawn.device) / 255).abs()
    return errors.mean() if views.counted is None else mean_over(errors, views.counted[index].to(drawn.device))


def refinement(steps: int) -> dict[str, int]:
    """Steps between which gsplat adds Gaussians, and after how many it makes all faint again, as its options."""
    share = min(1.0, steps / WHOLE)
    return {
        "refine_start_iter": round(FIRST * share),
        "refine_stop_iter": round(GROWS * steps),
        "reset_every": max(1, round(RESET * share)),
    }


def start(aabb: Tensor, count: int, degree: int, random: torch.Generator) -> dict[str, torch.nn.Parameter]:
    """Grey Gaussians drawn in the box (2, 3), as wide as their neighbours are far, on the CUDA device."""
    means = (aabb[0] + torch.rand(count, 3, generator=random) * (aabb[1] - aabb[0])).float()
    distance, _ = KDTree(means.numpy()).query(means.numpy(), k=4)
    scales = torch.from_numpy(distance[:, 1:].mean(1)).float().log()[:, None].repeat(1, 3)
    values: dict[str, Any] = {
        "means": means,
        "scales": scales,
        "quats": torch.randn(count, 4, generator=random),
        "opacities": torch.full((count,), 0.1).logit(),
        "sh0": torch.zeros(count, 1, 3),
        "shN": torch.zeros(count, (degree + 1) ** 2 - 1, 3),
    }
    return {name: torch.nn.Parameter(value.cuda()) for name, value in values.items()}


def splats_of(parameters: dict[str, torch.nn.Parameter]) -> Splats:
    """What the parameters stand for, on the CPU."""
    values = {name: value.detach().cpu() for name, value in parameters.items()}
    return Splats(
        means=values["means"],
        scales=values["scales"].exp(),
        quats=torch.nn.functional.normalize(values["quats"], dim=1),
        opacity=values["opacities"].sigmoid(),
        sh=torch.cat([values["sh0"], values["shN"]], dim=1),
        label=torch.zeros(len(values["means"])),
    )
