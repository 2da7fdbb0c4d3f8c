"""A plugin that brings a representation of its own: its file is read, lifted, searched, drawn again and taught from."""

from __future__ import annotations

import hashlib
import io
import json
import math
import struct
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.drawing import drawn_by
from cltransfer.errors import InputError, UsageError
from cltransfer.features import Features
from cltransfer.pipeline.components import SCENE_SOURCE, Components
from cltransfer.pipeline.graph import run
from cltransfer.plugins import allow
from cltransfer.registry import RENDERERS
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lift import LiftOptions, lift
from cltransfer.scenes.person.lifted import with_person
from cltransfer.testing import RendererCase, sample_cameras, sample_subject

pytestmark = pytest.mark.usefixtures("forgotten_renderers")
FILE = Path(__file__).resolve().parents[2] / "plugins" / "spheres.py"
SMALL = ("preset=fast", "frames=2", "search_side=64", "output_side=96", "renderer.spheres={}")
BONES = ((12, 13), (13, 0), (13, 1), (0, 2), (2, 4), (1, 3), (3, 5), (13, 6), (13, 7), (6, 8), (8, 10), (7, 9), (9, 11))


def stage_of_spheres() -> dict[str, np.ndarray]:
    """A person of small spheres, as high as a person is, among large ones on a floor."""
    joints = sample_subject().joints
    body = torch.cat([joints[a] + (joints[b] - joints[a]) * torch.linspace(0, 1, 5)[:, None] for a, b in BONES])
    angle = torch.arange(8) * (2 * math.pi / 8)
    around = torch.stack([5 * angle.cos(), 5 * angle.sin(), torch.full((8,), 0.8)], 1)
    floor = torch.tensor([[0.0, 0.0, -100.0]])
    centers = torch.cat([body, around, floor]).float()
    radii = torch.cat([torch.full((len(body),), 0.09), torch.full((8,), 0.8), torch.full((1,), 99.99)])
    label = (torch.arange(len(radii)) < len(body)).float()
    colors = torch.rand((len(radii), 3), generator=torch.Generator().manual_seed(0)) * 0.8 + 0.2
    values = {"centers": centers, "radii": radii, "colors": colors, "label": label}
    return {name: value.numpy() for name, value in values.items()}


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """The spheres as a file, with its person beside it."""
    np.savez(tmp_path / "stage.npz", **stage_of_spheres())  # type: ignore[arg-type]  # its stub has no mapping
    sample_subject().save(tmp_path / "subject.json")
    return tmp_path / "stage.npz"


class TestSpheres(RendererCase):
    spacing = 0.12

    @pytest.fixture(autouse=True)
    def build(self, stage: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        allow([FILE])
        self.component = RENDERERS.build("spheres")
        scene = with_person(load_scene(stage, (0.0, 0.0, 1.0)), sample_subject(), None)
        monkeypatch.setattr(TestSpheres, "scene", scene, raising=False)
        monkeypatch.setattr(TestSpheres, "points", surfaces(scene.geometry), raising=False)


def surfaces(ball: Any) -> Tensor:
    """Points on all spheres but the floor's, of which those near the middle, at most 0.1 apart."""
    count = 6000
    i = torch.arange(count) + 0.5
    polar, turn = (1 - 2 * i / count).acos(), math.pi * (1 + 5**0.5) * i
    unit = torch.stack([turn.cos() * polar.sin(), turn.sin() * polar.sin(), polar.cos()], 1)
    most = [c + r * unit[:: 1 if r > 0.5 else 60] for c, r in zip(ball.centers[:-1], ball.radii[:-1])]
    x, y = torch.meshgrid(torch.arange(-9, 9, 0.1), torch.arange(-9, 9, 0.1), indexing="ij")
    floor = torch.stack([x, y, (ball.radii[-1] ** 2 - x**2 - y**2).sqrt() + ball.centers[-1, 2]], -1).reshape(-1, 3)
    return torch.cat([*most, floor])


def test_a_scene_is_read_by_the_plugin_that_is_allowed_and_by_no_other(stage: Path) -> None:
    with pytest.raises(InputError, match=r"no scene has the suffix '\.npz' \(expected \.ply.*--allow-plugin"):
        load_scene(stage)
    allow([FILE])
    scene = load_scene(stage, (0.0, 0.0, 1.0))
    assert (scene.name, type(scene.geometry).__name__, len(scene.geometry)) == ("stage", "Ball", 74)
    assert scene.digest == hashlib.sha256(stage.read_bytes()).hexdigest()
    with pytest.raises(InputError, match=r"no scene has the suffix '\.xyz' \(expected .*\.npz or builtin:NAME"):
        load_scene(stage.with_suffix(".xyz"))
    with pytest.raises(InputError, match=r"other\.npz: no such file"):
        load_scene(stage.with_name("other.npz"))


def test_a_pickle_in_the_file_of_a_stranger_does_not_run(tmp_path: Path) -> None:
    class Mean:
        def __reduce__(self) -> Any:
            return Path.touch, (tmp_path / "ran",)

    allow([FILE])
    np.savez(tmp_path / "mean.npz", **{**stage_of_spheres(), "radii": np.array([Mean()], object)})  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"mean\.npz: expected an \.npz of centers, .*allow_pickle"):
        load_scene(tmp_path / "mean.npz")
    assert not (tmp_path / "ran").exists()


