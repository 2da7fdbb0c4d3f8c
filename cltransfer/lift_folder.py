"""The lift as a verb: scene in; subject.json, labels and a contact sheet out, the cache filled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .camera import VIEW_LIMIT, Camera, evenly_taken, in_one_frame
from .computer.threads import default_count, set_threads, threads_restored
from .config.options import RunConfig
from .drawing import drawn_by
from .pipeline.components import Components
from .reading.named_scenes import remember
from .report.contact_sheet import write_contact_sheet
from .scenes.load import load_scene
from .scenes.person.find_people import SIZE
from .scenes.person.lift import Lift, LiftOptions
from .scenes.person.lifted import cache_lift, cached_lift, lift_scene, save_lift, summary
from .storage.files import told_from_here
from .storage.run_files import LABELS, SUBJECT
from .trajectory import Trajectory

SHEET = "contact_sheet.png"


@dataclass(frozen=True)
class Lifting:
    """What is to be lifted.

    Args:
        scene: a scene file.
        up: upwards in it; None takes the format's usual one.
        view: trajectory files to look from, 64 cameras evenly taken; none looks from a ring around the person.
        views: how many of a ring.
        person: which one, 0 for the one that most views see.
    """

    scene: str
    up: tuple[float, float, float] | None = None
    view: tuple[Path, ...] = ()
    views: int = LiftOptions.views
    person: int | None = None


@threads_restored()
def lift_to_folder(wanted: Lifting, config: RunConfig, folder: Path, progress: Callable[[str], None]) -> Lift:
    """Lift a person of a scene and write what is known of it.

    Without any choice it also fills the cache that ``transfer`` looks in. Meanwhile the threads of the whole process
    are as ``config`` says.

    Raises:
        InputError: the scene is damaged, or no person is found.
        ModelError: a network is missing.
    """
    set_threads(config.threads or default_count())
    parts = Components.build(config)
    scene = load_scene(wanted.scene, wanted.up)
    options = LiftOptions(wanted.views, _given(wanted.view), wanted.person)
    found = lift_scene(scene, parts.renderer, parts.extractors, options, progress)
    save_lift(folder, found)
    image = drawn_by(parts.renderer, scene, found.cameras, frozenset({"image"})).require("image")
    write_contact_sheet(folder / SHEET, image, found)
    if not wanted.view and wanted.views == LiftOptions.views and not wanted.person:
        cache_lift(cached_lift(scene, parts.renderer, parts.extractors).parent, found)
    remember(scene.digest, wanted.scene)
    return found


def _given(files: tuple[Path, ...]) -> Camera | None:
    if not files:
        return None
    cameras = [Trajectory.load(file).camera for file in files]
    width = SIZE[0]
    sizes = [(width, round(width * camera.size[1] / camera.size[0])) for camera in cameras]
    return evenly_taken(in_one_frame(cameras, sizes), VIEW_LIMIT)  # every pair of them is tried against all


def lift_lines(folder: Path, found: Lift) -> str:
    """What was found, joint by joint, and where it is."""
    told = summary(found)
    error = told["median_error_widths"]
    others = f"{told['people']} people in the scene: --person 0 to {told['people'] - 1}"
    lines = [
        *([others] if told["people"] > 1 else []),
        f"person in {told['views_with_person']} of {told['views']} views; {told['joints_known']} of 14 joints; "
        f"median reprojection {100 * error:.2f} % of the frame width; {told['labelled']} primitives labelled",
        f"{'joint':<16}{'seen':>6}{'agreed':>8}{'error [% width]':>18}",
    ]
    for name, joint in told["joints"].items():
        shown = "not known" if joint["error_widths"] is None else f"{100 * joint['error_widths']:.2f}"
        lines.append(f"{name:<16}{joint['seen']:>6}{joint['agreed']:>8}{shown:>18}")
    lines += [f"{name:<20} {told_from_here(folder / name)}" for name in (SUBJECT, LABELS, SHEET)]
    return "\n".join(lines)
