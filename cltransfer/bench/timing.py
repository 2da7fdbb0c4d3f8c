"""What the benches of renderers share: posed scenes, calls that are timed, kernels and oracle in turn, a table."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..computer.threads import threads_restored
from ..scenes import Scene
from .pages import SECTIONS
from .section import machine, quartiles, table, write_section
from .synthetic_room import room_cameras

GEOMETRY = frozenset({"depth", "label"})
FRAMES = 4  # cameras a call
SIZES = ((160, 90), (320, 180), (640, 360))
Posed = tuple[Scene, Camera]
Settings = Sequence[tuple[str, frozenset[str], Mapping[str, int]]]


@dataclass(frozen=True)
class SpeedBench:
    """A renderer that is timed, and what is told of it.

    Args:
        name: of the bench.
        told: lines above the table, after the command.
        renderer: makes one.
        counts: what a scene with cameras consists of, a number for each column that is the bench's own.
        columns: their names, and how they are written.
        buffer: in which kernels and oracle are compared.
        accuracy: how well the kernels' agrees with the oracle's.
        worst: of the accuracies over the seeds.
        compared: the accuracy's column, and how it is written.
        settings: of the kernels: name, buffers and the renderer's options, ``threads`` among them.
    """

    name: str
    told: Sequence[str]
    renderer: Callable[..., Any]
    counts: Callable[[Posed], tuple[float, ...]]
    columns: Mapping[str, str]
    buffer: str
    accuracy: Callable[[Tensor, Tensor], float]
    worst: Callable[[Sequence[float]], float]
    compared: tuple[str, str]
    settings: Settings

    def row(self, posed: Posed, setting: str, threads: int, times: Sequence[float]) -> SpeedRow:
        """Quartiles of a scene's times, and what it consists of."""
        scene, cameras = posed
        return SpeedRow(self, scene.name, cameras.size, setting, threads, self.counts(posed), quartiles(times))

    @threads_restored()
    def against_oracle(self, posed: Sequence[Posed], repeats: int) -> list[SpeedRow]:
        """Kernels and oracle in turn on one thread each, with all buffers, and how well what they draw agrees."""
        torch.set_num_threads(1)
        kernels, oracle = self.renderer(threads=1), self.renderer(backend="torch")
        times: tuple[list[float], list[float]] = ([], [])
        agreed = []
        for pair in posed:
            drawn = [renderer.render(*pair, renderer.provides).require(self.buffer) for renderer in (kernels, oracle)]
            agreed.append(self.accuracy(*drawn))
            for _ in range(repeats):
                for renderer, own in zip((kernels, oracle), times):
                    own.append(call_time(renderer, pair, renderer.provides))
        speedup = statistics.median(times[1]) / statistics.median(times[0])
        row = replace(self.row(posed[0], "numba, all", 1, times[0]), speedup=speedup, accuracy=self.worst(agreed))
        return [self.row(posed[0], "torch, all", 1, times[1]), row]

    def each_setting(self, posed: Sequence[Posed], repeats: int) -> list[SpeedRow]:
        """Kernels at the size of the cameras."""
        rows = []
        for setting, buffers, options in self.settings:
            renderer = self.renderer(**options)
            for pair in posed:
                renderer.render(*pair, buffers)  # packs, and loads compiled code
            times = [call_time(renderer, pair, buffers) for pair in posed for _ in range(repeats)]
            rows.append(self.row(posed[0], f"numba, {setting}", options["threads"], times))
        return rows


@dataclass(frozen=True)
class SpeedRow:
    """One setting, timed.

    Args:
        bench: that timed it.
        scene: what was rendered.
        size: (W, H) [px].
        setting: backend and buffers.
        threads: that worked at once.
        counts: what the scene consists of, by the bench's columns.
        milliseconds: wall time a frame: lower quartile, median, upper quartile.
        speedup: median of the torch oracle over this median, where both were timed in turn.
        accuracy: against the oracle, the worst over the seeds, where both were timed in turn.
    """

    bench: SpeedBench
    scene: str
    size: tuple[int, int]
    setting: str
    threads: int
    counts: tuple[float, ...]
    milliseconds: tuple[float, float, float]
    speedup: float | None = None
    accuracy: float | None = None

    def cells(self) -> list[str]:
        """What a table shows, in the order of its columns."""
        low, median, high = self.milliseconds
        counts = [form.format(count) for form, count in zip(self.bench.columns.values(), self.counts)]
        speedup = "" if self.speedup is None else f"{self.speedup:.0f}x"
        accuracy = "" if self.accuracy is None else self.bench.compared[1].format(self.accuracy)
        size, timing = f"{self.size[0]}x{self.size[1]}", f"{median:.1f} ({low:.1f}-{high:.1f})"
        return [self.scene, size, self.setting, str(self.threads), *counts, timing, speedup, accuracy]

    def __str__(self) -> str:
        return " | ".join(self.cells())


def room(geometry: Any, name: str, seed: int) -> Posed:
    """A synthetic room, z up, and the cameras of a search in it, at the smallest of ``SIZES``."""
    scene = Scene(geometry, None, torch.tensor([0.0, 0.0, 1.0]), name, f"{name}:{seed}")
    return scene, room_cameras(FRAMES, SIZES[0], seed)


def one_and_two_threads(every: frozenset[str]) -> Settings:
    """Of kernels: ``every`` buffer and geometry on one thread, and every one on two."""
    return [("all", every, {"threads": 1}), ("depth + label", GEOMETRY, {"threads": 1}), ("all", every, {"threads": 2})]


def around(up: Tensor, middle: Tensor, offsets: tuple[float, float], reach: Any, count: int) -> Camera:
    """Cameras on a circle about ``middle`` (3,) that look at it, at the smallest of ``SIZES``, (count,).

    Args:
        up: (3,), of length one.
        middle: [scene units].
        offsets: radius of the circle and its height above the middle, in ``reach``.
        reach: [scene units].
        count: of the cameras.
    """
    side = torch.linalg.cross(up, up.roll(1))
    angles = torch.arange(count).double()[:, None] * 2 * torch.pi / count
    circle = angles.cos() * side + angles.sin() * torch.linalg.cross(up, side)
    return Camera.look_at(middle + reach * (offsets[0] * circle + offsets[1] * up), middle, up, 0.7, SIZES[0])


def at_size(posed: Sequence[Posed], size: tuple[int, int]) -> list[Posed]:
    """The scenes with cameras of another size."""
    return [(scene, cameras.at_size(size)) for scene, cameras in posed]


def call_time(renderer: Any, posed: Posed, buffers: frozenset[str]) -> float:
    """Wall time of one call [ms a frame]."""
    start = time.perf_counter()
    renderer.render(*posed, buffers)
    return (time.perf_counter() - start) / len(posed[1]) * 1e3


def write_benchmarks(rows: Sequence[SpeedRow], path: Path, command: str) -> None:
    """Put the rows of one bench, one at least, into the section of the Markdown file ``path`` that is its."""
    bench = rows[0].bench
    columns = ["scene", "size", "setting", "threads", *bench.columns, "ms a frame (quartiles)", "against torch"]
    told = [f"Made by `{command}`. {bench.told[0]}", *bench.told[1:]]
    lines = table([*columns, bench.compared[0]], [row.cells() for row in rows])
    write_section(path, SECTIONS[bench.name], [*told, *machine(), "", *lines])
