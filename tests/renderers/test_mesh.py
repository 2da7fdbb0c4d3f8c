"""Numba against the torch oracle and a ray caster, and both against values worked out by hand."""

from __future__ import annotations

import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from cltransfer.bench.synthetic_room import room_cameras
from cltransfer.camera import Camera, intrinsics
from cltransfer.computer import memory
from cltransfer.drawing import renderer_of
from cltransfer.errors import ResourceError, UsageError
from cltransfer.features import Features
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.renderers.kernels import mesh as kernels
from cltransfer.renderers.mesh import MeshRenderer
from cltransfer.scenes import Scene
from cltransfer.scenes.meshes.mesh import Mesh

ALL = MeshRenderer.provides
BACKENDS = ("numba", "torch")


@pytest.fixture
def pools(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many threads were asked for, each time that several were."""
    asked: list[int] = []

    class Pool(ThreadPoolExecutor):
        def __init__(self, workers: int) -> None:
            asked.append(workers)
            super().__init__(workers)

    monkeypatch.setattr(kernels, "ThreadPoolExecutor", Pool)
    return asked


def scene_of(mesh: Mesh) -> Scene:
    return Scene(mesh, None, torch.tensor([0.0, 0.0, 1.0]), "test", "0" * 64)


def forward_camera(size: tuple[int, int], focal: float) -> Camera:
    return Camera(torch.eye(4).double()[None], intrinsics(torch.tensor([focal]).double(), size), size)


def quad(corners: list[list[float]], **changes: Tensor) -> Mesh:
    """Two triangles of four corners in turn."""
    return replace(Mesh.plain(torch.tensor(corners), torch.tensor([[0, 1, 2], [0, 2, 3]])), **changes)


def wall(depth: float, half: float) -> Mesh:
    """A grey square that faces the camera; its first corner is at the top left."""
    return Mesh.plain(*_square(depth, half))


def _square(depth: float, half: float) -> tuple[Tensor, Tensor]:
    corners = [[-half, -half, depth], [half, -half, depth], [half, half, depth], [-half, half, depth]]
    return torch.tensor(corners), torch.tensor([[0, 1, 2], [0, 2, 3]])


def furnished_room(detail: int, seed: int) -> Mesh:
    """A closed room with balls: painted, textured with holes, or grey; every third ball is labelled."""
    rng = np.random.default_rng(seed)
    parts = [trimesh.creation.box((8, 6, 3)).apply_translation([4, 3, 1.5])]
    for _ in range(9):
        ball = trimesh.creation.icosphere(detail, rng.uniform(0.3, 0.6))
        parts.append(ball.apply_translation(rng.uniform([1, 1, 0.4], [7, 5, 1.5])))
    meshes = []
    for i, part in enumerate(parts):
        vertices, faces = torch.tensor(part.vertices).float(), torch.tensor(part.faces)
        mesh = Mesh.plain(vertices, faces, torch.from_numpy(rng.random((len(vertices), 3))) if i % 3 else None)
        if i % 2:
            image = torch.from_numpy(rng.integers(0, 256, (5 + i, 4 + i, 4), dtype=np.uint8))
            texture, uv = torch.zeros(len(faces), dtype=torch.int32), 3 * vertices[:, :2]
            wraps = (("repeat", "repeat"), ("clamp", "mirror"), ("mirror", "clamp"))[i % 3]
            mesh = replace(mesh, uv=uv, texture=texture, textures=(image,), wraps=(wraps,))
        meshes.append(mesh.with_label(torch.full((len(faces),), float(i % 3 == 2))))
    return Mesh.concatenate(meshes)


def both(mesh: Mesh, cameras: Camera, **options: object) -> tuple[Features, Features]:
    both = [MeshRenderer(backend=name, **options) for name in BACKENDS]  # type: ignore[arg-type]
    fast, plain = (renderer.render(scene_of(mesh), cameras, ALL) for renderer in both)
    return fast, plain


@pytest.mark.parametrize(("size", "samples"), [((80, 45), 1), ((33, 17), 2), ((1, 1), 1)])
def test_numba_matches_the_oracle(size, samples):
    fast, plain = both(furnished_room(2, seed=1), room_cameras(3, size), samples=samples)
    assert torch.equal(fast.depth.isnan(), plain.depth.isnan())
    differs = (fast.depth - plain.depth).abs() > 1e-5 * plain.depth
    assert differs.float().mean() < 1e-3
    assert ((fast.image - plain.image).abs() > 1e-4).float().mean() < 1e-3
    assert torch.equal(fast.label, plain.label)
    assert torch.equal(fast.alpha, plain.alpha)
    assert 0 < fast.label.mean() < 1 or size == (1, 1)


def test_depth_is_where_rays_meet_the_triangles():
    """A ray caster of its own: every ray against every triangle, by trimesh's planes and barycentrics."""
    rng = np.random.default_rng(2)
    balls = [trimesh.creation.icosphere(1, r).apply_translation(rng.uniform(-1, 1, 3)) for r in (0.5, 0.7, 0.4)]
    solid = trimesh.util.concatenate([trimesh.creation.box((6, 5, 4)), *balls])
    cameras = Camera.look_at(
        torch.tensor([[2.0, -1.5, 1.0], [0.3, 0.2, 1.8]]), torch.zeros(1, 3), torch.tensor([0.1, 0, 1.0]), 1.2, (64, 36)
    )
    mesh = Mesh.plain(torch.tensor(solid.vertices), torch.tensor(solid.faces))
    depth = MeshRenderer().render(scene_of(mesh), cameras, frozenset({"depth"})).depth.flatten(1)
    assert depth.isfinite().all()  # the room is closed
    y, x = torch.meshgrid(torch.arange(36) + 0.5, torch.arange(64) + 0.5, indexing="ij")
    pixels = torch.stack([x, y], -1).reshape(1, -1, 2).expand(2, -1, 2)
    ends = cameras.unproject(pixels, torch.ones(2, 64 * 36))
    for b in range(2):
        eye = cameras.center[b].numpy()
        nearest = cast(solid, eye, ends[b].numpy() - eye)
        off = np.abs(depth[b].numpy() - nearest) > 1e-3 * nearest
        assert off.mean() <= 1e-3


def cast(solid: trimesh.Trimesh, eye: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Distance along each direction to the nearest triangle."""
    nearest = np.full(len(directions), np.inf)
    for triangle, normal in zip(solid.triangles, solid.face_normals):
        t = ((triangle[0] - eye) @ normal) / (directions @ normal)
        weights = trimesh.triangles.points_to_barycentric(
            np.repeat(triangle[None], len(t), 0), eye + t[:, None] * directions
        )
        hit = (t > 0) & (weights >= -1e-9).all(1)
        nearest[hit] = np.minimum(nearest[hit], t[hit])
    return nearest


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_wall_has_the_values_worked_out_by_hand(backend):
    # 12 px focal and half a unit at depth 3: 2 px to each side of 4.4, so the centres 2.5 to 5.5
    mesh = wall(3.0, 0.5).with_label(torch.ones(2))
    camera = forward_camera((9, 9), 12.0)
    camera.K[0, :2, 2] = 4.4
    got = MeshRenderer(backend=backend).render(scene_of(mesh), camera, ALL)
    inside = torch.zeros(1, 9, 9)
    inside[:, 2:6, 2:6] = 1
    assert torch.equal(got.alpha, inside)
    assert torch.equal(got.label, inside)
    for depth in (got.depth, got.expected_depth):
        torch.testing.assert_close(depth, torch.where(inside == 1, 3.0, torch.nan), equal_nan=True)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_mesh_without_faces_is_nothing(backend):
    mesh = Mesh.plain(torch.zeros(0, 3), torch.zeros(0, 3, dtype=torch.int32))
    got = MeshRenderer(backend=backend, samples=2).render(scene_of(mesh), forward_camera((9, 5), 8.0), ALL)
    assert not any(bool(plane.any()) for plane in (got.alpha, got.image, got.label))
    assert bool(got.depth.isnan().all() and got.expected_depth.isnan().all())


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("backend", BACKENDS)
def test_of_two_faces_at_one_place_the_first_is_seen(backend, turned):
    corners = torch.tensor([[-1.0, -1, 3.13], [1, -1, 3.37], [0, 1, 3.11]])
    faces = torch.tensor([[0, 1, 2], [5, 4, 3] if turned else [3, 4, 5]])
    mesh = Mesh.plain(corners.repeat(2, 1), faces).with_label(torch.tensor([1.0, 0.0]))
    got = MeshRenderer(backend=backend).render(scene_of(mesh), forward_camera((64, 48), 60.0), ALL)
    assert got.alpha.sum() > 500
    assert torch.equal(got.label, got.alpha)


@pytest.mark.parametrize("backend", BACKENDS)
def test_colour_and_texture_are_right_in_perspective(backend):
    # a floor from depth 1 to 9: at depth 2 it is an eighth of the way, not halfway down the frame
    floor = [[-1.0, 1, 1], [1.0, 1, 1], [1.0, 1, 9], [-1.0, 1, 9]]
    ramp = torch.tensor([[0.0] * 3, [0.0] * 3, [1.0] * 3, [1.0] * 3])
    painted = quad(floor, colors=ramp, shaded=torch.zeros(2, dtype=torch.bool))
    size = (20, 20)
    camera = forward_camera(size, 10.0)
    got = MeshRenderer(backend=backend).render(scene_of(painted), camera, ALL)
    row = 14  # centre 14.5: 4.5 px under the middle, so depth 10 / 4.5
    assert float(got.depth[0, row, 10]) == pytest.approx(10 / 4.5, rel=1e-6)
    assert float(got.image[0, 0, row, 10]) == pytest.approx((10 / 4.5 - 1) / 8, rel=1e-5)
    image = torch.zeros(2, 1, 4, dtype=torch.uint8)
    image[0], image[1] = torch.tensor([0, 0, 0, 255]), torch.tensor([255, 255, 255, 255])
    uv = torch.tensor([[0.0, 0.25], [1.0, 0.25], [1.0, 0.75], [0.0, 0.75]])  # from one texel's middle to the other's
    plain = replace(
        painted, colors=torch.ones(4, 3), uv=uv, texture=torch.zeros(2, dtype=torch.int32), textures=(image,)
    )
    textured = MeshRenderer(backend=backend).render(scene_of(plain), camera, ALL)
    torch.testing.assert_close(textured.image, got.image, atol=1e-5, rtol=0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_texture_stands_upright_and_its_holes_show_what_is_behind(backend):
    image = torch.full((2, 2, 4), 255, dtype=torch.uint8)
    image[0, 0] = torch.tensor([255, 0, 0, 255])  # top left
    image[1, 1, 3] = 0  # a hole at the bottom right
    front = replace(
        Mesh.plain(*_square(2.0, 1.0), colors=torch.ones(4, 3)),
        uv=torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]]),
        texture=torch.zeros(2, dtype=torch.int32),
        textures=(image,),
    )
    mesh = Mesh.concatenate([front, wall(4.0, 2.0).with_label(torch.ones(2))])
    got = MeshRenderer(backend=backend).render(scene_of(mesh), forward_camera((6, 6), 6.0), ALL)
    assert got.image[0, :, 1, 1].tolist() == [1.0, 0.0, 0.0]  # centres 1 and 4 are the texels' middles
    assert got.image[0, :, 1, 4].tolist() == [1.0, 1.0, 1.0]
    hole = torch.zeros(6, 6)
    hole[3:, 3:] = 1
    assert torch.equal(got.label[0], hole)
    assert torch.equal(got.depth[0], 2 + 2 * hole)


BEYOND = {"repeat": [0, 1, 0, 1, 0, 1], "clamp": [0, 0, 0, 1, 1, 1], "mirror": [1, 0, 0, 1, 1, 0]}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("wrap", BEYOND)
@pytest.mark.parametrize("down", [False, True])
def test_a_texture_goes_on_beyond_its_edges_as_it_says(backend, wrap, down):
    image = torch.tensor([[[255, 0, 0, 255], [255, 255, 255, 0]]]).to(torch.uint8)  # the second is a hole
    uv, wraps = torch.tensor([[-1.0, 0], [2, 0], [2, 1], [-1, 1]]), (wrap, "repeat")
    if down:
        image, uv, wraps = image.transpose(0, 1), uv.flip(1)[[0, 3, 2, 1]], ("repeat", wrap)
    plain = Mesh.plain(*_square(2.0, 1.0), colors=torch.ones(4, 3))
    mesh = replace(plain, uv=uv, texture=torch.zeros(2, dtype=torch.int32), textures=(image,), wraps=(wraps,))
    got = MeshRenderer(backend=backend).render(scene_of(mesh), forward_camera((6, 6), 6.0), ALL)
    assert (got.alpha[0, :, 0] if down else got.alpha[0, 0]).tolist() == [1 - hole for hole in BEYOND[wrap]]
    solid = replace(mesh, textures=(image | torch.tensor([0, 0, 0, 255]).to(torch.uint8),))
    got = MeshRenderer(backend=backend).render(scene_of(solid), forward_camera((6, 6), 6.0), ALL)
    assert (got.image[0, 1, :, 0] if down else got.image[0, 1, 0]).tolist() == pytest.approx(BEYOND[wrap], abs=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("wrap", "share"), [("repeat", 0.25), ("clamp", 0.0), ("mirror", 0.0)])
def test_a_texture_shows_its_other_side_at_its_edges_only_where_it_repeats(backend, wrap, share):
    image = torch.tensor([[[0, 0, 0, 255], [255, 255, 255, 255]]]).to(torch.uint8)
    plain = Mesh.plain(*_square(2.0, 1.0), colors=torch.ones(4, 3))
    uv = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    shows = {"texture": torch.zeros(2, dtype=torch.int32), "textures": (image,), "wraps": ((wrap, wrap),)}
    got = MeshRenderer(backend=backend).render(
        scene_of(replace(plain, uv=uv, **shows)), forward_camera((4, 4), 4.0), ALL
    )
    assert got.image[0, 0, 1].tolist() == pytest.approx([share, 0.25, 0.75, 1 - share], abs=1e-6)


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
@pytest.mark.parametrize("place", [1e30, -1e30, 9.3e18, -1e-20, math.inf, -math.inf, math.nan])
def test_a_place_far_outside_a_texture_stays_in_it(place, wrap):
    image = torch.tensor([[[255, 0, 0, 200], [0, 255, 0, 60]], [[0, 0, 255, 255], [255, 255, 255, 255]]])
    textured = replace(
        Mesh.plain(*_square(2.0, 1.0), colors=torch.ones(4, 3)),
        uv=torch.full((4, 2), place),
        texture=torch.zeros(2, dtype=torch.int32),
        textures=(image.to(torch.uint8),),
        wraps=((wrap, wrap),),
    )
    mesh = Mesh.concatenate([textured, wall(4.0, 2.0)])
    fast, plain = (MeshRenderer(backend=b).render(scene_of(mesh), forward_camera((4, 4), 4.0), ALL) for b in BACKENDS)
    torch.testing.assert_close(fast.image, plain.image, atol=1e-5, rtol=0)
    assert torch.equal(fast.depth, plain.depth)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_face_through_the_camera_is_cut_at_the_near_plane(backend):
    floor = quad([[-50.0, 1, -50], [50.0, 1, -50], [50.0, 1, 50], [-50.0, 1, 50]])
    camera = forward_camera((40, 40), 20.0)
    got = MeshRenderer(backend=backend, near=2.0).render(scene_of(floor), camera, ALL)
    below = torch.arange(40) + 0.5 - 20  # px under the middle; depth is focal / it
    expected = torch.where((below > 0) & (20 / below >= 2.0) & (20 / below <= 50), 20 / below, torch.nan)
    torch.testing.assert_close(got.depth[0, :, 20], expected, equal_nan=True, rtol=1e-5, atol=0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_closed_room_has_no_seams(backend):
    room = trimesh.creation.icosphere(3, 3.0)
    mesh = Mesh.plain(torch.tensor(room.vertices), torch.tensor(room.faces))
    turns = torch.tensor([[1.0, 0, 0], [0, 1, 0.1], [0, 0.1, 1], [1, 1, 1]])
    cameras = Camera.look_at(torch.zeros(1, 3), turns, torch.tensor([0.3, 0.2, 1.0]), 1.5, (63, 64))
    assert bool((MeshRenderer(backend=backend).render(scene_of(mesh), cameras, frozenset({"alpha"})).alpha == 1).all())


def test_seams_on_pixel_centres_are_drawn_once_and_closed():
    strips = [
        quad([[x, -2.0, 2], [x + 0.25, -2.0, 2], [x + 0.25, 2.0, 2], [x, 2.0, 2]]) for x in np.arange(-2, 2, 0.25)
    ]
    K = intrinsics(torch.tensor([8.0]).double(), (17, 17))
    K[0, :2, 2] = 8.5  # strips of one pixel that begin and end on centres
    camera = Camera(torch.eye(4).double()[None], K, (17, 17))
    alpha = MeshRenderer().render(scene_of(Mesh.concatenate(strips)), camera, frozenset({"alpha"})).alpha
    assert bool((alpha[0, 1:-1, 1:-1] == 1).all())


def test_more_samples_smooth_edges_and_keep_depth_on_surfaces():
    mesh = Mesh.concatenate([wall(2.0, 0.55).with_label(torch.ones(2)), wall(8.0, 40.0)])
    camera = forward_camera((16, 16), 16.0)
    one, four = (MeshRenderer(samples=n).render(scene_of(mesh), camera, ALL) for n in (1, 4))
    assert one.label.unique().tolist() == [0.0, 1.0]
    assert four.label.mean() == pytest.approx((0.55 * 16) ** 2 / 256, rel=0.05)  # the square's area in pixels
    assert set(four.depth.unique().tolist()) <= {2.0, 8.0}
    assert len(four.expected_depth.unique()) > 2
    assert float(four.alpha.min()) == 1.0


def test_the_headlight_follows_the_cosine_and_spares_painted_faces():
    leaning = quad([[-2.0, -2, 2], [2.0, -2, 2], [2.0, 2, 6], [-2.0, 2, 6]])  # 45 degrees to the middle ray
    camera = forward_camera((9, 9), 9.0)
    for light in (0.0, 0.6, 1.0):
        image = MeshRenderer(headlight=light).render(scene_of(leaning), camera, frozenset({"image"})).image
        assert float(image[0, 0, 4, 4]) == pytest.approx(0.8 * (1 - light + light / math.sqrt(2)), rel=1e-5)
    painted = replace(leaning, shaded=torch.zeros(2, dtype=torch.bool))
    image = MeshRenderer(headlight=1.0).render(scene_of(painted), camera, frozenset({"image"})).image
    assert float(image[0, 0, 4, 4]) == pytest.approx(0.8)


@pytest.mark.parametrize("side", [1e-5, 1e-9])
@pytest.mark.parametrize("backend", BACKENDS)
def test_small_faces_are_lit_as_large_ones(backend, side):
    leaning = quad([[-2.0, -2, 2], [2.0, -2, 2], [2.0, 2, 6], [-2.0, 2, 6]])
    small, camera = replace(leaning, vertices=leaning.vertices * side / 4), forward_camera((9, 9), 9.0)
    large, tiny = (
        MeshRenderer(backend=backend, near=near).render(scene_of(mesh), camera, frozenset({"image"})).image
        for mesh, near in ((leaning, 1.0), (small, side / 4))
    )
    assert large.max() > 0.5
    torch.testing.assert_close(tiny, large, atol=1e-5, rtol=0)


def test_threads_do_not_change_the_result():
    scene, cameras = scene_of(furnished_room(1, seed=3)), room_cameras(5, (40, 24))
    one, three = (MeshRenderer(threads=n).render(scene, cameras, ALL) for n in (1, 3))
    for name in ALL:
        torch.testing.assert_close(one.require(name), three.require(name), rtol=0, atol=0, equal_nan=True)


def test_degenerate_faces_draw_nothing():
    flat = torch.tensor([[[0.0, 0, 2], [0.0, 0, 2], [1.0, 1, 2]], [[0.0, 0, 2], [1.0, 0, 2], [2.0, 0, 2]]])
    through_the_eye = torch.tensor([[[0.0, 0, 1], [0.0, 1, 2], [0.0, -1, 2]]])
    vertices = torch.cat([flat, through_the_eye]).reshape(-1, 3)
    mesh = Mesh.plain(vertices, torch.arange(9).reshape(3, 3))
    for backend in BACKENDS:
        got = MeshRenderer(backend=backend).render(scene_of(mesh), forward_camera((8, 8), 8.0), ALL)
        assert not got.alpha.any()


def test_a_scene_of_another_kind_names_the_renderer_that_draws_it():
    scene = replace(scene_of(wall(2.0, 1.0)), name="stage")
    camera = forward_camera((8, 8), 8.0)
    with pytest.raises(UsageError) as error:
        GaussianSplats().render(scene, camera, frozenset({"depth"}))
    assert str(error.value) == "stage: renderer gaussian_splats: does not draw Mesh (choose: renderer.mesh={})"
    with pytest.raises(UsageError, match="has no buffer normals"):
        MeshRenderer().render(scene, camera, frozenset({"normals"}))
    with pytest.raises(ValueError, match="finite"):
        MeshRenderer().render(scene, replace(camera, w2c=camera.w2c * math.nan), ALL)


def test_options_out_of_range_are_refused():
    for options in ({"near": 0.0}, {"samples": 0}, {"samples": 9}, {"headlight": 1.5}, {"threads": -1}):
        with pytest.raises(ValueError, match=next(iter(options))):
            MeshRenderer(**options)


def test_a_second_process_finds_the_kernels_compiled(within):
    code = """
import time
import numpy as np
from cltransfer.renderers.kernels.mesh import Packed, Settings, Views, pack_images, render
start = time.perf_counter()
corners = np.array([[-1, -1, 2], [1, -1, 2], [0, 1, 2]], np.float32)
index, ones = np.arange(3, dtype=np.int32)[None], np.ones(3, np.float32)
uv, none = corners[:, :2].copy(), index[0, :1] - 1
packed = Packed(corners, index, corners, uv, ones[:1], ones[:1] > 0, none, *pack_images([], []))
seen = render(packed, Views(np.eye(4)[None], np.array([[8.0, 8, 4, 4]]), (8, 8)), Settings(0.1, 0.5, 1), True, 1)
print(int(seen.alpha.sum()), time.perf_counter() - start)
"""
    run = [sys.executable, "-c", code]
    answers = [subprocess.run(run, capture_output=True, text=True, check=True).stdout.split() for _ in range(2)]
    covered, seconds = answers[1]
    assert int(covered) > 8
    assert within(float(seconds), 1.0)


def test_a_reference_scene_of_another_kind_is_drawn_by_its_own_renderer():
    scene, splats = scene_of(wall(2.0, 1.0)), GaussianSplats(near=0.5)
    assert renderer_of(scene, splats) == MeshRenderer()
    assert renderer_of(scene, MeshRenderer(samples=3)) == MeshRenderer(samples=3)
    assert renderer_of(replace(scene, geometry=object()), splats) is splats


def test_fewer_threads_draw_where_their_rays_would_not_fit_and_the_pixels_are_the_same(
    monkeypatch: pytest.MonkeyPatch, pools: list[int]
) -> None:
    scene = scene_of(quad([[-1.0, -1, 2], [1, -1, 2], [1, 1, 2.5], [-1, 1, 2.5]]))
    cameras, renderer = room_cameras(3, (160, 90)), MeshRenderer(samples=8, threads=3)
    frames, need = 3 * 160 * 90 * 28, kernels.scratch_bytes(4, cameras.size, 8, True)
    drawn = []
    two = frames + 2 * (need + memory.THREAD)
    for free in (None, two, two - 1):
        monkeypatch.setattr(memory, "free_bytes", lambda free=free: free)
        drawn.append(renderer.render(scene, cameras, ALL))
    assert pools == [3, 2]  # one draws by itself
    for name in ALL:
        assert len({d.require(name).numpy().tobytes() for d in drawn}) == 1
    large = forward_camera((320, 180), 100.0)
    monkeypatch.setattr(memory, "free_bytes", lambda: 9 * 2**20)
    with pytest.raises(
        ResourceError, match=r"^memory: 8x8 rays a pixel of frames of 320x180 need 128 MB, 9 MB .*fewer samples\)"
    ):
        renderer.render(scene, large, ALL)
    monkeypatch.setattr(memory, "LITTLE", 0)
    monkeypatch.setattr(memory, "free_bytes", lambda: 0)
    with pytest.raises(ResourceError, match=r"^memory: 1x1 rays a pixel .* 0 MB are free .*draw smaller frames\)"):
        MeshRenderer().render(scene, forward_camera((1920, 1080), 500.0), ALL)


def test_no_pixel_is_nearer_than_near_of_a_face_that_goes_through_it_aslant() -> None:
    """Its depth falls along the frame's diagonal, so that no box of pixels ends where it is cut."""
    places = torch.tensor([[-4.0, -4, 6], [4, -4, 2], [4, 4, -2.0], [-4, 4, 2]])
    mesh = Mesh.plain(places, torch.tensor([[0, 1, 2], [0, 2, 3]]))
    camera = Camera(torch.eye(4)[None], intrinsics(torch.tensor([16.0]).double(), (32, 32)), (32, 32))
    scene = Scene(mesh, None, torch.tensor([0.0, 1, 0]), "quad", "")
    depth = MeshRenderer(backend="numba", near=1.7).render(scene, camera, frozenset({"depth"})).require("depth")
    assert float(depth[depth.isfinite()].min()) >= 1.7
