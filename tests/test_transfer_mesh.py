"""A shot of a splat scene, found again around a skinned man on a mesh floor."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.errors import UsageError
from cltransfer.transfer import Inputs, transfer

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data" / "mesh"
SCENE = str(ROOT / "configs" / "scenes" / "man_in_gallery.yaml")
SMALL = ("frames=3", "output_side=160", "search_side=96", "threads=1")


@pytest.fixture(autouse=True)
def assets(monkeypatch: pytest.MonkeyPatch) -> None:
    if not DATA.is_dir():
        pytest.skip("needs the meshes of shared/data")
    monkeypatch.setenv("CLTRANSFER_ASSETS", str(DATA))


def test_the_five_metrics_of_a_transfer_into_a_mesh_come_near_the_reference() -> None:
    result = transfer(Inputs(SCENE, "builtin:dolly_zoom"), load_config(None, [*SMALL, "renderer.mesh={}"]))
    assert result.scene.subject is not None
    assert result.image.shape == (3, 3, 90, 160)
    terms = {term.name: float(term.values.nanmean()) for term in result.verified.terms}
    assert terms["shot_size"] < 0.02
    assert terms["framing"] < 0.02
    assert terms["camera_angle"] < 0.05
    lit = result.image.float().flatten(1).mean(1)
    assert bool((lit > 30).all())  # inside the gallery, not in the void
    assert not torch.equal(result.image[0], result.image[2])


def test_the_wrong_renderer_names_the_right_one() -> None:
    with pytest.raises(UsageError) as error:
        transfer(Inputs(SCENE, "builtin:dolly_zoom"), load_config(None, [*SMALL, "renderer.gaussian_splats={}"]))
    assert str(error.value) == (
        "man_in_gallery: renderer gaussian_splats: does not draw Mesh (choose: renderer.mesh={})"
    )
