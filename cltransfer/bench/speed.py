"""How fast splats render, and how exactly: every comparison is made within one run, on one machine."""

from __future__ import annotations

import itertools
import statistics
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..renderers.gaussian_splats import GaussianSplats
from ..renderers.kernels.splats import count_visible, make_view
from ..scenes import Scene
from ..scenes.load import load_scene
from .section import quartiles
from .synthetic_room import room_cameras, synthetic_room
from .timing import FRAMES, GEOMETRY, Posed, call_time, size_cell, speedup_cell, time_cell, timed_in_turn, write_rows

ALL = GaussianSplats.provides
SIZES = ((160, 90), (320, 180), (640, 360))

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


@dataclass(frozen=True)
class SpeedRow:
    """One setting, timed.

    Args:
        scene: what was rendered.
        size: (W, H) [px].
        setting: backend and buffers.
        threads: that worked at once.
        gaussians: in the scene.
        visible: of them that can touch the frame, mean over the cameras.
        milliseconds: wall time a frame: lower quartile, median, upper quartile.
        speedup: median of the torch oracle over this median, where both were timed in turn.
        psnr: of the image against the oracle's [dB], the least over the seeds.
    """

    scene: str
    size: tuple[int, int]
    setting: str
    threads: int
    gaussians: int
    visible: int
    milliseconds: tuple[float, float, float]
    speedup: float | None = None
    psnr: float | None = None

    HEADER = "scene | size | setting | threads | Gaussians | visible | ms a frame (quartiles) | against torch | PSNR"

    def cells(self) -> list[str]:
        """What a table shows, in the order of ``HEADER``."""
        counts = [str(self.threads), f"{self.gaussians:,}", f"{self.visible:,}"]
        timing, speedup = time_cell(self.milliseconds), speedup_cell(self.speedup)
        psnr = "" if self.psnr is None else f"{self.psnr:.0f} dB"
        return [self.scene, size_cell(self.size), self.setting, *counts, timing, speedup, psnr]

    def __str__(self) -> str:
        return " | ".join(self.cells())


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
    rows = _against_oracle([_room(2_000 if quick else 10_000, seed) for seed in seeds], repeats)
    sizes = SIZES[:1] if quick else SIZES
    for count in (2_000,) if quick else (10_000, 100_000, 500_000):
        rows += _over_sizes([_room(count, seed) for seed in seeds], sizes, repeats)
    for path in scene_paths:
        scene = load_scene(path)
        rows += _over_sizes([(scene, cameras_around(scene, FRAMES))], sizes, repeats)
    return [*rows, _second_process(repeats)]


def _room(count: int, seed: int) -> Posed:
    """A synthetic room and the cameras of a search in it."""
    name = f"room {count // 1000}k"
    scene = Scene(synthetic_room(count, seed), None, torch.tensor([0.0, 0.0, 1.0]), name, f"{name}:{seed}")
    return scene, room_cameras(FRAMES, SIZES[0], seed)


def cameras_around(scene: Scene, count: int) -> Camera:
    """Cameras around the bulk of a scene of splats, a little from above, at the smallest of ``SIZES``."""
    low, middle, high = torch.from_numpy(np.quantile(scene.geometry.means.numpy(), (0.05, 0.5, 0.95), axis=0)).double()
    side = torch.linalg.cross(scene.up, scene.up.roll(1))
    angles = torch.arange(count).double()[:, None] * 2 * torch.pi / count
    around = angles.cos() * side + angles.sin() * torch.linalg.cross(scene.up, side)
    eyes = middle + (high - low).max() * (1.2 * around + 0.25 * scene.up)
    return Camera.look_at(eyes, middle, scene.up, 0.7, SIZES[0])


def _against_oracle(posed: list[Posed], repeats: int) -> list[SpeedRow]:
    """Kernels and oracle in turn on one thread each, and how far their images are apart."""
    kernels, oracle = GaussianSplats(threads=1), GaussianSplats(backend="torch")
    found = timed_in_turn(kernels, oracle, posed, max(2, repeats // 3), "image", _psnr)
    row = replace(_row(posed[0], "numba, all", 1, found.kernels), speedup=found.speedup, psnr=min(found.apart))
    return [_row(posed[0], "torch, all", 1, found.oracle), row]


def _psnr(one: Tensor, other: Tensor) -> float:
    return -10 * float(((one - other) ** 2).mean().log10())


def _over_sizes(posed: list[Posed], sizes: Sequence[tuple[int, int]], repeats: int) -> list[SpeedRow]:
    """Kernels at each size: all buffers and geometry alone on one thread, all buffers on two, and a camera alone."""
    rows = []
    for size in sizes:
        resized = [(scene, cameras.at_size(size)) for scene, cameras in posed]
        for setting, buffers, threads in (("all", ALL, 1), ("depth + label", GEOMETRY, 1), ("all", ALL, 2)):
            renderer = GaussianSplats(threads=threads)
            for pair in resized:
                renderer.render(*pair, buffers)  # packs, and loads compiled code
            times = [call_time(renderer, pair, buffers) for pair in resized for _ in range(repeats)]
            rows.append(_row(resized[0], f"numba, {setting}", threads, times))
        rows += _one_camera(resized, repeats)
    return rows


def _one_camera(posed: list[Posed], repeats: int) -> list[SpeedRow]:
    """Geometry of one camera a call, as a search asks most often: one thread and two, in turn."""
    alone = [(scene, cameras[i]) for scene, cameras in posed for i in range(len(cameras))]
    times: dict[int, list[float]] = {1: [], 2: []}
    for pair in alone:
        for threads, _ in itertools.product(times, range(max(2, repeats // 2))):
            times[threads].append(call_time(GaussianSplats(threads=threads), pair, GEOMETRY))
    return [_row(posed[0], "numba, depth + label, one camera", threads, times[threads]) for threads in times]


def _row(posed: Posed, setting: str, threads: int, times: Sequence[float]) -> SpeedRow:
    """Row of a scene's times; quartiles, and the Gaussians that can touch the frame."""
    scene, cameras = posed
    settings = GaussianSplats().settings
    views = [make_view(w2c, K, cameras.size, settings) for w2c, K in zip(cameras.w2c.numpy(), cameras.K.numpy())]
    visible = round(statistics.mean(count_visible(scene.geometry.packed, view) for view in views))
    return SpeedRow(scene.name, cameras.size, setting, threads, len(scene.geometry), visible, quartiles(times))


def _second_process(repeats: int) -> SpeedRow:
    """From the import of the kernels to the end of the first frame, in a process that finds them compiled."""
    run = [sys.executable, "-c", _FIRST_FRAME]
    answers = [
        subprocess.run(run, capture_output=True, text=True, check=True).stdout.split() for _ in range(repeats + 1)
    ]
    times = quartiles([1e3 * float(seconds) for seconds, _ in answers[1:]])  # the first may compile
    visible = int(answers[0][1])
    return SpeedRow("second process", SIZES[0], "numba, import and first frame", 1, 10_000, visible, times)


def write_benchmarks(rows: Sequence[SpeedRow], path: Path, command: str) -> None:
    """Put the rows into the section of the Markdown file ``path`` that is theirs."""
    told = [
        f"Made by `{command}`. Wall time, four cameras a call",
        "where not said otherwise, quartiles over seeds and repeats; torch and kernels in turn on one thread",
        "each where they are compared.",
        "Two threads gain only where a second core is free, which the load average tells.",
    ]
    write_rows(rows, path, "speed", told)
