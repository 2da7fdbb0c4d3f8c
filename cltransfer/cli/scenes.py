"""Verbs on a scene: the person in it, lift; and one scene file made of another, simplify and bake."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from ..errors import UsageError
from ..storage.foreign import OF_A_PERSON, refuse_foreign
from ..storage.run_files import refuse_run
from .shared import Allow, Config, Json, Out, Quiet, Up, check_keys, settings_of, show, up_of

LIFTING = ("renderer", "extractors", "threads", "preset")  # keys of the config that a lift looks at


def lift(
    scene: Annotated[str, typer.Argument(help="Scene file, as in `transfer`, or builtin:NAME.")],
    overrides: Annotated[
        list[str] | None,
        typer.Argument(metavar="KEY=VALUE", help="renderer.mesh={}, extractors.pose_blazepose.model=FILE, threads=1."),
    ] = None,
    out: Out = None,
    view: Annotated[list[Path] | None, typer.Option(help="Trajectory files to look from (repeatable).")] = None,
    views: Annotated[int, typer.Option(help="Views around the person where none are given, 3 to 64.")] = 16,
    person: Annotated[
        int | None, typer.Option(min=0, help="Which one, where there are several; 0 is who most views see.")
    ] = None,
    up: Up = None,
    config: Config = None,
    allow_plugin: Allow = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the person of SCENE: 14 joints in 3D, facing, height, and which of its parts belong to it.

    cltransfer lift scene.ply --out person

    cltransfer lift man.glb renderer.mesh={} --out person

    Leaves subject.json, labels.safetensors and contact_sheet.png in the folder; `transfer` does the same by itself
    and keeps it in the cache. `transfer --subject FOLDER/subject.json` takes another one. Two networks look for the
    person; get them first, once: cltransfer models pull default
    """
    settings = settings_of(config, overrides or [], allow_plugin)
    check_keys(overrides or [], LIFTING, "a lift", "; --views for how many are looked from")
    from ..camera import VIEW_LIMIT
    from ..lift_folder import SHEET, Lifting, lift_lines, lift_to_folder
    from ..progress import progress
    from ..run.folder import default_folder
    from ..scenes.person.lift import MINIMUM_VIEWS
    from ..scenes.person.lifted import summary

    if not MINIMUM_VIEWS <= views <= VIEW_LIMIT:
        raise UsageError("", "--views", f"expected {MINIMUM_VIEWS} to {VIEW_LIMIT}, got {views}")
    folder = out or default_folder(scene, "lift")
    refuse_run(folder, "subject and labels", "person")
    refuse_foreign(folder, OF_A_PERSON, (SHEET,))
    wanted = Lifting(scene, up_of(up), tuple(view or ()), views, person)
    with progress(quiet) as report:
        found = lift_to_folder(wanted, settings, folder, lambda step: report(step, 0, 0))
    show({"folder": str(folder), **summary(found)}, lift_lines(folder, found), as_json)


def simplify(
    scene: Annotated[str, typer.Argument(help="Gaussian splats (.ply, .splat, .spz).")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The .ply to write.")],
    view: Annotated[
        list[str] | None,
        typer.Option(
            help="Where it will be seen from: a trajectory file, SET:INDEX or a posed image SET (repeatable)."
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY=VALUE",
            help="k=2 (px), prune=0 (least part of a pixel that keeps a Gaussian), side=160 (longer side of the frames "
            "that it will be seen in [px]), floaters=keep.",
        ),
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Merge the Gaussians of SCENE that no view can tell apart, and leave out those that no view shows.

    cltransfer simplify scene.ply --view run/trajectory.json --out small.ply k=2

    cltransfer simplify scene.ply --out clean.ply k=0 floaters=drop

    `transfer` does the first by itself while searching: lod=2. The second leaves out those that hang in the air by
    themselves and nothing else, as `transfer` does for its search, and needs no view.
    """
    from ..config.layers import parse_overrides
    from ..convert_scene import Simplification, simplify_file
    from ..progress import progress
    from ..registry.typed import typed

    options = typed(Simplification, parse_overrides(overrides or []))
    with progress(quiet) as report:
        found = simplify_file(scene, out, view or [], options, report)
    steps = {"solid": options.floaters == "drop", "pruned": options.prune > 0, "after": options.k > 0}
    words = {"solid": "without floaters", "pruned": "after pruning", "after": "after merging"}
    done = ", ".join(f"{found[name]:,} {words[name]}" for name, taken in steps.items() if taken)
    text = f"{found['before']:,} Gaussians, {done or 'all kept'}: {out}"
    show(found, text, as_json)


def bake(
    mesh: Annotated[str, typer.Argument(help="Mesh (.glb, .gltf, .obj, .ply) or a .yaml that composes meshes.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the scene and its person.")],
    representation: Annotated[str, typer.Option("--as", help="gaussian_splats or nerf_grid.")] = "gaussian_splats",
    detail: Annotated[
        int | None, typer.Option(help="Gaussians in all, or cells along the longest side (up to 512).")
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Turn MESH into splats or a voxel grid of the same geometry, to compare representations and nothing else.

    cltransfer bake man.glb --as gaussian_splats --out baked

    Leaves the scene, and subject.json and labels.safetensors where the mesh has a skeleton.
    """
    if representation not in ("gaussian_splats", "nerf_grid"):
        raise UsageError("", "--as", f"expected gaussian_splats or nerf_grid, got {representation!r}")
    most = 10_000_000 if representation == "gaussian_splats" else 512
    if detail is not None and not 2 <= detail <= most:
        raise UsageError("", "--detail", f"expected 2 to {most}, got {detail}")
    refuse_run(out, "subject and labels", "baked")
    refuse_foreign(out, OF_A_PERSON)
    from ..convert_scene import bake_to_folder
    from ..progress import progress
    from ..storage.run_files import SUBJECT

    with progress(quiet) as report:
        found = bake_to_folder(mesh, out, representation, detail, report)  # type: ignore[arg-type]  # checked above
    up = ",".join(f"{value:g}" for value in found["up"])
    command = ["cltransfer", "transfer", found["file"], "CLIP", "--up", up]
    command += ["--subject", str(out / SUBJECT)] if found["subject"] else []
    command += ["renderer.nerf_grid={}"] if representation == "nerf_grid" else []
    show(found, f"{found['file']}: {found['count']:,} primitives; {shlex.join(command)}", as_json)
