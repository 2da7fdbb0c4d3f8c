"""One geometry, three representations: masks and depths agree from all around."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from cltransfer.camera import Camera
from cltransfer.computer import memory
from cltransfer.errors import ResourceError, UsageError
from cltransfer.features import Features
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.renderers.mesh import MeshRenderer
from cltransfer.renderers.nerf_grid import NerfGridRenderer
from cltransfer.scenes import Scene, bake
from cltransfer.scenes.bake import bake_grid, bake_splats, sample_surface, surface_area
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.scenes.meshes.read_mesh import read_mesh

MAN = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "mesh" / "cesium_man.glb"
UP = torch.tensor([0.0, 1, 0], dtype=torch.float64)
WANTED = frozenset({"image", "label", "depth"})


def snowman() -> Mesh:
    """Two balls and a plate, each painted by its place; the balls are the subject."""
    parts = [
        trimesh.creation.icosphere(4, 0.5),
        trimesh.creation.icosphere(4, 0.3).apply_translation([0, 0.75, 0]),
        trimesh.creation.box([1.6, 0.1, 1.6]).apply_translation([0, -0.55, 0]),
    ]
    meshes = []
    for number, part in enumerate(parts):
        vertices = torch.from_numpy(np.array(part.vertices)).float()
        mesh = Mesh.plain(vertices, torch.from_numpy(np.array(part.faces)), (vertices * 0.5 + 0.5).clamp(0, 1))
        meshes.append(mesh.with_label(torch.full((len(mesh),), float(number < 2))))
    return Mesh.concatenate(meshes)


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (-1.0, -2.0, -1.0)])
def test_a_mirrored_mesh_is_not_baked_inside_out(scale: tuple[float, float, float]) -> None:
    ball = trimesh.creation.icosphere(2, 0.5)
    mesh = Mesh.plain(torch.from_numpy(np.array(ball.vertices)), torch.from_numpy(np.array(ball.faces)))
    samples = sample_surface(mesh.moved(torch.diag(torch.tensor([*scale, 1.0]))), 500)
    assert bool(((samples.points * samples.normals).sum(1) > 0).all())


@pytest.mark.parametrize("bake", [bake_splats, bake_grid])
@pytest.mark.parametrize(
    ("vertices", "faces"),
    [([[1.0, 2, 3]] * 3, [[0, 1, 2]]), ([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]), ([[0.0, 0, 0]] * 3, [])],
)
def test_a_mesh_without_area_is_refused_as_one(bake: Callable[[Mesh, int], Any], vertices: Any, faces: Any) -> None:
    mesh = Mesh.plain(torch.tensor(vertices), torch.tensor(faces, dtype=torch.int32).reshape(-1, 3))
    with pytest.raises(ValueError, match=rf"expected a mesh with an area, got {len(faces)} faces of an area of 0"):
        bake(mesh, 16)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-6, 1e-9])
def test_gaussians_lie_along_faces_however_small(scale: float) -> None:
    ball = trimesh.creation.icosphere(4, 1.0)
    mesh = Mesh.plain(torch.from_numpy(np.array(ball.vertices) * scale), torch.from_numpy(np.array(ball.faces)))
    samples = sample_surface(mesh, 2_000)
    torch.testing.assert_close(samples.normals.norm(dim=1), torch.ones(2_000).double())
    outward = torch.nn.functional.normalize(samples.points / scale, dim=1)
    assert float((samples.normals * outward).sum(1).min()) > 0.99


def around(mesh: Mesh, count: int = 16, size: tuple[int, int] = (320, 240)) -> Camera:
    """Views from all sides that see the whole mesh."""
    low, high = mesh.vertices.double().amin(0), mesh.vertices.double().amax(0)
    angle = torch.arange(count, dtype=torch.float64) * 2 * math.pi / count
    outward = torch.stack([angle.cos(), 0.4 * (2 * angle).sin(), angle.sin()], dim=1)
    middle = (low + high) / 2
    eyes = middle + 1.5 * float((high - low).norm()) * outward
    return Camera.look_at(eyes, middle, UP, math.radians(40), size)


def drawn(geometry: Any, cameras: Camera) -> Features:
    renderers: dict[str, Any] = {
        "mesh": MeshRenderer(),
        "gaussian_splats": GaussianSplats(),
        "nerf_grid": NerfGridRenderer(),
    }
    scene = Scene(geometry, None, UP, "baked", "0" * 64)
    return renderers[geometry.renderer].render(scene, cameras, WANTED)


def agreement(found: Features, truth: Features) -> tuple[float, float, float]:
    """Least overlap of the masks over the views, median relative error of the depth in both, mean error of colour."""
    masks = [features.require("label") > 0.5 for features in (found, truth)]
    overlap = (masks[0] & masks[1]).sum((1, 2)) / (masks[0] | masks[1]).sum((1, 2))
    error = (found.require("depth") / truth.require("depth") - 1).abs()
    both = masks[0] & masks[1]
    color = (found.require("image") - truth.require("image")).abs().mean(1)[both].mean()
    return float(overlap.min()), float(error[both].nanmedian()), float(color)


@pytest.mark.parametrize("bake", [bake_splats, partial(bake_grid, cells=128)])
def test_a_made_mesh_looks_the_same_in_every_representation(bake: Callable[[Mesh], Any]) -> None:
    mesh = snowman()
    cameras = around(mesh)
    flat = replace(mesh, shaded=torch.zeros(len(mesh), dtype=torch.bool))
    overlap, depth, color = agreement(drawn(bake(mesh), cameras), drawn(flat, cameras))
    assert overlap >= 0.92
    assert depth <= 0.005
    assert color <= 0.03


@pytest.mark.skipif(not MAN.is_file(), reason=f"the textured man is not here: {MAN}")
@pytest.mark.parametrize("bake", [bake_splats, bake_grid])
def test_a_textured_person_looks_the_same_in_every_representation(bake: Callable[[Mesh], Any]) -> None:
    mesh = read_mesh(MAN).mesh
    mesh = mesh.with_label(torch.ones(len(mesh)))
    cameras = around(mesh)
    flat = replace(mesh, shaded=torch.zeros(len(mesh), dtype=torch.bool))  # as it is painted, unlit
    overlap, depth, color = agreement(drawn(bake(mesh), cameras), drawn(flat, cameras))
    assert overlap >= 0.9
    assert depth <= 0.02
    assert color <= 0.06


def test_samples_lie_on_the_surface_and_are_as_dense_everywhere() -> None:
    mesh = snowman()
    samples = sample_surface(mesh, 20_000)
    ball = samples.points[:, 1] > 0.6  # the upper ball's top half and a little more
    radius = (samples.points[ball] - torch.tensor([0, 0.75, 0])).norm(dim=1)
    assert float((radius - 0.3).abs().max()) < 0.003
    half = samples.points[:, 1] > 0.75
    assert float(half.sum()) * samples.area == pytest.approx(2 * math.pi * 0.3**2, rel=0.02)
    torch.testing.assert_close(samples.normals.norm(dim=1), torch.ones(len(samples.normals), dtype=torch.float64))
    assert torch.equal(sample_surface(mesh, 20_000).points, samples.points)


def test_a_texture_is_looked_up_and_its_holes_stay_holes() -> None:
    square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    image = torch.zeros(2, 2, 4, dtype=torch.uint8)
    image[0, 0] = torch.tensor([255, 0, 0, 255])
    image[1, 1] = torch.tensor([0, 0, 255, 255])  # the other two are holes
    plain = Mesh.plain(square, faces, torch.ones(4, 3))
    uv = torch.stack([square[:, 0], 1 - square[:, 1]], dim=1)
    mesh = replace(plain, uv=uv, texture=torch.zeros(2, dtype=torch.int32), textures=(image,))
    samples = sample_surface(mesh, 4_000)
    left, top = samples.points[:, 0] < 0.5, samples.points[:, 1] > 0.5
    assert bool((left == top).all())
    assert len(samples.points) == pytest.approx(2_000, rel=0.05)
    assert samples.colors[left].unique(dim=0).tolist() == [[1, 0, 0]]
    assert samples.colors[~left].unique(dim=0).tolist() == [[0, 0, 1]]


def test_a_texture_is_baked_beyond_its_edges_as_it_goes_on_there() -> None:
    square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    image = torch.tensor([[[0, 0, 0, 255], [255, 255, 255, 255]]]).to(torch.uint8)
    plain = Mesh.plain(square, torch.tensor([[0, 1, 2], [0, 2, 3]]), torch.ones(4, 3))
    uv = torch.stack([1.01 + 0.98 * square[:, 0], square[:, 1]], dim=1)  # all of it lies to the right of the image
    mesh = replace(plain, uv=uv, texture=torch.zeros(2, dtype=torch.int32), textures=(image,))
    for wrap, (left, right) in {"repeat": (0, 1), "clamp": (1, 1), "mirror": (1, 0)}.items():
        samples = sample_surface(replace(mesh, wraps=((wrap, "clamp"),)), 500)  # type: ignore[arg-type]  # no literal
        x = samples.points[:, 0]
        expected = torch.where(x < 0.5, left, right).double()
        assert bool((samples.colors[:, 0] == expected)[(x - 0.5).abs() > 1e-9].all())


def test_the_area_of_many_faces_takes_no_memory_before_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, usual, asked = snowman(), bake._across, list[int]()
    whole = surface_area(mesh)

    def across(mesh: Mesh, faces: torch.Tensor) -> torch.Tensor:
        asked.append(len(faces))
        return usual(mesh, faces)

    monkeypatch.setattr(bake, "_across", across)
    monkeypatch.setattr(bake, "BLOCK", 100)
    assert surface_area(mesh) == pytest.approx(whole, rel=1e-12)
    assert (max(asked), sum(asked)) == (100, len(mesh))
    asked.clear()
    monkeypatch.setattr(memory, "free_bytes", lambda: bake.FACE_BYTES * len(mesh) - 1)
    with pytest.raises(ResourceError, match=rf"memory: {len(mesh)} faces need .* or thin the mesh"):
        bake_grid(mesh)
    assert asked == []


def test_nothing_to_bake_is_refused() -> None:
    point = Mesh.plain(torch.zeros(3, 3), torch.tensor([[0, 1, 2]]))
    with pytest.raises(ValueError, match="expected a mesh with an area"):
        bake_splats(point)
    with pytest.raises(ValueError, match="cells must be at least 2"):
        bake_grid(snowman(), 1)


def test_as_many_cells_as_the_command_takes_are_begun_whatever_the_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = RuntimeError("begun")

    def sampled(mesh: Mesh, count: int) -> None:
        raise begun

    monkeypatch.setattr(memory, "free_bytes", lambda: None)
    monkeypatch.setattr("cltransfer.scenes.bake.sample_surface", sampled)
    for side in (1.0, 0.3, 7.1):  # how far a rounding goes is another matter for each
        cube = trimesh.creation.box([side] * 3)
        mesh = Mesh.plain(torch.from_numpy(np.array(cube.vertices)), torch.from_numpy(np.array(cube.faces)))
        with pytest.raises(RuntimeError) as caught:
            bake_grid(mesh, 512)
        assert caught.value is begun


def test_a_grid_that_could_not_be_opened_again_or_does_not_fit_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    cube = trimesh.creation.box()
    mesh = Mesh.plain(torch.from_numpy(np.array(cube.vertices)), torch.from_numpy(np.array(cube.faces)))
    with monkeypatch.context() as patch:
        patch.setattr(memory, "free_bytes", lambda: None)
        patch.setattr("cltransfer.scenes.bake.sample_surface", None)
        with pytest.raises(UsageError, match=r"cells: expected a grid of at most 138991832 vertices, 520 .* 144703125"):
            bake_grid(mesh, 520)
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**24)
    with pytest.raises(
        ResourceError, match=r"memory: a grid's 42875 vertices and .* samples need 32 MB, 16 MB are free"
    ):
        bake_grid(mesh, 30)
    assert bake_grid(mesh, 10).density.shape == (15, 15, 15)


def test_more_gaussians_than_fit_in_memory_are_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**24)
    with monkeypatch.context() as patch:
        patch.setattr("cltransfer.scenes.bake.sample_surface", None)
        with pytest.raises(ResourceError, match=r"memory: 100000 Gaussians need 47 MB, 16 MB are free .* take fewer"):
            bake_splats(snowman(), 100_000)
    assert len(bake_splats(snowman(), 10_000)) == 10_000
