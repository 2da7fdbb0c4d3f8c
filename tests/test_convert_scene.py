from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from cltransfer.bench.synthetic_room import room_cameras, synthetic_room
from cltransfer.camera import Camera
from cltransfer.convert_scene import Simplification, bake_to_folder, given_views, simplify_file
from cltransfer.errors import InputError, UsageError
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import load_person
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.simplify import joined, subset
from cltransfer.scenes.splats import Splats
from cltransfer.storage.files import JSON_LIMIT
from cltransfer.trajectory import Trajectory

MAN = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "mesh" / "cesium_man.glb"


@pytest.fixture
def room(tmp_path: Path) -> tuple[str, str]:
    """A scene file and a view file."""
    write_splats(tmp_path / "room.ply", synthetic_room(20_000))
    view = Trajectory(room_cameras(2, (640, 360)), torch.tensor([0.0, 1.0], dtype=torch.float64))
    view.save(tmp_path / "view.json")
    return str(tmp_path / "room.ply"), str(tmp_path / "view.json")


@pytest.mark.parametrize("z_up", [False, True])
def test_a_simplified_scene_tells_as_its_source_does_that_z_is_up(
    room: tuple[str, str], tmp_path: Path, z_up: bool
) -> None:
    write_splats(tmp_path / "stage.ply", synthetic_room(200), z_up=z_up)
    found = simplify_file(str(tmp_path / "stage.ply"), tmp_path / "few.ply", [room[1]], Simplification(k=1))
    assert load_scene(found["file"]).up.tolist() == ([0, 0, 1] if z_up else [0, -1, 0])


def test_a_simplified_scene_is_a_scene_with_fewer_gaussians(room: tuple[str, str], tmp_path: Path) -> None:
    found = simplify_file(room[0], tmp_path / "few.ply", [room[1]], Simplification(k=6, prune=0.005))
    assert found["before"] == 20_000 > found["pruned"] > found["after"] == len(load_scene(found["file"]).geometry)
    merged_only = simplify_file(room[0], tmp_path / "few.ply", [room[1]], Simplification(k=6))
    assert merged_only["pruned"] == 20_000
    larger = simplify_file(room[0], tmp_path / "few.ply", [room[1]], Simplification(k=6, side=640))
    assert larger["after"] > merged_only["after"]  # seen larger, it needs more


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["k=2"], "after merging"),
        (["k=0", "prune=0.005"], "after pruning"),
        (["k=0", "floaters=drop"], "without floaters"),
    ],
)
def test_only_what_was_done_is_told(
    options: list[str], told: str, room: tuple[str, str], command: Callable[..., Any], tmp_path: Path
) -> None:
    answer = command("simplify", room[0], "--view", room[1], "--out", tmp_path / "few.ply", *options)
    assert answer.code == 0, answer.err
    words = [word for word in ("without floaters", "after pruning", "after merging") if word in answer.out]
    assert words == [told]


def test_floaters_can_be_left_out_and_nothing_else(command: Callable[..., Any], tmp_path: Path) -> None:
    scene = load_scene("builtin:room")
    geometry = scene.geometry
    assert isinstance(geometry, Splats)
    high = geometry.means.amax(0) + 5 * torch.arange(1, 4)[:, None]  # three far away from one another
    three = replace(subset(geometry, torch.arange(3)), means=high)
    write_splats(tmp_path / "room.ply", joined(geometry, three))
    answer = command(
        "simplify", tmp_path / "room.ply", "--out", tmp_path / "clean.ply", "k=0", "floaters=drop", "--json"
    )
    assert answer.code == 0, answer.err
    found = json.loads(answer.out)
    assert found["before"] == len(geometry) + 3
    assert found["before"] - 3 >= found["solid"] == found["pruned"] == found["after"] > 0.99 * len(geometry)
    cleaned = load_scene(str(tmp_path / "clean.ply")).geometry
    assert float(cleaned.means.max()) <= float(geometry.means.max())


