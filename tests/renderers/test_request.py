"""What every renderer of ours refuses, in the same words."""

from __future__ import annotations

import pytest
import torch

from cltransfer.registry import RENDERERS
from cltransfer.scenes import Scene
from cltransfer.scenes.bake import bake_grid, bake_splats
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.testing.samples import sample_cameras

SIZE = (32, 18)


def box(form: str) -> Scene:
    corners = torch.tensor([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    mesh = Mesh.plain(corners, torch.combinations(torch.arange(8), 3))
    forms = {"mesh": lambda: mesh, "splats": lambda: bake_splats(mesh, 50), "grid": lambda: bake_grid(mesh, 4)}
    return Scene(forms[form](), None, torch.tensor([0.0, 1, 0]).double(), "box", "")


@pytest.mark.parametrize("backend", ["numba", "torch"])
@pytest.mark.parametrize(("name", "form"), [("gaussian_splats", "splats"), ("mesh", "mesh"), ("nerf_grid", "grid")])
def test_no_camera_is_refused_by_every_renderer_in_the_same_words(name: str, form: str, backend: str) -> None:
    scene, renderer = box(form), RENDERERS.build(name, {"backend": backend})
    with pytest.raises(ValueError, match=r"^expected one camera or more, got none$"):
        renderer.render(scene, sample_cameras(0, 1)[[]], renderer.provides)


@pytest.mark.parametrize("form", ["splats", "mesh", "grid"])
@pytest.mark.parametrize("focal", [-50.0, 0.0])
def test_a_lens_without_a_positive_focal_length_is_refused_by_all(form, focal):
    scene, cameras = box(form), sample_cameras(0, 1, SIZE)
    cameras.K[:, 0, 0] = focal
    with pytest.raises(ValueError, match="cameras must have a positive focal length"):
        RENDERERS.get(scene.geometry.renderer)().render(scene, cameras, frozenset({"depth"}))
