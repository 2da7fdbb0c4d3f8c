"""How fast gsplat draws the candidates of a search on a CUDA device, and how near it is to the oracle."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from ..camera import Camera
from ..computer.cuda import require_gsplat
from ..renderers.gaussian_splats import GaussianSplats
from ..scenes import Scene
from ..scenes.load import load_scene
from .pages import SECTIONS
from .section import machine, quartiles, table, write_section
from .speed import ALL, cameras_around
from .synthetic_room import room_cameras, synthetic_room
from .timing import GEOMETRY

SIZE = (160, 90)
CANDIDATES = (10, 64)
REPEATS = 9
COMPARED = 4  # cameras whose images are compared with the oracle's


@dataclass(frozen=True)
class CudaRow:
    """One scene, drawn for so many candidates at once.

    Args:
        scene: what was drawn.
        gaussians: in it.
        candidates: cameras in a call.
        buffers: all, or depth + label.
        fps: frames per second by gsplat, buffers back on the CPU: lower quartile, median, upper quartile.
        numba: the same by the kernels on the CPU, in the same run; its median.
        psnr: of gsplat's image against the torch oracle's [dB], the least of a few cameras.
    """

    scene: str
    gaussians: int
    candidates: int
    buffers: str
    fps: tuple[float, float, float]
    numba: float
    psnr: float

    HEADER = "scene | Gaussians | candidates | buffers | gsplat frames/s (quartiles) | numba frames/s | PSNR"

    def cells(self) -> list[str]:
        """What a table shows, in the order of ``HEADER``."""
        low, median, high = self.fps
        counts = [f"{self.gaussians:,}", str(self.candidates), self.buffers]
        return [
            self.scene,
            *counts,
            f"{median:,.0f} ({low:,.0f}-{high:,.0f})",
            f"{self.numba:,.0f}",
            f"{self.psnr:.1f} dB",
        ]

    def __str__(self) -> str:
        return " | ".join(self.cells())


def run_cuda(paths: Iterable[str | Path], repeats: int = REPEATS) -> Iterator[CudaRow]:
    """Draw synthetic rooms and the scenes at ``paths`` at 160x90.

    Raises:
        ModelError: gsplat or a CUDA device is missing.
    """
    require_gsplat("bench cuda", "run it on a computer that has one")
    up = torch.tensor([0.0, 0.0, 1.0])
    for count in (10_000, 100_000, 500_000):
        room = Scene(synthetic_room(count), None, up, f"room {count // 1000}k", f"room:{count}:0")
        yield from _rows(room, room_cameras(max(CANDIDATES), SIZE), repeats)
    for path in paths:
        scene = load_scene(path)
        yield from _rows(scene, cameras_around(scene, max(CANDIDATES)), repeats)


def _rows(scene: Scene, cameras: Camera, repeats: int) -> Iterator[CudaRow]:
    psnr = _psnr(scene, cameras[:COMPARED])
    for candidates in CANDIDATES:
        for name, buffers in (("all", ALL), ("depth + label", GEOMETRY)):
            times = {
                backend: [_fps(renderer, scene, cameras[:candidates], buffers) for _ in range(repeats + 1)][1:]
                for backend, renderer in (("gsplat", GaussianSplats("gsplat")), ("numba", GaussianSplats()))
            }
            fps, numba = quartiles(times["gsplat"]), statistics.median(times["numba"])
            yield CudaRow(scene.name, len(scene.geometry), candidates, name, fps, numba, psnr)


def _fps(renderer: GaussianSplats, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> float:
    begun = time.perf_counter()
    renderer.render(scene, cameras, buffers)  # ends on the CPU, so the device has finished
    return len(cameras) / (time.perf_counter() - begun)


def _psnr(scene: Scene, cameras: Camera) -> float:
    image = frozenset({"image"})
    drawn, plain = (GaussianSplats(b).render(scene, cameras, image).require("image") for b in ("gsplat", "torch"))
    return float((-10 * ((drawn - plain) ** 2).flatten(1).mean(1).log10()).min())


def write_cuda(rows: Sequence[CudaRow], path: Path, command: str) -> None:
    """Put the rows into the section of the Markdown file ``path`` that is theirs."""
    told = [
        f"Made by `{command}`. 160x90, wall time until all is back on",
        f"the CPU; a {torch.cuda.get_device_name()}; numba on the same computer's processor, in the same run.",
    ]
    lines = table(CudaRow.HEADER.split(" | "), [row.cells() for row in rows])
    write_section(path, SECTIONS["cuda"], [*told, *machine(), "", *lines])
