"""The torch backends work where their inputs are: nothing they make lands on the default device."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.computer.cuda import moved, on_device
from cltransfer.errors import UsageError
from cltransfer.registry import RENDERERS
from cltransfer.renderers import _mesh_torch, _nerf_grid_torch, _splats_torch
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.renderers.mesh import MeshRenderer
from cltransfer.renderers.nerf_grid import NerfGridRenderer
from cltransfer.scenes import Scene
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.scenes.nerf_grid import NerfGrid
from cltransfer.scenes.splats import Splats

CAMERA = room_cameras(1, (20, 14))
Draw = Callable[[Any], dict[str, Tensor]]


def textured_wall() -> Mesh:
    middle = CAMERA.center[0] + 3 * CAMERA.c2w[0, :3, 2]
    right, down = CAMERA.c2w[0, :3, 0], CAMERA.c2w[0, :3, 1]
    corners = torch.stack([middle + 2 * (x * right + y * down) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    plain = Mesh.plain(corners, torch.tensor([[0, 1, 2], [0, 2, 3]]))
    image = torch.randint(0, 256, (4, 4, 4), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    uv = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    texture = torch.tensor([0, -1], dtype=torch.int32)
    return Mesh(plain.vertices, plain.faces, plain.colors, plain.label, plain.shaded, uv, texture, (image,))


def grid() -> NerfGrid:
    random = torch.Generator().manual_seed(0)
    shape = (6, 7, 8)
    sh = torch.rand(*shape, 4, 3, generator=random)
    aabb = torch.tensor([[0.0, 0, 0], [8, 6, 3]], dtype=torch.float64)
    return NerfGrid(torch.rand(shape, generator=random), sh, torch.zeros(shape), aabb)


def draw_splats(room: Splats) -> dict[str, Tensor]:
    return _splats_torch.render_one(room, CAMERA, GaussianSplats().settings)


def draw_mesh(wall: Mesh) -> dict[str, Tensor]:
    return _mesh_torch.render_one(wall, CAMERA, MeshRenderer(samples=2).settings)


def draw_grid(field: NerfGrid) -> dict[str, Tensor]:
    return _nerf_grid_torch.render_one(field, CAMERA, NerfGridRenderer().settings)


class There(Tensor):
    """A tensor that says that it lies elsewhere; what it holds lies here."""

    held: Tensor

    @staticmethod
    def __new__(cls, held: Tensor) -> There:
        wrapper: There = Tensor._make_wrapper_subclass(  # type: ignore[attr-defined]
            cls, held.size(), strides=held.stride(), dtype=held.dtype, device="meta"
        )
        wrapper.held = held
        return wrapper

    @classmethod
    def __torch_function__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if func is Tensor.new_tensor:  # which goes round the mode that sees every other call
            return torch.tensor(args[1], dtype=args[0].dtype).to("meta")
        with torch._C.DisableTorchFunctionSubclass():
            return func(*args, **(kwargs or {}))

    @classmethod
    def __torch_dispatch__(cls, func: Any, *given: Any) -> Any:  # type: ignore[override]
        raise AssertionError(f"{func} outside of SecondDevice")


class SecondDevice(TorchDispatchMode):
    """Tensors on "meta" are :class:`There`, and mix with none that lie here, as on a device that we have not.

    Beside single numbers: those and places to read from may lie here, as for CUDA.
    """

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        tensors = [value for value in tree_leaves((args, kwargs)) if isinstance(value, Tensor)]
        away = [isinstance(value, There) for value in tensors]
        copies, reads = func is torch.ops.aten._to_copy.default, func is torch.ops.aten.index.Tensor
        if any(away) and not copies and not (reads and away[0]):
            assert all(far or value.dim() == 0 for value, far in zip(tensors, away)), f"{func} of two devices"
        ends_there = any(away) if kwargs.get("device") is None else torch.device(kwargs["device"]).type == "meta"
        if kwargs.get("device") is not None:
            kwargs["device"] = "cpu"
        args, kwargs = tree_map(lambda value: value.held if isinstance(value, There) else value, (args, kwargs))
        made = func(*args, **kwargs)
        return tree_map(lambda value: There(value) if ends_there and isinstance(value, Tensor) else value, made)


@dataclass(frozen=True)
class Pile:
    top: Tensor
    below: tuple[Tensor, ...]
    rest: tuple[object, ...]


ROOM, WALL, FIELD = synthetic_room(300, degree=1), textured_wall(), grid()


@pytest.fixture
def nowhere() -> Iterator[None]:
    """The default device holds no values, so whatever is made there cannot be mixed with what is given."""
    with torch.device("meta"):
        yield


DRAWN = [(draw_splats, ROOM), (draw_mesh, WALL), (draw_grid, FIELD)]


@pytest.mark.parametrize(("draw", "geometry"), DRAWN)
def test_what_is_drawn_is_made_on_the_device_of_the_scene(draw: Draw, geometry: Any, nowhere: None) -> None:
    planes = draw(geometry)
    assert {plane.device.type for plane in planes.values()} == {"cpu"}
    assert float(planes["alpha"].max()) > 0.5


@pytest.mark.parametrize(("draw", "geometry"), DRAWN)
def test_a_scene_is_drawn_elsewhere_than_its_cameras_lie(draw: Draw, geometry: Any) -> None:
    with SecondDevice():
        planes: dict[str, Any] = draw(moved(geometry, "meta"))
    here = draw(geometry)
    assert {name: plane.device.type for name, plane in planes.items()} == dict.fromkeys(here, "meta")
    for name, plane in planes.items():
        torch.testing.assert_close(plane.held, here[name], rtol=0, atol=0, equal_nan=True)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
@pytest.mark.parametrize(
    ("renderer", "geometry"), [(GaussianSplats, ROOM), (MeshRenderer, WALL), (NerfGridRenderer, FIELD)]
)
def test_cuda_draws_what_the_cpu_draws(renderer: Any, geometry: object) -> None:
    scene = Scene(geometry, None, torch.tensor([0.0, 0, 1]), "test", "0" * 64)
    here, there = (
        renderer(backend="torch", device=d).render(scene, CAMERA, renderer.provides) for d in ("cpu", "cuda")
    )
    for name in renderer.provides:
        a, b = here.require(name), there.require(name)
        assert ((a - b).abs() > 1e-3).float().mean() < 0.01, name


def test_moved_takes_every_tensor_along() -> None:
    there = moved(Pile(torch.zeros(2), (torch.ones(1), torch.ones(3)), (4, "five")), "meta")
    assert {part.device.type for part in (there.top, *there.below)} == {"meta"}
    assert there.rest == (4, "five")
    assert moved(CAMERA, "cpu").size == (20, 14)
    with pytest.raises(TypeError, match="expected a dataclass value, got int"):
        moved(3, "cpu")


def test_a_geometry_is_copied_to_its_device_once() -> None:
    room = synthetic_room(200)
    assert on_device(room, "cpu") is room
    assert on_device(room, "meta") is on_device(room, "meta")


@pytest.mark.parametrize("name", ["gaussian_splats", "mesh", "nerf_grid"])
def test_a_device_is_chosen_for_torch_alone(name: str) -> None:
    assert RENDERERS.build(name, {"backend": "torch", "device": "cuda"}).device == "cuda"
    with pytest.raises(UsageError, match="device cuda needs backend torch, got numba"):
        RENDERERS.build(name, {"device": "cuda"})
    with pytest.raises(UsageError, match="device"):
        RENDERERS.build(name, {"backend": "torch", "device": "tpu"})
