"""Reading an ablation file: everything in it is checked before anything heavier than a row's components is loaded.

A file names scenes and references inside its own folder, or built-in ones; the command line may name any. A cluster is
the command line's alone.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from ..config import COMMAND_LINE, lay_config, layer_of, shipped_configs
from ..config.layers import Layer, merge, origin, parse_overrides, read_yaml
from ..config.options import SECTIONS, RunConfig
from ..errors import UsageError
from ..reading.scene_source import split_scene
from ..registry.declared import BUILTIN
from ..registry.typed import IN_QUOTES, nearest, shown, typed
from .axes import AXES, with_axes
from .check import check_cases, check_rows
from .sweep import Row, SceneConfig, Sweep, SweepFile

DRAWN = "drawn:"
NOT_FILES = (BUILTIN, DRAWN)
KEYS = (*(f.name for f in fields(SweepFile)), AXES)
MEASURES = ("preset", "output_side", "extract", "renderer", "extractors", "losses")  # what a result is measured by
MEASURES_EXTRACT = ("inner", "verify")  # and of extract
COMMAND_LINE_KEYS = ("scenes", "references", "seeds", "metrics")


def ablations() -> list[str]:
    """Names of the shipped files."""
    folder = shipped_configs() / "ablations"
    return sorted(p.name[: -len(".yaml")] for p in folder.iterdir() if p.name.endswith(".yaml"))


def read_sweep(name: str, overrides: Iterable[str] = ()) -> Sweep:
    """The ablation in a file, or the shipped one of that name.

    Args:
        name: a path, or one of :func:`ablations`.
        overrides: ``seeds=[0]``, ``scenes=[a.ply]``, ``references=[b.mp4]``, ``metrics.``.. and ``engine.backend=dask``
            are the sweep's; anything else, ``engine=cma`` too, goes on top of every row, and below the metrics, which
            are those of the base with it. An option of a component goes over those that have it, and where no row has
            it over all; ``losses.NAME={}`` and ``search.NAME={}`` over all.

    Raises:
        UsageError: there is no such file; a key, value or row cannot be meant; a path leads out of the file's folder;
            the file names a cluster; or two rows are the same run.
        ModelError: the class of a plugin that two rows name fails.
    """
    path = _found(name)
    written = read_yaml(path)
    for key in written:
        if key not in KEYS:
            raise UsageError(path, key, "no such key", nearest(key, KEYS))
    _refuse_cluster(written.get("engine"), path)
    written = with_axes(written, path)
    overrides = list(overrides)
    below_engine = [item for item in overrides if item.startswith("engine.")]  # beside engine=cma, which is the runs'
    above = parse_overrides((item for item in overrides if item not in below_engine), apart=True)
    said = {key: above.pop(key) for key in list(above) if _of_sweep(key, above[key])}
    _check_above(above)
    said = merge(said, parse_overrides(below_engine))
    fence = path.resolve().parent
    located = {**_located(written, path, fence), **_located(said, COMMAND_LINE, None)}
    origins = Layer.written(said, COMMAND_LINE).over(Layer.written(written, path)).origins
    file = _typed({**merge(written, said), **located}, path, origins)
    over = tuple(
        item for item in overrides if item not in below_engine and item.partition("=")[0].split(".")[0] in above
    )
    plain = {key: value for key, value in above.items() if key not in SECTIONS}
    own = [_row(file, row, plain, path, fence) for row in file.rows]
    known = {(section, name) for row in own for section in SECTIONS for name in getattr(row.config, section)}
    laid = {row.name: _over(above, row.config, known) for row in own}
    rows = tuple(_row(file, row, laid[row], path, fence) for row in file.rows)
    check_cases(file, origins, path)
    check_rows(rows, file, over, lambda name: _row(file, name, {}, path, fence), origins, path)
    bare = _metrics(file, plain, origins, path)
    measured = _over(above, bare, known)
    metrics = _metrics(file, measured, origins, path)
    file = _with_command_line(file, rows, laid, measured)
    judging = tuple(item for item in over if _measuring(_over(parse_overrides([item]), bare, known)))
    return Sweep(Path(name).stem, file, rows, metrics, over, judging, origins)


def _found(name: str) -> Path:
    if Path(name).is_file():
        return Path(name)
    if name in ablations():
        return Path(str(shipped_configs() / "ablations" / f"{name}.yaml"))
    raise UsageError(name, "", "no such ablation file", nearest(name, ablations()))


def _refuse_cluster(engine: Any, where: Any) -> None:
    """dask runs here what its scheduler sends, so a file, which may be anybody's, names none."""
    said = engine if isinstance(engine, Mapping) else {}
    if said.get("backend") == "dask" or said.get("address") is not None:
        hint = "as engine.backend=dask engine.address=tcp://host:8786"
        raise UsageError(where, "engine", "a cluster is named on the command line, not in a file", hint)


