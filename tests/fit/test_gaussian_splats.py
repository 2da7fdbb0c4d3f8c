from __future__ import annotations

import importlib.util

import pytest
import torch

from cltransfer.errors import ModelError
from cltransfer.fit.gaussian_splats import GaussianSplatsFit
from cltransfer.scenes.ply import read_splats

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


def test_options_out_of_range_are_named():
    for options, line in (({"degree": 4}, "degree must be"), ({"steps": 0}, "steps must be at least 1")):
        with pytest.raises(ValueError, match=line):
            GaussianSplatsFit(**options)