def npy(shape: tuple[int, ...]) -> bytes:
    """An array of numpy's that is said to have this shape, without its values."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return stream.getvalue()


def test_a_small_file_of_a_stranger_does_not_unpack_to_a_large_one(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_BZIP2) as packed:
        packed.writestr("centers.npy", npy((20_000, 3)) + bytes(300 * 2**20))
    content = bytearray(path.read_bytes())
    at = content.rindex(b"PK\x01\x02") + 24
    content[at : at + 4] = struct.pack("<I", 240_128)  # the size that the list of members states
    path.write_bytes(content)
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as packed:
        packed.writestr("centers.npy", npy((10**13, 3)))
    allow([FILE])
    tracemalloc.start()
    with pytest.raises(InputError, match=r"bomb\.npz: expected an \.npz of centers.*np\.savez"):
        load_scene(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * 2**20
    with pytest.raises(InputError, match=r"lie\.npz: expected an \.npz of centers"):
        load_scene(tmp_path / "lie.npz")


DAMAGED = [
    ({"centers": np.full((5, 3), np.nan)}, "centers: expected finite numbers"),
    ({"radii": np.full(5, np.inf)}, "radii: expected finite numbers above 0"),
    ({"radii": np.zeros(5)}, "radii: expected finite numbers above 0"),
    ({"radii": np.float32(1)}, r"centers: expected \(1, 3\), got \(5, 3\)"),
    ({"colors": np.full((5, 3), np.nan)}, r"colors: expected numbers in \[0, 1\]"),
    ({"label": np.full(5, 2.0)}, r"label: expected numbers in \[0, 1\]"),
    ({"label": np.zeros(4)}, r"label: expected \(5,\), got \(4,\)"),
    ({"centers": np.zeros((0, 3)), "radii": np.zeros(0)}, r"centers: expected \(1, 3\), got \(0, 3\)"),
]


@pytest.mark.parametrize(("change", "line"), DAMAGED)
def test_a_damaged_file_is_told_by_its_array(tmp_path: Path, change: dict[str, Any], line: str) -> None:
    allow([FILE])
    values = {"centers": np.zeros((5, 3)), "radii": np.ones(5), "colors": np.ones((5, 3)), "label": np.zeros(5)}
    np.savez(tmp_path / "stage.npz", **{**values, **change})  # type: ignore[arg-type]
    with pytest.raises(InputError, match=rf"stage\.npz: {line}"):
        load_scene(tmp_path / "stage.npz")


def test_a_damaged_stream_is_told_as_a_damaged_file(stage: Path) -> None:
    allow([FILE])
    np.savez_compressed(stage, **stage_of_spheres())  # type: ignore[arg-type]
    content = bytearray(stage.read_bytes())
    content[60:90] = bytes(byte ^ 0x5A for byte in content[60:90])
    stage.write_bytes(content)
    with pytest.raises(InputError, match=r"stage\.npz: expected an \.npz of centers"):
        load_scene(stage)


def test_many_spheres_are_drawn_a_part_of_the_rays_at_a_time(stage: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    allow([FILE])
    scene, cameras = load_scene(stage, (0.0, 0.0, 1.0)), sample_cameras(0, 1)
    renderer, parts = RENDERERS.build("spheres"), list[int]()
    module = sys.modules[type(renderer).__module__]
    met, buffers = module.Spheres._met, renderer.provides
    whole = renderer.render(scene, cameras, buffers)

    def counted(self: Any, ball: Any, away: Tensor, rays: Tensor) -> Any:
        parts.append(len(ball) * len(rays))
        return met(self, ball, away, rays)

    monkeypatch.setattr(module, "AT_ONCE", 10_000)
    monkeypatch.setattr(module.Spheres, "_met", counted)
    drawn = renderer.render(scene, cameras, buffers)
    assert len(parts) > 1
    assert max(parts) <= 10_000
    for name in buffers:
        torch.testing.assert_close(drawn.require(name), whole.require(name), equal_nan=True)


def test_a_scene_that_is_no_spheres_is_refused(stage: Path) -> None:
    allow([FILE])
    with pytest.raises(UsageError, match="renderer spheres: expected spheres, got Splats"):
        RENDERERS.build("spheres").render(builtin_scene("plaza"), sample_cameras(0, 1), frozenset({"image"}))


def test_its_person_is_found_and_marked_sphere_by_sphere(stage: Path) -> None:
    allow([FILE])
    scene, parts = load_scene(stage, (0.0, 0.0, 1.0)), Components.build(load_config(overrides=["renderer.spheres={}"]))
    person, plan = with_person(scene, sample_subject(), None), parts.plan("scene")
    bare = replace(scene, geometry=scene.geometry.with_label(torch.zeros(len(scene.geometry))))

    def see(cameras: Camera) -> list[np.ndarray]:
        pixels = cameras.project(sample_subject().joints)[0]
        low, high = pixels.amin(1), pixels.amax(1)
        return [*torch.cat([low, high - low, torch.ones(len(cameras), 1)], 1)[:, None].numpy()]

    def look(cameras: Camera, box: Tensor | None) -> Features:
        seen = run(plan, drawn_by(parts.renderer, person, cameras, plan.buffers - SCENE_SOURCE), None)
        return replace(seen, box=torch.from_numpy(np.concatenate(see(cameras))))

    found = lift(bare, parts.renderer, look, see, LiftOptions(views=8))
    assert float((found.subject.joints - sample_subject().joints).norm(dim=1).max()) < 0.02
    assert float((found.label == scene.geometry.label).float().mean()) > 0.9
    assert torch.equal(with_person(bare, found.subject, found.label).geometry.label, found.label.float())


def test_it_is_searched_drawn_again_and_taught_from_by_the_command_line(
    command: Callable[..., Any], stage: Path, tmp_path: Path
) -> None:
    plugin, folder = ("--allow-plugin", FILE), tmp_path / "run"
    person = ("--subject", tmp_path / "subject.json", "--up", "0,0,1")
    done = command("transfer", stage, "builtin:push_in", *person, "--out", folder, *plugin, *SMALL, "--json")
    assert (done.code, done.err.count("error")) == (0, 0), done.err
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["scene"]["sha256"] == hashlib.sha256(stage.read_bytes()).hexdigest()
    assert json.loads(done.out)["metrics"]["shot_size"]["mean"] < 0.02
    film = command("render", folder, "output_side=128", "--fps", "8", *plugin, "--out", tmp_path / "film.mp4")
    assert film.code == 0, film.err
    shot = (
        f"{stage}@{folder / 'trajectory.json'}"  # the config draws splats, the reference is drawn by what has read it
    )
    taught = command("transfer", "builtin:plaza", shot, "--out", tmp_path / "taught", *plugin, *SMALL[:-1])
    assert taught.code == 0, taught.err
    assert "note: plugin" not in taught.out


def test_what_it_reads_is_shown_and_the_wrong_renderer_names_the_right_one(
    command: Callable[..., Any], stage: Path, tmp_path: Path
) -> None:
    plugin = ("--allow-plugin", FILE)
    assert "\nreads: .npz\n" in command("plugins", "show", "spheres", *plugin).out
    person = ("--subject", tmp_path / "subject.json", "--out", tmp_path / "run")
    wrong = command("transfer", stage, "builtin:push_in", *person, *plugin, *SMALL[:-1])
    told = "stage: renderer gaussian_splats: does not draw Ball (choose: renderer.spheres={})"
    assert (wrong.code, wrong.err.splitlines()[-1]) == (2, f"error: {told}")
    merged = command("transfer", stage, "builtin:push_in", *person, *plugin, *SMALL, "lod=2")
    assert merged.err.splitlines()[-1] == "error: stage: lod: expected Gaussian splats, got Ball (set lod=0)"
    clean = command("simplify", stage, "--out", tmp_path / "clean.ply", "k=0", "floaters=drop")
    assert "expected Gaussian splats, got Ball (only these can be simplified)" in clean.err