def test_views_come_from_trajectories_and_posed_sets_at_one_size(room: tuple[str, str], tmp_path: Path) -> None:
    cameras = room_cameras(3, (64, 36))
    frames = [{"file_path": f"{i}.png", "transform_matrix": p.tolist()} for i, p in enumerate(cameras.to_opengl())]
    (tmp_path / "set").mkdir()
    data = {"w": 64, "h": 36, "fl_x": float(cameras.focal[0]), "frames": frames}
    (tmp_path / "set" / "transforms.json").write_text(json.dumps(data))
    views = given_views([room[1], f"{tmp_path / 'set'}:2", str(tmp_path / "set" / "transforms.json")], 160)
    assert len(views) == 2 + 1 + 3
    assert views.size == (160, 90)
    torch.testing.assert_close(views.center[2], cameras.center[2])


def test_whether_a_view_is_a_trajectory_is_told_by_what_it_holds(tmp_path: Path) -> None:
    frame = {"file_path": "a.png", "transform_matrix": torch.eye(4).tolist()}
    (tmp_path / "transforms_train.json").write_text(json.dumps({"w": 64, "h": 36, "fl_x": 50, "frames": [frame] * 99}))
    Trajectory(room_cameras(2, (64, 36)), torch.tensor([0.0, 1.0]).double()).save(tmp_path / "cameras.json")
    row = torch.tensor([[0.0, 1, 0, 0, 36], [1, 0, 0, 0, 64], [0, 0, -1, 0, 50]]).ravel()
    np.save(tmp_path / "poses.npy", np.concatenate([row, [1, 9]])[None].repeat(3, 0))
    for name, count in (("transforms_train.json", 99), ("cameras.json", 2), ("poses.npy", 3)):
        assert len(given_views([str(tmp_path / name)], 64)) == count
    (tmp_path / "notes.txt").write_text("no views")
    with pytest.raises(InputError, match=r"notes.txt: is no posed image set"):
        given_views([str(tmp_path / "notes.txt")], 64)
    (tmp_path / "huge.json").write_text("{" + " " * JSON_LIMIT)
    with pytest.raises(InputError, match=rf"huge.json: expected at most {JSON_LIMIT} bytes"):
        given_views([str(tmp_path / "huge.json")], 64)


def test_of_a_folder_with_a_path_in_it_the_file_is_named(tiny_run: Path) -> None:
    with pytest.raises(InputError, match=r"expected a file, got a folder \(name a file in it: trajectory.json or subj"):
        given_views([str(tiny_run)], 64)


def test_where_nothing_can_be_written_is_told_before_anything_is_read(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=r"--out: cannot lie in .*file, which is a file"):
        simplify_file(str(tmp_path / "gone.ply"), tmp_path / "file" / "out.ply", [], Simplification())


