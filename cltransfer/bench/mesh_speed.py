"""How fast meshes render, and how exactly: kernels and the torch oracle in turn, on one machine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import cast

import numpy as np
import torch
from torch import Tensor

from ..renderers.mesh import MeshRenderer
from ..scenes import Scene
from ..scenes.load import load_scene
from ..scenes.meshes.mesh import Mesh
from .synthetic_room import PERSON, ROOM
from .timing import FRAMES, GEOMETRY, SIZES, Posed, SpeedBench, SpeedRow, around, at_size, room

ALL = MeshRenderer.provides
CLOSE = 1e-3  # relative difference of depth that still agrees


def _agreement(one: Tensor, other: Tensor) -> float:
    """Share of pixels whose depths agree [%]."""
    return 100 * float((((one - other).abs() <= CLOSE * other) | (one.isnan() & other.isnan())).float().mean())


BENCH = SpeedBench(
    name="mesh",
    told=[
        "Wall time, four cameras a call,",
        "quartiles over seeds and repeats; torch and kernels in turn on one thread each where they are compared.",
    ],
    renderer=MeshRenderer,
    counts=lambda posed: (len(posed[0].geometry),),
    columns={"faces": "{:,}"},
    buffer="depth",
    accuracy=_agreement,
    worst=min,
    compared=("depth agrees", "{:.2f} %"),
    settings=[
        ("all", ALL, {"threads": 1}),
        ("depth + label", GEOMETRY, {"threads": 1}),
        ("all, 2x2 rays", ALL, {"threads": 1, "samples": 2}),
    ],
)


def run_mesh_speed(seeds: Sequence[int], scene_paths: Iterable[str | Path], quick: bool = False) -> list[SpeedRow]:
    """Time the kernels against the oracle at 10k and 100k faces, then over sizes and scenes.

    Args:
        seeds: of the synthetic rooms; times of all are pooled.
        scene_paths: meshes to time beside them.
        quick: few repeats of small settings, to check that the bench works.

    Returns:
        Rows in the order of the table. Torch and kernels run on one thread where they are compared.
    """
    repeats, counts = (2, (2_000,)) if quick else (9, (10_000, 100_000))
    rooms = [[room(synthetic_mesh(count, seed), f"room {count // 1000}k", seed) for seed in seeds] for count in counts]
    rows = [row for posed in rooms for row in BENCH.against_oracle(posed, repeats)]
    for posed in [*rooms, *([_posed(load_scene(path))] for path in scene_paths)]:
        for size in SIZES[:1] if quick else SIZES:
            rows += BENCH.each_setting(at_size(posed, size), repeats)
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


def _posed(scene: Scene) -> Posed:
    """A scene and cameras around the person, or around the middle where there is none."""
    mesh = cast(Mesh, scene.geometry)
    low, high = mesh.vertices.double().quantile(torch.tensor([0.05, 0.95]).double(), dim=0)
    person = scene.subject
    middle, reach = ((low + high) / 2, (high - low).max()) if person is None else (person.anchor, 1.5 * person.height)
    return scene, around(scene.up, middle, (1.0, 0.2), reach, FRAMES)
