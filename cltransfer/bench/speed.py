"""How fast splats render, and how exactly: every comparison is made within one run, on one machine."""

from __future__ import annotations

import itertools
import statistics
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import torch

from ..camera import Camera
from ..renderers.gaussian_splats import GaussianSplats
from ..renderers.kernels.splats import count_visible, make_view
from ..scenes import Scene
from ..scenes.load import load_scene
from .section import quartiles
from .synthetic_room import synthetic_room
from .timing import (
    FRAMES,
    GEOMETRY,
    SIZES,
    Posed,
    SpeedBench,
    SpeedRow,
    around,
    at_size,
    call_time,
    one_and_two_threads,
    room,
)

ALL = GaussianSplats.provides

_FIRST_FRAME = """
import time
start = time.perf_counter()
import numpy as np
from cltransfer.renderers.kernels import splats, splat_pack
n, one = 10_000, np.ones(10_000, np.float32)
means = np.random.default_rng(0).uniform((-2, -1, 2), (2, 1, 6), (n, 3)).astype(np.float32)
covariances = np.broadcast_to(np.eye(3, dtype=np.float32) * 1e-3, (n, 3, 3))
sh = np.zeros((n, 16, 3), np.float32)
packed = splat_pack.pack(means, covariances, np.full((n, 3), 0.03, np.float32), one * 0.7, one, sh)
K = np.array([[130.0, 0, 80], [0, 130, 45], [0, 0, 1]])
view = splats.make_view(np.eye(4), K, (160, 90), splats.Settings(0.1, 0.3, True))
splats.render(packed, [view], True, 1)
print(time.perf_counter() - start, splats.count_visible(packed, view))
"""


def _counts(posed: Posed) -> tuple[float, ...]:
    """Gaussians in the scene, and of them those that can touch the frame, mean over the cameras."""
    scene, cameras = posed
    settings = GaussianSplats().settings
    views = [make_view(w2c, K, cameras.size, settings) for w2c, K in zip(cameras.w2c.numpy(), cameras.K.numpy())]
    return len(scene.geometry), round(statistics.mean(count_visible(scene.geometry.packed, view) for view in views))


BENCH = SpeedBench(
    name="speed",
    told=[
        "Wall time, four cameras a call",
        "where not said otherwise, quartiles over seeds and repeats; torch and kernels in turn on one thread",
        "each where they are compared.",
        "Two threads gain only where a second core is free, which the load average tells.",
    ],
    renderer=GaussianSplats,
    counts=_counts,
    columns={"Gaussians": "{:,}", "visible": "{:,}"},
    buffer="image",
    accuracy=lambda one, other: -10 * float(((one - other) ** 2).mean().log10()),
    worst=min,
    compared=("PSNR", "{:.0f} dB"),
    settings=one_and_two_threads(ALL),
)


def run_speed(seeds: Sequence[int], scene_paths: Iterable[str | Path], quick: bool = False) -> list[SpeedRow]:
    """Time the kernels against the oracle, over sizes and scenes, and a second process' first frame.

    Args:
        seeds: of the synthetic rooms; times of all are pooled.
        scene_paths: scenes to time beside them.
        quick: few repeats of small settings, to check that the bench works.

    Returns:
        Rows in the order of the table. Torch and kernels run on one thread where they are compared.
    """
    repeats = 2 if quick else 9

    def rooms(count: int) -> list[Posed]:
        return [room(synthetic_room(count, seed), f"room {count // 1000}k", seed) for seed in seeds]

    rows = BENCH.against_oracle(rooms(2_000 if quick else 10_000), max(2, repeats // 3))
    counts = (2_000,) if quick else (10_000, 100_000, 500_000)
    scenes = ([(scene, cameras_around(scene, FRAMES))] for scene in map(load_scene, scene_paths))
    for posed in itertools.chain(map(rooms, counts), scenes):
        for size in SIZES[:1] if quick else SIZES:
            resized = at_size(posed, size)
            rows += BENCH.each_setting(resized, repeats) + _one_camera(resized, repeats)
    return [*rows, _second_process(repeats)]


def cameras_around(scene: Scene, count: int) -> Camera:
    """Cameras around the bulk of a scene of splats, a little from above, at the smallest of ``SIZES``."""
    low, middle, high = torch.from_numpy(np.quantile(scene.geometry.means.numpy(), (0.05, 0.5, 0.95), axis=0)).double()
    return around(scene.up, middle, (1.2, 0.25), (high - low).max(), count)


def _one_camera(posed: list[Posed], repeats: int) -> list[SpeedRow]:
    """Geometry of one camera a call, as a search asks most often: one thread and two, in turn."""
    alone = [(scene, cameras[i]) for scene, cameras in posed for i in range(len(cameras))]
    times: dict[int, list[float]] = {1: [], 2: []}
    for pair in alone:
        for threads, _ in itertools.product(times, range(max(2, repeats // 2))):
            times[threads].append(call_time(GaussianSplats(threads=threads), pair, GEOMETRY))
    return [BENCH.row(posed[0], "numba, depth + label, one camera", threads, times[threads]) for threads in times]


def _second_process(repeats: int) -> SpeedRow:
    """From the import of the kernels to the end of the first frame, in a process that finds them compiled."""
    run = [sys.executable, "-P", "-c", _FIRST_FRAME]  # which imports nothing from the folder we are in
    answers = [
        subprocess.run(run, capture_output=True, text=True, check=True).stdout.split() for _ in range(repeats + 1)
    ]
    times = quartiles([1e3 * float(seconds) for seconds, _ in answers[1:]])  # the first may compile
    visible = int(answers[0][1])
    return SpeedRow(BENCH, "second process", SIZES[0], "numba, import and first frame", 1, (10_000, visible), times)
