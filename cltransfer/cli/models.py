"""The verbs of ``cltransfer models`` and ``cltransfer assets``: what the catalogue has, and getting it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import UsageError
from .shared import Allow, Json, Quiet, Up, settings_of, show, up_of

if TYPE_CHECKING:
    from ..models.catalogue import Entry, Kind

models_app = typer.Typer(help="Networks: what there is, getting them, checking them.", no_args_is_help=True)
assets_app = typer.Typer(help="Demo scenes and clips: what there is, getting them.", no_args_is_help=True)

Catalogue = Annotated[
    list[Path] | None, typer.Option("--catalogue", help="A catalogue of your own, besides CLTRANSFER_CATALOGUE.")
]
Names = Annotated[list[str], typer.Argument(help="Names of the catalogue, or of a group.")]
AcceptNew = Annotated[
    bool, typer.Option("--accept-new", help="Take a file whose sha256 is not known, print and pin what came.")
]


@models_app.command("list")
def models_list(catalogue: Catalogue = None, as_json: Json = False) -> None:
    """Every network: its state, size, task and licence; interface, what is known of it, where it comes from.

    A network is here, to pull, new (to pull, its sha256 not known yet), or to make of what its authors publish.
    """
    _list("model", catalogue, as_json)


@models_app.command("pull")
def models_pull(
    names: Names,
    catalogue: Catalogue = None,
    accept_new: AcceptNew = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Download networks into the cache, where clips are then read with them; nothing is kept with another hash."""
    _pull("model", names, catalogue, accept_new, as_json, quiet)


@models_app.command("adopt")
def models_adopt(
    name: Annotated[str, typer.Argument(help="A network of the catalogue that is to be made: see `models list`.")],
    file: Annotated[Path, typer.Argument(help="The file that you made.")],
    catalogue: Catalogue = None,
    as_json: Json = False,
) -> None:
    """Take FILE for the network NAME: it is copied into the cache, where clips are then read with it.

    cltransfer models adopt mp_pose_landmark_lite blazepose.onnx

    Its sha256 is pinned in place of the catalogue's, because what one makes has other bytes with every version of the
    tools. What is published as a file is pulled instead. Inputs and outputs are checked when it is first used.
    """
    from ..models.places import adopt

    chosen = _chosen("model", [name], catalogue)
    if len(chosen) != 1:
        raise UsageError("", name, "is a group", f"expected one network: {', '.join(had.name for had in chosen)}")
    (entry,) = chosen
    had = adopt(entry, file)
    values = {"name": had.name, "path": str(had.path), "sha256": had.sha256, "pinned": True}
    show(values, f"{had.path} sha256 {had.sha256}, pinned", as_json)


@models_app.command("check")
def models_check(
    names: Annotated[list[str] | None, typer.Argument(help="Names; by default all that are here.")] = None,
    catalogue: Catalogue = None,
    as_json: Json = False,
) -> None:
    """Whether the networks that are here are what the catalogue says; exit code 4 if one is not, or is missing."""
    from ..storage.files import content_hash

    rows, wrong = [], False
    for entry in _chosen("model", names, catalogue):
        found = _place(entry)
        if found is None and not names:
            continue
        state = "missing"
        if found is not None:
            got = content_hash(found)
            known = f"expected {entry.sha256}, got {got}" if entry.sha256 else f"sha256 not known, got {got}"
            state = "ok" if got == entry.sha256 else known
        wrong |= state == "missing" or state.startswith("expected")
        rows.append({"name": entry.name, "file": entry.file, "path": str(found or ""), "state": state})
    show(rows, "\n".join(f"{row['file']}: {row['state']}" for row in rows) or "none is here", as_json)
    if wrong:
        raise typer.Exit(4)