def test_what_is_no_scene_of_splats_is_told_before_its_views_are_asked_for(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        simplify_file(str(tmp_path / "gone.ply"), tmp_path / "out.ply", [], Simplification())
    with pytest.raises(UsageError, match="expected Gaussian splats, got Mesh"):
        simplify_file("builtin:courtyard-0-mesh", tmp_path / "out.ply", [], Simplification())


@pytest.mark.parametrize("order", [("high", "wide"), ("wide", "high")])
def test_no_view_is_cut_to_the_shape_of_another(tmp_path: Path, order: tuple[str, str]) -> None:
    up = torch.tensor([0.0, -1, 0])
    for name, size in (("high", (90, 160)), ("wide", (160, 90))):
        camera = Camera.look_at(torch.tensor([[0.0, 0, -4]]), torch.zeros(1, 3), up, 0.8, size)
        Trajectory(camera, torch.tensor([0.0], dtype=torch.float64)).save(tmp_path / f"{name}.json")
    places = torch.rand(2_000, 3, generator=torch.Generator().manual_seed(0)) - 0.5
    wall = replace(synthetic_room(2_000), means=places * torch.tensor([6.0, 3, 0.2]))
    write_splats(tmp_path / "wall.ply", replace(wall, scales=torch.full((2_000, 3), 0.05)))

    def left(*views: str) -> int:
        files = [str(tmp_path / f"{name}.json") for name in views]
        options = Simplification(k=0, prune=0.01)
        found = simplify_file(str(tmp_path / "wall.ply"), tmp_path / "few.ply", files, options)
        return int(found["after"])

    assert left("wide") > 1.5 * left("high")
    assert left(*order) >= left("wide")


@pytest.mark.parametrize("view", [":3", ""])
def test_an_image_of_a_set_is_not_cut_to_the_shape_of_the_others(tmp_path: Path, view: str) -> None:
    eyes = torch.tensor([[1.0, 0, -4], [2, 0, -4], [3, 0, -4], [0, 0, -4]])
    cameras = Camera.look_at(eyes, eyes + torch.tensor([0, 0, 1.0]), torch.tensor([0.0, -1, 0]), 0.8, (4, 4))
    frames = [{"file_path": f"{i}.png", "transform_matrix": p.tolist()} for i, p in enumerate(cameras.to_opengl())]
    frames[3] = {**frames[3], "w": 480, "h": 640}
    (tmp_path / "transforms.json").write_text(json.dumps({"w": 640, "h": 480, "fl_x": 600, "frames": frames}))
    places = torch.tensor([[0.0, 0, 0], [0, 4 * (580 - 320) / 600, 0]])  # in the middle, and below, of the upright one
    two = replace(subset(synthetic_room(2), torch.arange(2)), means=places, scales=torch.full((2, 3), 0.02))
    write_splats(tmp_path / "two.ply", replace(two, opacity=torch.full((2,), 0.9)))
    options = Simplification(k=0, prune=0.01)
    found = simplify_file(str(tmp_path / "two.ply"), tmp_path / "few.ply", [f"{tmp_path}{view}"], options)
    assert found["after"] == 2


@pytest.mark.parametrize("unit", [2.0**-7, 2.0**7])
def test_what_is_pruned_does_not_depend_on_the_unit(tmp_path: Path, unit: float) -> None:
    room, cameras = synthetic_room(5_000), room_cameras(2, (160, 90))
    counts = []
    for scale in (1.0, unit):
        w2c = cameras.w2c.clone()
        w2c[:, :3, 3] *= scale
        write_splats(tmp_path / "room.ply", replace(room, means=room.means * scale, scales=room.scales * scale))
        Trajectory(replace(cameras, w2c=w2c), torch.arange(2).double()).save(tmp_path / "view.json")
        files = (str(tmp_path / "room.ply"), tmp_path / "few.ply", [str(tmp_path / "view.json")])
        counts.append(simplify_file(*files, Simplification(k=0, prune=0.005))["after"])
    assert counts[0] == pytest.approx(counts[1], abs=5)
    assert counts[0] > 1_000


@pytest.mark.parametrize("unit", [0.02, 1.0, 50.0])
def test_what_hangs_before_the_lens_is_kept_and_hides_nothing(tmp_path: Path, unit: float) -> None:
    eye = Camera(
        torch.eye(4).double()[None], torch.tensor([[[80.0, 0, 80], [0, 80, 45], [0, 0, 1]]]).double(), (160, 90)
    )
    places = torch.rand(3_000, 3, generator=torch.Generator().manual_seed(0)) - 0.5
    wall = replace(
        synthetic_room(3_000), means=unit * (places * torch.tensor([9.0, 5, 0.2]) + torch.tensor([0, 0, 4.0]))
    )
    wall = replace(wall, scales=torch.full((3_000, 3), 0.05 * unit))
    leaf = replace(subset(wall, torch.tensor([0])), means=torch.tensor([[0, 0, 0.05 * unit]]), opacity=torch.ones(1))
    write_splats(tmp_path / "wall.ply", joined(leaf, wall))
    write_splats(tmp_path / "bare.ply", wall)
    Trajectory(eye, torch.tensor([0.0]).double()).save(tmp_path / "view.json")

    def left(name: str) -> int:
        files = (str(tmp_path / name), tmp_path / "few.ply", [str(tmp_path / "view.json")])
        return int(simplify_file(*files, Simplification(k=0, prune=0.005))["after"])

    assert left("wall.ply") == left("bare.ply") + 1 > 2_000


def test_a_view_with_its_principal_point_aside_keeps_what_it_shows(room: tuple[str, str], tmp_path: Path) -> None:
    cameras = room_cameras(1, (160, 90))
    K = cameras.K.clone()
    K[:, 0, 2] -= 80
    off = replace(cameras, K=K)
    Trajectory(off, torch.tensor([0.0], dtype=torch.float64)).save(tmp_path / "off.json")
    options = Simplification(k=0, prune=0.005)
    simplify_file(room[0], tmp_path / "few.ply", [str(tmp_path / "off.json")], options)
    scenes = (load_scene(room[0]), load_scene(str(tmp_path / "few.ply")))
    whole, few = (GaussianSplats().render(scene, off, frozenset({"alpha"})).require("alpha") for scene in scenes)
    assert float((whole - few).max()) < 0.2


def test_what_cannot_be_simplified_is_said(room: tuple[str, str], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--view: expected at least one"):
        simplify_file(room[0], tmp_path / "few.ply", [], Simplification())
    with pytest.raises(UsageError, match="--view: expected at least one"):
        simplify_file(room[0], tmp_path / "few.ply", [], Simplification(k=0))  # there is nothing to do
    with pytest.raises(UsageError, match=r"--out: expected a \.ply file"):
        simplify_file(room[0], tmp_path / "few.obj", [room[1]], Simplification())
    with pytest.raises(InputError, match="prune: leaves no Gaussian"):
        simplify_file(room[0], tmp_path / "few.ply", [room[1]], Simplification(prune=1.0))
    assert not (tmp_path / "few.ply").exists()
    trimesh.creation.box().export(tmp_path / "box.obj")
    with pytest.raises(UsageError, match="expected Gaussian splats, got Mesh"):
        simplify_file(str(tmp_path / "box.obj"), tmp_path / "few.ply", [room[1]], Simplification())


def test_a_scene_is_not_written_over_itself(room: tuple[str, str], tmp_path: Path) -> None:
    before = Path(room[0]).read_bytes()
    with pytest.raises(UsageError, match=r"--out: is the scene itself"):
        simplify_file(room[0], Path(room[0]), [room[1]], Simplification())
    assert Path(room[0]).read_bytes() == before
    trimesh.creation.box().export(tmp_path / "box.ply")
    before = (tmp_path / "box.ply").read_bytes()
    with pytest.raises(UsageError, match=r"box.ply: --out: is the scene itself"):
        bake_to_folder(str(tmp_path / "box.ply"), tmp_path, "gaussian_splats", 500)
    assert (tmp_path / "box.ply").read_bytes() == before
    (tmp_path / "box.yaml").write_text("parts:\n  - file: box.ply\n")
    with pytest.raises(UsageError, match=r"box.ply: --out: is a part of the scene"):
        bake_to_folder(str(tmp_path / "box.yaml"), tmp_path, "gaussian_splats", 500)
    assert (tmp_path / "box.ply").read_bytes() == before
    bake_to_folder(str(tmp_path / "box.yaml"), tmp_path / "baked", "gaussian_splats", 500)


def test_the_person_of_a_run_is_not_written_over(command: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text('{"format": "cltransfer.run"}')
    (tmp_path / "subject.json").write_text("of the run")
    trimesh.creation.box().export(tmp_path / "box.obj")
    answer = command("bake", tmp_path / "box.obj", "--out", tmp_path)
    assert (answer.code, answer.err.count("\n")) == (2, 1)
    assert "expected another folder than that of a run, whose own subject and labels have the same names" in answer.err
    assert (tmp_path / "subject.json").read_text() == "of the run"


def test_a_bake_tells_what_it_does_but_not_quietly(command: Callable[..., Any], tmp_path: Path) -> None:
    trimesh.creation.box().export(tmp_path / "box.obj")
    words = ("bake", tmp_path / "box.obj", "--out", tmp_path / "baked", "--detail", 500)
    told, quiet = command(*words), command(*words, "-q")
    assert (told.code, told.err) == (0, "reading the mesh\nbaking\n")
    assert (quiet.code, quiet.err, quiet.out) == (0, "", told.out)


def test_simplifying_tells_what_it_does_but_not_quietly(
    room: tuple[str, str], command: Callable[..., Any], tmp_path: Path
) -> None:
    words = ("simplify", room[0], "--view", room[1], "--out", tmp_path / "few.ply", "prune=0.005", "floaters=drop")
    told, quiet = command(*words), command(*words, "-q")
    assert (told.code, told.err) == (0, "reading the scene\nleaving out floaters\npruning\nmerging\n")
    assert (quiet.code, quiet.err, quiet.out) == (0, "", told.out)


@pytest.mark.parametrize("representation", ["gaussian_splats", "nerf_grid"])
def test_a_mesh_without_area_is_said(tmp_path: Path, representation: Any) -> None:
    (tmp_path / "line.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"line\.obj: faces: expected an area, got 1 faces without one"):
        bake_to_folder(str(tmp_path / "line.obj"), tmp_path / "out", representation, None)


@pytest.mark.parametrize("representation", ["gaussian_splats", "nerf_grid"])
def test_a_mesh_of_which_nothing_is_seen_is_said(tmp_path: Path, representation: Any) -> None:
    clear = trimesh.visual.TextureVisuals(
        uv=np.zeros((3, 2)),
        material=trimesh.visual.material.PBRMaterial(
            baseColorTexture=Image.new("RGBA", (4, 4), (255, 255, 255, 0)), alphaMode="MASK"
        ),
    )
    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], visual=clear, process=False)
    mesh.export(tmp_path / "clear.glb")
    with pytest.raises(InputError, match=r"clear\.glb: faces: expected something to be seen, all of it is transparent"):
        bake_to_folder(str(tmp_path / "clear.glb"), tmp_path / "out", representation, None)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "value"), [("k", -1.0), ("prune", 2.0), ("side", 0)])
