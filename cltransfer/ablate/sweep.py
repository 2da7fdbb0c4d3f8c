"""What an ablation is: a base config, a table of overrides over it, and the cases that every row is run on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from ..config.options import RunConfig
from ..errors import UsageError


@dataclass
class EngineConfig:
    """What runs the trials; a run's own ``engine`` is a key of its config.

    Args:
        backend: loky (processes here) or dask (a cluster; from the command line alone).
        workers: processes of loky; 0 is one for each thread this process may use. A cluster has its own.
        address: of dask's scheduler, as tcp://host:8786; from the command line alone, because dask runs here what the
            scheduler sends.
    """

    backend: Literal["loky", "dask"] = "loky"
    workers: int = 0
    address: str | None = None


@dataclass
class SceneConfig:
    """A scene and what goes with it, as in :class:`cltransfer.transfer.Inputs`; text of ``subject`` names a file."""

    scene: str
    init: str = "auto"
    subject: str | int | None = None
    up: list[float] | None = None

    def __post_init__(self) -> None:
        if isinstance(self.subject, int) and self.subject < 0:
            raise UsageError("", "subject", f"expected a file, or 0 or more, got {self.subject}", "as subject: 1")
        if self.up is not None and not (len(self.up) == 3 and all(map(math.isfinite, self.up)) and any(self.up)):
            raise UsageError("", "up", f"expected 3 finite numbers, not all 0, got {self.up}", "as up: [0, 0, 1]")


@dataclass
class SweepFile:
    """An ablation file as it is written.

    Args:
        about: what it asks, for the head of the table.
        scenes: to transfer into; a name, or a mapping with init, subject and up.
        references: as `transfer` takes them, or ``drawn:SHOT``: the seed draws who is filmed, and from where.
        seeds: of the runs, and of what is drawn.
        base: config below every row.
        rows: overrides by name, in the config's grammar; the first row is what the others are held against. A row's
            ``scene`` stands in for the sweep's one scene; one that names no scene says what is other about that one.
            What a file says as ``axes`` is rows by now, see :mod:`cltransfer.ablate.axes`.
        metrics: config over the base by which all rows are measured alike, whatever they were searched with: losses,
            extractors, ``extract``, the renderer and the size, ``output_side``.
        engine: what runs the trials; a file says workers, and no cluster.
    """

    about: str = ""
    scenes: list[SceneConfig] = field(default_factory=lambda: [SceneConfig("builtin:courtyard")])
    references: list[str] = field(default_factory=lambda: ["builtin:dolly_zoom"])
    seeds: list[int] = field(default_factory=lambda: [0])
    base: dict[str, Any] = field(default_factory=dict)
    rows: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    engine: EngineConfig = field(default_factory=EngineConfig)


@dataclass(frozen=True)
class Row:
    """One row of the table.

    Args:
        name: in the file.
        config: without a seed.
        scene: the one it brings along, None for those of the sweep.
    """

    name: str
    config: RunConfig
    scene: SceneConfig | None


@dataclass(frozen=True)
class Sweep:
    """An ablation, checked.

    Args:
        name: of the file.
        file: as written, with the command line on top.
        rows: the first is what the others are held against.
        metrics: by which all rows are measured.
        over: of the command line, what lies on top of every row, item by item.
        judging: those of them that lie on top of what is measured by too, below what the file's metrics say.
        origins: where a key was written, the file or the command line.
    """

    name: str
    file: SweepFile
    rows: tuple[Row, ...]
    metrics: RunConfig
    over: tuple[str, ...] = ()
    judging: tuple[str, ...] = ()
    origins: Mapping[str, str] = field(default_factory=dict)

    def to_yaml(self) -> str:
        """The file as it was run, without the cluster, which no file may name."""
        from omegaconf import OmegaConf

        written = {**asdict(self.file), "engine": {"workers": self.file.engine.workers}}
        return OmegaConf.to_yaml(OmegaConf.create(written))