def _check_above(above: Mapping[str, Any]) -> None:
    """What goes over every row is a key of a run; one that is meant for the sweep is told as that."""
    if "base" in above:
        raise UsageError(COMMAND_LINE, "base", "goes over every row by itself", "leave out base., as in frames=3")
    known = [f.name for f in fields(RunConfig)]
    for key in above:
        if key not in known:
            raise UsageError(COMMAND_LINE, key, "no such key", nearest(key, [*COMMAND_LINE_KEYS, *known]))


def _of_sweep(key: str, value: Any) -> bool:
    return key in COMMAND_LINE_KEYS or (key == "engine" and isinstance(value, Mapping))


def _located(raw: Mapping[str, Any], where: Any, fence: Path | None) -> dict[str, Any]:
    """The scenes and references of ``raw`` as absolute paths; those outside ``fence`` are refused."""
    found: dict[str, Any] = {}
    for key in ("scenes", "references"):
        if key in raw and not isinstance(raw[key], list):
            raise UsageError(where, key, "expected a list", f"got {raw[key]!r}")
    if "scenes" in raw:
        found["scenes"] = [asdict(_scene(s, where, f"scenes[{i}]", fence)) for i, s in enumerate(raw["scenes"])]
    if "references" in raw:
        found["references"] = [_reference(text, where, i, fence) for i, text in enumerate(raw["references"])]
    return found


def _reference(text: Any, where: Any, i: int, fence: Path | None) -> str:
    if not isinstance(text, str) or not text:
        reason = f"expected text, got {text!r}"
        raise UsageError(where, f"references[{i}]", reason, "as drawn:orbit; in quotes if there is a space or a comma")
    return place(text, "references", where, fence)


def _scene(given: Any, where: Any, key: str, fence: Path | None, usual: SceneConfig | None = None) -> SceneConfig:
    """The scene that stands under ``key``: its name alone, or a mapping, over the ``usual`` scene if it names none."""
    own = dict(given) if isinstance(given, Mapping) else {"scene": given}
    below = asdict(usual) if usual and "scene" not in own else {}
    try:
        scene = typed(SceneConfig, {**below, **own})
    except UsageError as error:
        raise UsageError(where, f"{key}.{error.field}", error.reason, error.hint) from None
    named = {name: getattr(scene, name) for name in ("scene", "subject", "init") if name in own}
    files = {name: text for name, text in named.items() if isinstance(text, str) and text != "auto"}
    placed: dict[str, Any] = {name: place(text, "scene", where, fence) for name, text in files.items()}
    return replace(scene, **placed)


def place(text: str, field: str, where: Any, fence: Path | None) -> str:
    """A built-in name as it is, a path made absolute; both of SCENE@TRAJECTORY.json, the first of CLIP#PART, SET:INDEX.

    Raises:
        UsageError: it leads out of ``fence``, where there is one.
    """
    parts = split_scene(text, fence or Path()) or (text,)
    return "@".join(_place(part, field, where, fence) for part in parts)


def _place(text: str, field: str, where: Any, fence: Path | None) -> str:
    """One file of them."""
    if "\0" in text:
        raise UsageError(where, field, "expected the name of a file", f"got {text!r}")
    file = part = ""
    full = Path(os.path.realpath((fence or Path()) / text))
    if not full.exists():
        if text.startswith(NOT_FILES):
            return text
        mark = next((mark for mark in "#:" if mark in text), "")
        if mark:
            file, _, part = text.rpartition(mark)
            full, part = Path(os.path.realpath((fence or Path()) / file)), mark + part
    if fence is not None and not full.is_relative_to(fence):
        raise UsageError(where, field, f"{file or text} leads out of the file's folder", "name it on the command line")
    return f"{full}{part}"


def _typed(raw: Mapping[str, Any], where: Any, origins: Mapping[str, str]) -> SweepFile:
    rows = raw.get("rows")
    if not isinstance(rows, Mapping) or not rows:
        raise UsageError(where, "rows", "expected name: {overrides}, at least one")
    for name, overrides in rows.items():
        if not isinstance(name, str):
            raise UsageError(where, "rows", f"row names are text, got {shown(name)}", IN_QUOTES)
        if not name.strip():
            raise UsageError(where, "rows", f"a row has no name, got {name!r}", "name it, as full: {}")
        if not isinstance(overrides, Mapping | None):
            raise UsageError(where, f"rows.{name}", "expected overrides as a mapping", "write {} for the base")
    try:
        return typed(SweepFile, raw)
    except UsageError as error:
        at = origin(origins, error.field.partition("[")[0])
        raise UsageError(at or where, error.field, error.reason, error.hint) from None