def test_an_option_out_of_range_is_named(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} must be in"):
        Simplification(**{name: value})


@pytest.mark.parametrize("value", ["${oc.env:HOME}", '"\\x24{oc.env:HOME}"'])
def test_an_option_reads_no_environment(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: str
) -> None:
    monkeypatch.setenv("HOME", "/not/to/be/told")
    answer = command("simplify", "room.ply", "--out", tmp_path / "few.ply", f"k={value}")
    assert (answer.code, answer.err.count("\n")) == (2, 1)
    assert "k: interpolation is not part of the grammar" in answer.err
    assert "/not/to/be/told" not in answer.err


@pytest.mark.parametrize(
    ("representation", "detail", "kind"), [("gaussian_splats", 500, "Splats"), ("nerf_grid", 16, "NerfGrid")]
)
def test_a_mesh_is_baked_into_a_folder(tmp_path: Path, representation: str, detail: int, kind: str) -> None:
    trimesh.creation.box().export(tmp_path / "box.obj")
    found = bake_to_folder(str(tmp_path / "box.obj"), tmp_path / "out", representation, detail)  # type: ignore[arg-type]
    scene = load_scene(found["file"], up=tuple(found["up"]))
    assert type(scene.geometry).__name__ == kind
    assert len(scene.geometry) == found["count"]
    assert found["up"] == [0, 1, 0]
    assert not found["subject"]
    with pytest.raises(UsageError, match="expected a mesh"):
        bake_to_folder(found["file"], tmp_path / "again", representation, detail)  # type: ignore[arg-type]


