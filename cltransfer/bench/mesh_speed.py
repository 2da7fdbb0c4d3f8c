"""How fast meshes render, and how exactly: kernels and the torch oracle in turn, on one machine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..renderers.mesh import Mesh as Renderer
from ..scenes import Scene
from ..scenes.load import load_scene
from ..scenes.meshes.mesh import Mesh
from .section import quartiles
from .synthetic_room import PERSON, ROOM, room_cameras
from .timing import FRAMES, GEOMETRY, Posed, call_time, size_cell, speedup_cell, time_cell, timed_in_turn, write_rows

ALL = Renderer.provides
SIZES = ((160, 90), (320, 180), (640, 360))
CLOSE = 1e-3  # relative difference of depth that still agrees


@dataclass(frozen=True)
class MeshRow:
    """One setting, timed.

    Args:
        scene: what was rendered.
        size: (W, H) [px].
        setting: backend and buffers.
        threads: that worked at once.
        faces: in the scene.
        milliseconds: wall time a frame: lower quartile, median, upper quartile.
        speedup: median of the torch oracle over this median, where both were timed in turn.
        agreement: share of pixels whose depth is within 1e-3 of the oracle's, the least over the seeds.
    """

    scene: str
    size: tuple[int, int]
    setting: str
    threads: int
    faces: int
    milliseconds: tuple[float, float, float]
    speedup: float | None = None
    agreement: float | None = None

    HEADER = "scene | size | setting | threads | faces | ms a frame (quartiles) | against torch | depth agrees"

    def cells(self) -> list[str]:
        """What a table shows, in the order of ``HEADER``."""
        counts = [str(self.threads), f"{self.faces:,}"]
        timing, speedup = time_cell(self.milliseconds), speedup_cell(self.speedup)
        agreement = "" if self.agreement is None else f"{100 * self.agreement:.2f} %"
        return [self.scene, size_cell(self.size), self.setting, *counts, timing, speedup, agreement]

    def __str__(self) -> str:
        return " | ".join(self.cells())


def run_mesh_speed(seeds: Sequence[int], scene_paths: Iterable[str | Path], quick: bool = False) -> list[MeshRow]:
    """Time the kernels against the oracle at 10k and 100k faces, then over sizes and scenes.

    Args:
        seeds: of the synthetic rooms; times of all are pooled.
        scene_paths: meshes to time beside them.
        quick: few repeats of small settings, to check that the bench works.

    Returns:
        Rows in the order of the table. Torch and kernels run on one thread where they are compared.
    """
    repeats, counts = (2, (2_000,)) if quick else (9, (10_000, 100_000))
    rooms = [[_room(count, seed) for seed in seeds] for count in counts]
    rows = [row for posed in rooms for row in _against_oracle(posed, repeats)]
    sizes = SIZES[:1] if quick else SIZES
    for posed in [*rooms, *([_posed(load_scene(path))] for path in scene_paths)]:
        rows += _over_sizes(posed, sizes, repeats)
    return rows


def synthetic_mesh(count: int, seed: int = 0) -> Mesh:
    """A painted room of about ``count`` faces, >= 100, with a labelled figure of balls in its middle."""
    import trimesh

    rng = np.random.Generator(np.random.PCG64(seed))
    level = max(0, round(np.log(0.75 * count / (14 * 20)) / np.log(4)))
    balls = [(PERSON + np.array([0, 0, height]), radius) for height, radius in ((0.45, 0.25), (1.1, 0.28))]
    balls += [(rng.uniform([1, 1, 0.4], ROOM - [1, 1, 1.5]), rng.uniform(0.25, 0.5)) for _ in range(12)]
    room = trimesh.creation.box(ROOM).apply_translation(ROOM / 2)
    while len(room.faces) < count - 14 * 20 * 4**level:
        room = room.subdivide()
    solids = [trimesh.creation.icosphere(level, radius).apply_translation(place) for place, radius in balls]
    parts = []
    for index, solid in enumerate([*solids, room]):
        color = rng.uniform(0.2, 0.8, 3) + rng.normal(0, 0.05, (len(solid.vertices), 3))
        mesh = Mesh.plain(torch.tensor(solid.vertices), torch.tensor(solid.faces), torch.from_numpy(color.clip(0, 1)))
        parts.append(mesh.with_label(torch.full((len(mesh),), float(index < 2))))
    return Mesh.concatenate(parts)


def _room(count: int, seed: int) -> Posed:
    name = f"room {count // 1000}k"
    scene = Scene(synthetic_mesh(count, seed), None, torch.tensor([0.0, 0.0, 1.0]), name, f"{name}:{seed}")
    return scene, room_cameras(FRAMES, SIZES[0], seed)


def _posed(scene: Scene) -> Posed:
    """A scene and cameras around the person, or around the middle where there is none."""
    mesh = cast(Mesh, scene.geometry)
    low, high = mesh.vertices.double().quantile(torch.tensor([0.05, 0.95]).double(), dim=0)
    person = scene.subject
    middle, reach = ((low + high) / 2, (high - low).max()) if person is None else (person.anchor, 1.5 * person.height)
    side = torch.linalg.cross(scene.up, scene.up.roll(1))
    angles = torch.arange(FRAMES).double()[:, None] * 2 * torch.pi / FRAMES
    around = angles.cos() * side + angles.sin() * torch.linalg.cross(scene.up, side)
    return scene, Camera.look_at(middle + reach * (around + 0.2 * scene.up), middle[None], scene.up, 0.7, SIZES[0])


def _against_oracle(posed: list[Posed], repeats: int) -> list[MeshRow]:
    """Kernels and oracle in turn on one thread each, and the share of pixels whose depths agree."""
    found = timed_in_turn(Renderer(threads=1), Renderer(backend="torch"), posed, repeats, "depth", _agreement)
    row = replace(_row(posed[0], "numba, all", 1, found.kernels), speedup=found.speedup, agreement=min(found.apart))
    return [_row(posed[0], "torch, all", 1, found.oracle), row]


def _agreement(one: Tensor, other: Tensor) -> float:
    return float((((one - other).abs() <= CLOSE * other) | (one.isnan() & other.isnan())).float().mean())


def _over_sizes(posed: list[Posed], sizes: Sequence[tuple[int, int]], repeats: int) -> list[MeshRow]:
    """Kernels at each size: all buffers and geometry alone on one thread, and four rays a pixel."""
    rows = []
    for size in sizes:
        resized = [(scene, cameras.at_size(size)) for scene, cameras in posed]
        for setting, buffers, samples in (("all", ALL, 1), ("depth + label", GEOMETRY, 1), ("all, 2x2 rays", ALL, 2)):
            renderer = Renderer(threads=1, samples=samples)
            for pair in resized:
                renderer.render(*pair, buffers)  # packs, and loads compiled code
            times = [call_time(renderer, pair, buffers) for pair in resized for _ in range(repeats)]
            rows.append(_row(resized[0], f"numba, {setting}", 1, times))
    return rows


def _row(posed: Posed, setting: str, threads: int, times: Sequence[float]) -> MeshRow:
    scene, cameras = posed
    return MeshRow(scene.name, cameras.size, setting, threads, len(scene.geometry), quartiles(times))


def write_benchmarks(rows: Sequence[MeshRow], path: Path, command: str) -> None:
    """Put the rows into the section of the Markdown file ``path`` that is theirs."""
    told = [
        f"Made by `{command}`. Wall time, four cameras a call,",
        "quartiles over seeds and repeats; torch and kernels in turn on one thread each where they are compared.",
    ]
    write_rows(rows, path, "mesh", told)
