"""What the benches of renderers share: calls that are timed, kernels and oracle in turn, cells and page of a table."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor

from ..camera import Camera
from ..computer.threads import threads_restored
from ..scenes import Scene
from .pages import SECTIONS
from .section import machine, table, write_section

GEOMETRY = frozenset({"depth", "label"})
FRAMES = 4  # cameras a call
Posed = tuple[Scene, Camera]
Apart = Callable[[Tensor, Tensor], float]


class Timed(Protocol):
    """A row of a table: a setting and what it took."""

    HEADER: str  # names of the columns, between " | "

    def cells(self) -> list[str]:
        """What the table shows, in the order of ``HEADER``."""


def call_time(renderer: Any, posed: Posed, buffers: frozenset[str]) -> float:
    """Wall time of one call [ms a frame]."""
    start = time.perf_counter()
    renderer.render(*posed, buffers)
    return (time.perf_counter() - start) / len(posed[1]) * 1e3


@dataclass(frozen=True)
class InTurn:
    """Kernels and oracle, timed in turn on one thread each.

    Args:
        kernels, oracle: wall times of all scenes and repeats [ms a frame].
        apart: how far what they draw of each scene is apart.
    """

    kernels: list[float]
    oracle: list[float]
    apart: list[float]

    @property
    def speedup(self) -> float:
        """Median of the oracle over that of the kernels."""
        return statistics.median(self.oracle) / statistics.median(self.kernels)


@threads_restored()
def timed_in_turn(kernels: Any, oracle: Any, posed: Sequence[Posed], repeats: int, buffer: str, apart: Apart) -> InTurn:
    """Time both with all buffers, and take how far ``buffer`` of the one is ``apart`` from that of the other."""
    torch.set_num_threads(1)
    found = InTurn([], [], [])
    for pair in posed:
        drawn = [renderer.render(*pair, renderer.provides).require(buffer) for renderer in (kernels, oracle)]
        found.apart.append(apart(drawn[0], drawn[1]))
        for _ in range(repeats):
            found.kernels.append(call_time(kernels, pair, kernels.provides))
            found.oracle.append(call_time(oracle, pair, oracle.provides))
    return found


def size_cell(size: tuple[int, int]) -> str:
    """A size (W, H) [px] as a table shows it."""
    return f"{size[0]}x{size[1]}"


def time_cell(quartiles: tuple[float, float, float]) -> str:
    """Median and quartiles as a table shows them."""
    low, median, high = quartiles
    return f"{median:.1f} ({low:.1f}-{high:.1f})"


def speedup_cell(speedup: float | None) -> str:
    """Against the oracle, as a table shows it; empty where that was not timed."""
    return "" if speedup is None else f"{speedup:.0f}x"


def write_rows(rows: Sequence[Timed], path: Path, name: str, told: Sequence[str]) -> None:
    """Put the rows into the section of the Markdown file ``path`` that is theirs.

    Args:
        rows: of one kind, one at least.
        path: of the page.
        name: of the bench.
        told: lines above the table: the command and what it measures.
    """
    lines = [*told, *machine(), "", *table(rows[0].HEADER.split(" | "), [row.cells() for row in rows])]
    write_section(path, SECTIONS[name], lines)
