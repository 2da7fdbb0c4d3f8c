"""What a sweep is run on: cases that are there and told apart, and rows that differ."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from ..config import COMMAND_LINE
from ..config.layers import origin
from ..config.options import SECTIONS, RunConfig
from ..errors import UsageError
from .sweep import EngineConfig, Row, SweepFile


def check_cases(file: SweepFile, origins: Mapping[str, str], where: Any) -> None:
    """Refuse scenes, references and seeds of which there is none, or one twice, and an engine that cannot be.

    Raises:
        UsageError: there is such a thing, with where ``origins`` says that it is written.
    """
    scenes = [str(asdict(scene)) for scene in file.scenes]
    for key, values in (("scenes", scenes), ("references", file.references), ("seeds", file.seeds)):
        if not values or len(set(values)) < len(values):
            raise UsageError(origin(origins, key) or where, key, "expected at least one, and none twice")
    if min(file.seeds) < 0:
        raise UsageError(origin(origins, "seeds"), "seeds", f"expected 0 or more, got {min(file.seeds)}")
    _check_engine(file.engine, origins)


def _check_engine(engine: EngineConfig, origins: Mapping[str, str]) -> None:
    """A file's workers apply where no cluster is named; on the command line they contradict one."""
    workers, address = origin(origins, "engine.workers"), origin(origins, "engine.address")
    if engine.workers < 0:
        raise UsageError(workers, "engine.workers", f"expected 0 or more, got {engine.workers}")
    if engine.backend == "dask" and not engine.address:
        raise UsageError(address, "engine.address", "dask needs its scheduler's", "as engine.address=tcp://host:8786")
    if engine.backend == "dask" and engine.workers and workers == COMMAND_LINE:
        reason = f"expected none beside a cluster, which has its own, got {engine.workers}"
        raise UsageError(workers, "engine.workers", reason, "leave it out, or engine.backend=dask")
    if engine.backend != "dask" and engine.address:
        reason = f"is a cluster's, and engine.backend is {engine.backend}"
        raise UsageError(address, "engine.address", reason, "add engine.backend=dask, or leave it out")


def check_rows(
    rows: Sequence[Row],
    file: SweepFile,
    over: Iterable[str],
    bare: Callable[[str], Row],
    origins: Mapping[str, str],
    where: Any,
) -> None:
    """Refuse two rows that are the same run.

    Args:
        rows: all of them.
        file: what they are written in.
        over: what the command line lays over them, as ``key=value``.
        bare: a row without that, by its name.
        origins: where keys of the sweep are written.
        where: the file.

    Raises:
        UsageError: there are two; where the command line makes them the same it names its keys. Or an option has the
            wrong type or range.
        ModelError: a plugin's class fails.
    """
    build = _building_once()
    for i, row in enumerate(rows):
        for other in rows[:i]:
            if not _same(row, other, build):
                continue
            apart = list(_differing(file.rows[row.name] or {}, file.rows[other.name] or {}))
            keys = ["scenes"] * ("scene" in apart and origin(origins, "scenes") == COMMAND_LINE)
            if not _same(bare(row.name), bare(other.name), _building_once()):
                said = [item.partition("=")[0] for item in over]
                keys = [key for key in said if any(_meet(key, one) for one in apart)] or said
            if keys:
                makes = f"{'make' if len(keys) > 1 else 'makes'} row {row.name!r} the same run as {other.name!r}"
                raise UsageError(COMMAND_LINE, ", ".join(keys), makes, "leave it out, or one of the rows")
            raise UsageError(where, f"rows.{row.name}", f"is the same run as {other.name!r}", "remove one of them")


Build = Callable[[Row, str], Any]


def _building_once() -> Build:
    """What builds a section of a row where it is first compared: of many rows there are far more pairs."""
    built: dict[tuple[str, str], Any] = {}

    def build(row: Row, section: str) -> Any:
        if (key := (row.name, section)) not in built:
            built[key] = row.config.build(section)
        return built[key]

    return build


def _same(row: Row, other: Row, build: Build) -> bool:
    """Whether two rows are the same run, whatever of its defaults one of them writes."""
    plain = [f.name for f in fields(RunConfig) if f.name not in SECTIONS]
    if row.scene != other.scene or any(getattr(row.config, key) != getattr(other.config, key) for key in plain):
        return False
    return all(_built_alike(section, row, other, build) for section in SECTIONS)


def _built_alike(section: str, one: Row, other: Row, build: Build) -> bool:
    """Whether two rows come to the same components; those that are written alike, or called otherwise, load none."""
    written = getattr(one.config, section), getattr(other.config, section)
    if written[0] == written[1] or written[0].keys() != written[1].keys():
        return written[0] == written[1]
    return bool(build(one, section) == build(other, section))


def _differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    """Keys, with points between them, of what two rows write that is not the same; of a scene that alone."""
    for key in {**one, **other}:
        pair = one.get(key), other.get(key)
        if key != "scene" and isinstance(pair[0], Mapping) and isinstance(pair[1], Mapping):
            yield from (f"{key}.{inner}" for inner in _differing(pair[0], pair[1]))
        elif (key in one, pair[0]) != (key in other, pair[1]):
            yield key


def _meet(one: str, other: str) -> bool:
    """Whether one of two keys stands under the other, or is it."""
    return f"{one}.".startswith(f"{other}.") or f"{other}.".startswith(f"{one}.")