@pytest.mark.parametrize(("representation", "detail"), [("gaussian_splats", 500), ("nerf_grid", 8)])
def test_that_a_person_without_a_skeleton_is_no_longer_marked_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, representation: Any, detail: int
) -> None:
    trimesh.creation.box().export(tmp_path / "box.obj")
    for label, count in (("scene", 0), ("subject", 1)):
        (tmp_path / "box.yaml").write_text(f"parts:\n  - {{file: box.obj, label: {label}}}\n")
        found = bake_to_folder(str(tmp_path / "box.yaml"), tmp_path / "baked", representation, detail)
        assert len(caplog.messages) == count
    told = f"marks a person without a skeleton, whom what is baked does not: lift {found['file']}"
    assert caplog.messages == [f"{tmp_path / 'box.yaml'}: {told}"]
    assert len(list((tmp_path / "baked").iterdir())) == 1


@pytest.mark.skipif(not MAN.is_file(), reason=f"the textured man is not here: {MAN}")
@pytest.mark.parametrize(("representation", "detail"), [("gaussian_splats", 5_000), ("nerf_grid", 48)])
def test_the_person_of_a_skeleton_goes_along_with_its_labels(tmp_path: Path, representation: str, detail: int) -> None:
    found = bake_to_folder(str(MAN), tmp_path, representation, detail)  # type: ignore[arg-type]
    scene = load_person(load_scene(found["file"], up=tuple(found["up"])), tmp_path / "subject.json")
    original = load_scene(MAN).subject
    assert scene.subject is not None
    assert original is not None
    torch.testing.assert_close(scene.subject.joints, original.joints, equal_nan=True)
    assert float((scene.geometry.label > 0.5).float().sum()) > 0.9 * len(scene.geometry)
