from __future__ import annotations

import importlib.util
import sys
import types
from dataclasses import replace

import pytest
import torch

from cltransfer.errors import ModelError, UsageError
from cltransfer.fit.gaussian_splats import RATES, SCENE, GaussianSplatsFit, difference
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.ply import read_splats
from cltransfer.scenes.splats import Splats

HAS_GSPLAT = importlib.util.find_spec("gsplat") is not None
READY = HAS_GSPLAT and torch.cuda.is_available()


@pytest.mark.skipif(READY, reason="nothing is missing here")
def test_one_line_says_what_is_missing(views, tmp_path):
    missing = "there is no CUDA device" if HAS_GSPLAT else "gsplat is not installed"
    for call in (GaussianSplatsFit().require, lambda: GaussianSplatsFit().fit(views, tmp_path, lambda *step: None)):
        with pytest.raises(ModelError, match=f"--as gaussian_splats: {missing}") as caught:
            call()
        assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not READY, reason="needs a CUDA device and the extra [cuda]")
def test_an_analytic_scene_is_learnt(views, tmp_path):
    levels = GaussianSplatsFit(first=5000, steps=2000, degree=0).fit(views, tmp_path, lambda *step: None)
    assert levels[0].psnr >= 25
    assert len(read_splats(tmp_path / "splats.ply")) > 0


@pytest.fixture
def quick(monkeypatch):
    """A fit that takes no CUDA device: nothing is learnt."""
    import cltransfer.fit.gaussian_splats as module

    splats = Splats(*(torch.ones(2, *shape) for shape in ((3,), (3,), (4,), (), (1, 3), ())))
    monkeypatch.setattr(module, "require_gsplat", lambda *words: None)
    monkeypatch.setattr(module, "start", lambda *words: {})
    monkeypatch.setattr(module, "splats_of", lambda parameters: splats)
    monkeypatch.setattr(module, "psnr", lambda *words: 20.0)
    monkeypatch.setattr(GaussianSplatsFit, "_descend", lambda *words: None)
    return GaussianSplatsFit(degree=0)


def test_a_folder_is_one_fits(quick, views, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "splats.ply").write_text("mine")
    with pytest.raises(UsageError, match="neither empty nor a fit"):
        quick.fit(views, tmp_path / "other", lambda *step: None)
    assert (tmp_path / "other" / "splats.ply").read_text() == "mine"
    levels = quick.fit(views, tmp_path / "out", lambda *step: None)
    assert quick.fit(views, tmp_path / "out", lambda *step: None) == levels
    with pytest.raises(UsageError, match="holds a fit with other options or views"):
        replace(quick, seed=1).fit(views, tmp_path / "out", lambda *step: None)


def test_splats_of_a_set_whose_z_is_up_say_so(quick, views, tmp_path):
    quick.fit(views, tmp_path / "z", lambda *step: None)
    assert load_scene(tmp_path / "z" / SCENE).up.tolist() == [0, 0, 1]
    y_up = torch.tensor([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]).double()  # z to -y
    lying = replace(views, camera=replace(views.camera, w2c=views.camera.w2c @ y_up.T))
    quick.fit(lying, tmp_path / "y", lambda *step: None)
    assert load_scene(tmp_path / "y" / SCENE).up.tolist() == [0, -1, 0]


def test_a_fit_is_not_done_before_its_curve_is_there(quick, views, tmp_path, monkeypatch):
    def interrupt(*words):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("cltransfer.fit.gaussian_splats.write_curve", interrupt)
        with pytest.raises(KeyboardInterrupt):
            quick.fit(views, tmp_path, lambda *step: None)
    assert quick.fit(views, tmp_path, lambda *step: None)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["curve.csv", "curve.svg", "fit.json", "splats.ply"]
    assert ">Gaussians</text>" in (tmp_path / "curve.svg").read_text()


def test_a_set_in_small_units_is_scored_as_it_is_learnt_and_one_that_cannot_be_seen_is_refused(quick, views, tmp_path):
    camera = replace(views.camera, w2c=views.camera.w2c.clone())
    camera.w2c[:, :3, 3] *= 0.01
    small = replace(views, camera=camera, aabb=0.01 * views.aabb)
    with pytest.raises(UsageError, match=r"^near: hides what is nearer than 0.1, .* \(near="):
        quick.fit(small, tmp_path / "out", lambda *step: None)
    assert quick.renderer == GaussianSplats(near=0.1, near_fade=0.0)
    assert replace(quick, near=0.002).fit(small, tmp_path / "out", lambda *step: None)


class Built(Exception):
    """What a strategy was built with."""


def strategy_of(fit, views, monkeypatch):
    """Options of the strategy that ``fit`` descends by; gsplat itself is not asked."""

    class Strategy:
        def __init__(self, **options):
            self.options = options

        def check_sanity(self, parameters, optimizers):
            raise Built(self.options)

    gsplat = types.ModuleType("gsplat")
    gsplat.DefaultStrategy, gsplat.rasterization = Strategy, None
    monkeypatch.setitem(sys.modules, "gsplat", gsplat)
    parameters = {name: torch.nn.Parameter(torch.zeros(1)) for name in RATES}
    with pytest.raises(Built) as caught:
        fit._descend(parameters, views, torch.Generator(), lambda *step: None)
    return caught.value.args[0]


@pytest.mark.parametrize(
    ("steps", "first", "stop", "reset"),
    [(202, 14, 101, 87), (1200, 86, 600, 514), (7000, 500, 3500, 3000), (30_000, 500, 15_000, 3000)],
)
def test_a_short_fit_adds_gaussians_too(views, monkeypatch, steps, first, stop, reset):
    options = strategy_of(GaussianSplatsFit(steps=steps), views, monkeypatch)
    assert options.pop("verbose") is False
    assert options == {"refine_start_iter": first, "refine_stop_iter": stop, "reset_every": reset}
    assert [step for step in range(steps) if first < step < stop and step % 100 == 0]  # as gsplat adds them


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_the_fewest_steps_leave_gsplat_something_to_divide_by(views, monkeypatch, steps):
    assert strategy_of(GaussianSplatsFit(steps=steps), views, monkeypatch)["reset_every"] >= 1


def test_a_splat_is_pulled_by_no_pixel_that_does_not_count(views):
    drawn = torch.zeros(48, 48, 3, requires_grad=True)
    (whole,) = torch.autograd.grad(difference(drawn, views, 3), drawn)
    torch.testing.assert_close(whole, -torch.ones(48, 48, 3).where(views.image[3].permute(1, 2, 0) > 0, 0) / 48**2 / 3)
    counted = torch.zeros(25, 48, 48, dtype=torch.bool)
    counted[3, 10:20] = True
    (part,) = torch.autograd.grad(difference(drawn, replace(views, counted=counted), 3), drawn)
    torch.testing.assert_close(part[10:20], whole[10:20] * 4.8)
    assert not part[:10].any()
    assert not part[20:].any()


def test_options_out_of_range_are_named():
    for options, line in (
        ({"degree": 4}, "degree must be"),
        ({"steps": 0}, "steps must be at least 1"),
        ({"near": 0.0}, "near must be"),
    ):
        with pytest.raises(ValueError, match=line):
            GaussianSplatsFit(**options)
