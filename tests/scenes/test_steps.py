from __future__ import annotations

import pytest
import torch

from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.errors import InputError
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.steps import check_steps

WIDE = 10.0


@pytest.fixture
def room():
    draw = torch.Generator().manual_seed(0)
    return WIDE * torch.rand(1000, 3, generator=draw)


@pytest.mark.parametrize(("away", "good"), [(0, True), (1e4, True), (1e5, False), (5e6, False)])
def test_a_room_may_lie_as_far_as_float32_tells_its_centimetres_apart(room, away, good):
    where = room + torch.tensor([0, away, 0])
    if good:
        check_steps("scan.ply", where)
        return
    with pytest.raises(InputError, match=r"scan.ply: lies 5?1?e\+0\d units from its origin, .*move it to its origin"):
        check_steps("scan.ply", where)


def test_a_town_may_lie_farther(room):
    check_steps("scan.ply", 100 * room + 1e5)


@pytest.mark.parametrize(
    ("size", "says"), [(10, "a scene of 8"), (0.3, "a scene of 1"), (0.1, "1000 places on one point")]
)
def test_a_scene_that_float32_has_put_on_one_point_is_refused(room, size, says):
    where = room * (size / WIDE) + torch.tensor([4.2e6, 4.3e6, 4.4e6])
    with pytest.raises(InputError, match=rf"scan.ply: lies 4.4e\+06 units .* steps of 0.52, too coarse for {says}"):
        check_steps("scan.ply", where)


def test_primitives_that_are_meant_to_share_a_point_may(room):
    check_steps("ball.ply", torch.tensor([[0.0, 3, 0]] * 5))
    check_steps("room.ply", torch.cat([room, room[:1].expand(2000, 3)]))


def test_one_primitive_is_anywhere():
    check_steps("one.ply", torch.tensor([[4e6, 0, 0]]))


@pytest.mark.parametrize("at", [1e5, 1e20, 3e38])
def test_a_face_of_its_own_is_not_anywhere(tmp_path, at):
    path = tmp_path / "face.obj"
    path.write_text(f"v {at} 0 0\nv {at} 1 0\nv {at} 0 1\nv 0 0 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"face.obj: lies .* units from its origin, .*too coarse for a scene of 2"):
        load_scene(path)
    path.with_suffix(".yaml").write_text(f"parts: [{{file: near.obj, translate: [{at:f}, 0, 0]}}]")
    path.with_name("near.obj").write_text("v 0 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n")
    assert len(load_scene(path.with_name("near.obj")).geometry) == 1
    with pytest.raises(InputError, match=r"face.yaml: lies .* units from its origin, .*too coarse for"):
        load_scene(path.with_suffix(".yaml"))


def test_scans_in_map_coordinates_are_refused_by_name(tmp_path):
    rows = [f"v {442_000.25 + x} {5_412_000.5 + y} {z}" for x in range(3) for y in range(3) for z in range(3)]
    rows += [f"f {i} {i + 1} {i + 3}" for i in range(1, 20)]
    (tmp_path / "map.obj").write_text("\n".join(rows))
    with pytest.raises(InputError, match=r"map.obj: lies 5.41e\+06 units from its origin, .* steps of 0.65"):
        load_scene(tmp_path / "map.obj")
    far = synthetic_room(200)
    far.means[:] += 1e6
    write_splats(tmp_path / "map.ply", far)
    with pytest.raises(InputError, match=r"map.ply: lies 1e\+06 units"):
        load_scene(tmp_path / "map.ply")