def _row(file: SweepFile, name: str, above: Mapping[str, Any], where: Any, fence: Path) -> Row:
    overrides = dict(file.rows[name] or {})
    own, key = overrides.pop("scene", None), f"rows.{name}"
    if own is not None and len(file.scenes) != 1:
        raise UsageError(where, f"{key}.scene", f"stands in for one scene, the sweep has {len(file.scenes)}")
    scene = None if own is None else _scene(own, where, f"{key}.scene", fence, file.scenes[0])
    config = _config([_base(file, where), (overrides, f"{where}: {key}"), (above, COMMAND_LINE)])
    return Row(name, config, None if scene in file.scenes else scene)


def _over(above: Mapping[str, Any], own: RunConfig, known: Collection[tuple[str, str]]) -> dict[str, Any]:
    """What of ``above`` goes over a config that is ``own`` without it.

    An option asks for no component that ``own`` lacks where one of the rows has it: those are ``known``.
    """
    kept = dict(above)
    for section in SECTIONS:
        said, there = above.get(section), getattr(own, section)
        if isinstance(said, Mapping):
            kept[section] = {n: o for n, o in said.items() if not o or n in there or (section, n) not in known}
    return {key: value for key, value in kept.items() if value or not above[key]}


def _metrics(file: SweepFile, above: Mapping[str, Any], origins: Mapping[str, str], where: Any) -> RunConfig:
    """Config by which all rows are measured; only what it takes of the base and of what lies above every row."""
    base, place = _base(file, where)
    written = [(_measuring(base), place), (_measuring(above), COMMAND_LINE), (file.metrics, f"{where}: metrics")]
    try:
        config = _config(written)
    except UsageError as error:
        key = f"metrics.{error.field}"
        if error.where != f"{where}: metrics" or origin(origins, key) != COMMAND_LINE:
            raise
        raise UsageError(COMMAND_LINE, key, error.reason, error.hint) from None
    for key in (*file.metrics, *(f"extract.{name}" for name in file.metrics.get("extract", ()))):
        if key not in (*MEASURES, *(f"extract.{name}" for name in MEASURES_EXTRACT)):
            at = origin(origins, f"metrics.{key}") or where
            hint = f"it takes {', '.join(MEASURES)}; say others in base or rows"
            raise UsageError(at, f"metrics.{key}", "nothing is measured by it", hint)
    return config


def _measuring(values: Mapping[str, Any]) -> dict[str, Any]:
    """What of a config's ``values`` a result is measured by."""
    found = {key: value for key, value in values.items() if key in MEASURES}
    if isinstance(found.get("extract"), Mapping):
        found["extract"] = {key: value for key, value in found["extract"].items() if key in MEASURES_EXTRACT}
    return {key: value for key, value in found.items() if value != {}}


def _base(file: SweepFile, where: Any) -> tuple[Mapping[str, Any], str]:
    return file.base, f"{where}: base"


def _config(written: Iterable[tuple[Mapping[str, Any], str]]) -> RunConfig:
    """Config of values and where they are written, the last on top."""
    layers = []
    for values, place in written:
        if "seed" in values:
            raise UsageError(place, "seed", "the sweep has its own", "write seeds: [0, 1], or seeds=[0,1]")
        if "threads" in values:
            raise UsageError(
                place, "threads", "a trial has one thread", "say how many trials at once: engine.workers=4"
            )
        if "base" in values:
            raise UsageError(place, "base", "a base names no further base", "write its values")
        layers.append(layer_of(values, place))
    return lay_config([*layers, layer_of({"threads": 1}, "a sweep")])


def _with_command_line(
    file: SweepFile, rows: Iterable[Row], laid: Mapping[str, Mapping[str, Any]], measured: Mapping[str, Any]
) -> SweepFile:
    """``file`` with what the command line lays over each of its rows, and below what the metrics say."""
    written = {row.name: merge(file.rows[row.name] or {}, laid[row.name]) for row in rows}
    for row in rows:
        if row.scene is not None:
            written[row.name]["scene"] = asdict(row.scene)
    return replace(file, rows=written, metrics=merge(_measuring(measured), file.metrics))