@models_app.command("align")
def models_align(
    scene: Annotated[
        str, typer.Argument(help="A scene: what its renderer knows of depth is held against the network.")
    ],
    overrides: Annotated[
        list[str], typer.Argument(metavar="KEY=VALUE", help="The config; it must have extractors.depth_onnx.")
    ],
    views: Annotated[int, typer.Option(min=1, help="How many, all around the subject.")] = 8,
    subject: Annotated[Path | None, typer.Option(help="subject.json of `cltransfer lift`; else it is lifted.")] = None,
    up: Up = None,
    allow_plugin: Allow = None,
    as_json: Json = False,
) -> None:
    """Read a depth network's scale and shift off SCENE, and print the override that treats a clip the same way.

    cltransfer models align scene.ply 'extractors.depth_onnx={model: depth_anything_v2_small.onnx, kind: disparity,
    multiple: 14, align: shift}'

    The policy is the config's: align=shift or metric. What is printed first stands in for these options of depth_onnx,
    for evaluate and inspect, which have no scene; transfer finds it by itself.
    """
    settings = settings_of(None, overrides, allow_plugin)
    from ..reading.depth_alignment import align_config, depth_network

    found = align_config(scene, settings, views, up_of(up), subject)
    name = depth_network(settings.extractors)
    options = {**settings.extractors[name], "affine": [float(f"{value:.6g}") for value in found.affine]}
    lines = [
        shlex.quote(f"extractors.{name}={json.dumps(options)}"),
        f"inverse depth is off by {100 * found.error[0]:.1f} % as it is, by {100 * found.error[1]:.1f} % so;",
        f"the shift varies by {100 * found.spread:.1f} % of the largest disparity from view to view",
    ]
    error = [None if isnan(e) else e for e in found.error]
    show({**asdict(found), "error": error}, "\n".join(lines), as_json)


@assets_app.command("list")
def assets_list(catalogue: Catalogue = None, as_json: Json = False) -> None:
    """Every demo scene and clip: its state, size, licence and where it comes from; see `models list`."""
    _list("asset", catalogue, as_json)


@assets_app.command("pull")
def assets_pull(
    names: Names,
    catalogue: Catalogue = None,
    accept_new: AcceptNew = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Download demo files into the cache and print where they are; `demo` is a real scene and a real clip."""
    _pull("asset", names, catalogue, accept_new, as_json, quiet)


def _list(kind: Kind, more: list[Path] | None, as_json: bool) -> None:
    entries = _chosen(kind, None, more)
    values = [{**asdict(entry), "path": str(_place(entry) or "")} for entry in entries]
    width = max(len(entry.name) for entry in entries)
    show(values, "\n".join(_lines(entry, width) for entry in entries), as_json)


def _lines(entry: Entry, width: int) -> str:
    state = (
        "here" if _place(entry) else "pull" if entry.address and entry.sha256 else "new" if entry.address else "make"
    )
    size = f"{entry.size / 1e6:.1f} MB" if entry.size else "? MB"
    details = [entry.interface, entry.note, entry.address or f"{entry.source}; {entry.made_by}"]
    head = f"{entry.name:<{width}}  {state}  {size:>8}  {entry.task}; {entry.licence}"
    return "\n".join([head, *(f"{'':<{width}}  {detail}" for detail in details if detail)])


def _pull(kind: Kind, names: list[str], more: list[Path] | None, accept_new: bool, as_json: bool, quiet: bool) -> None:
    from ..models.download import pull
    from ..progress import progress

    rows: list[dict[str, Any]] = []
    try:
        with progress(quiet) as report:
            for entry in _chosen(kind, names, more):
                had = pull(entry, accept_new, report)
                new = had.sha256 != entry.sha256
                rows.append({"name": had.name, "path": str(had.path), "sha256": had.sha256, "pinned": new})
    finally:  # what was pinned is told even where a later one fails
        text = (f"{row['path']}{' sha256 ' + row['sha256'] + ', pinned' if row['pinned'] else ''}" for row in rows)
        if rows:
            show(rows, "\n".join(text), as_json)


def _chosen(kind: Kind, names: Iterable[str] | None, more: list[Path] | None) -> list[Entry]:
    """Entries of ``names``, which may name a group; all where none is named."""
    from ..models.catalogue import catalogue
    from ..registry.typed import nearest

    entries = catalogue(kind, more or ())
    if not names:
        return list(entries.values())
    chosen = []
    for name in names:
        if not name:  # which is the group of whatever has none
            raise UsageError("", "NAME", "expected a name of the catalogue, got ''", f"see: cltransfer {kind}s list")
        found = [entry for entry in entries.values() if name in (entry.name, entry.group, entry.file)]
        if not found:
            known = sorted({*entries, *(entry.group for entry in entries.values() if entry.group)})
            raise UsageError("", name, f"no such {kind} in the catalogue", nearest(name, known))
        chosen += found
    return chosen


def _place(entry: Entry) -> Path | None:
    """Where the file is, None where it is not."""
    from ..models.places import model_places

    places = model_places(entry.file) if entry.kind == "model" else [entry.path]
    return next((place for place in places if place.is_file()), None)
