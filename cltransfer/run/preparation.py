"""Before a search: scene, reference, stage and starts, from what a transfer is given."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from ..along_clip import check_span, check_times, places
from ..camera import Camera, fitted_size, resized
from ..clips.part import CUT, HINT
from ..computer.threads import default_count, set_threads
from ..config.options import RunConfig
from ..drawing import check_renderer
from ..driver.guard import READ, Guard
from ..driver.initial_view import any_view
from ..driver.journal import fingerprint
from ..driver.journal_header import VIEW
from ..driver.recent import Recent
from ..driver.schedule import Schedule, make_schedule
from ..driver.stage import Stage
from ..driver.starts import Starting, Starts
from ..errors import UsageError
from ..features import Features
from ..pipeline.components import Components
from ..pipeline.plan import Family
from ..progress import Progress
from ..reading.depth_alignment import DepthAlignment, align_parts, load_network, needs_scene
from ..reading.noise import noise_floor
from ..reading.reference import Reading, Reference, as_read, read_reference, times_field
from ..reading.tracks import cleaned
from ..registry.plugin_code import own_code
from ..scenes import Scene
from ..scenes.floaters import without_floaters
from ..scenes.person.lifted import lifted_scene
from ..scenes.simplify import check_merged
from ..search import check_search
from .initial import check_apart, given_view, tell_other_shape, tell_turned_away
from .inputs import Inputs, given_scene
from .readback import check_result
from .record import Record, run_header


class Clock:
    """Seconds by step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, step: str) -> None:
        """Everything since the last lap was ``step``."""
        now = time.perf_counter()
        self.seconds[step] = self.seconds.get(step, 0.0) + now - self._last
        self._last = now


@dataclass(frozen=True)
class Job:
    """Everything a search starts from."""

    config: RunConfig
    parts: Components
    search: Any
    reference: Reference
    wanted: Features  # the reference, cleaned where it was read from a clip
    stage: Stage  # the scene as it was given
    solid: Scene  # the same without its floaters where the config says so
    schedule: Schedule
    noise: float  # total that cannot be told apart
    starting: Starting  # how a start is found
    starts: Starts  # in the scene without its floaters
    by_networks: bool  # whether networks read the result
    alignment: DepthAlignment | None  # of the depth network, where it was read off the scene
    header: dict[str, Any]  # what its answers depend on

    @property
    def floaters(self) -> int:
        """Gaussians that were left out of the scene."""
        whole, left = self.stage.scene, self.solid
        return 0 if left is whole else len(whole.geometry) - len(left.geometry)


@dataclass(frozen=True)
class _Given:
    """What a transfer is given, read."""

    parts: Components  # that read the reference
    family: Family  # of the extractors that the search asks
    scene: Scene  # with its person where one is needed
    view: Camera | None  # that a start was named by
    reference: Reference
    wanted: Features  # see :class:`Job`
    by_networks: bool  # whether networks read the result
    alignment: DepthAlignment | None


def prepare(inputs: Inputs, config: RunConfig, clock: Clock, progress: Progress, record: Record | None) -> Job:
    """Everything a search starts from.

    Raises:
        UsageError: the config asks for what the scene or the reference cannot give.
        InputError: a file is missing or damaged, or shows no person.
        ModelError: a network is missing.
        ResourceError: the frames to render cannot be kept in memory.
    """
    own_code()  # of the journal: as it lies here before anything is read, which takes its time
    set_threads(config.threads or default_count())
    parts, search = Components.build(config), config.build_one("search")
    _check_still(config, search)
    given = _read(inputs, config, parts, search, clock, progress)
    parts, scene, reference, wanted = given.parts, given.scene, given.reference, given.wanted
    solid = scene
    if config.floaters == "drop":
        solid = without_floaters(scene)
        clock.lap("floaters")
    stage = _stage(config, parts, scene, reference, given.family)
    output = fitted_size(reference.features.size, config.output_side)
    check_result(len(reference), output)  # rather than after the search
    held = {} if given.view is None else {VIEW: fingerprint(given.view)}
    header = run_header(inputs, config, parts, search, scene, reference) | held
    if record is not None:
        stage = replace(stage, journal=record.open(header))
    noise = noise_floor(stage.objective, reference.features, wanted, reference.times)
    schedule = make_schedule(config, search, stage.objective, wanted, noise)
    view = None if given.view is None else resized(given.view, output)
    home = any_view(scene.subject, output) if view is None and scene.subject is not None else view
    about = scene.subject if search.needs_subject else None
    if view is not None and about is not None:
        check_apart(inputs.init, view, about)
    if home is not None:
        check_search(search, home, scene.subject)
    if given.view is not None:
        tell_other_shape(inputs.init, given.view, reference.features.size)
    if view is not None and about is not None:
        tell_turned_away(inputs.init, view, about)
    at = places(reference.times)
    starting = Starting(search, schedule, config.guide, view, output, reference.family == "image", at)
    starts = starting.starts(replace(stage, scene=solid), wanted)
    if record is not None and stage.journal is not None:
        record.settle(stage.journal)
    clock.lap("initial view")
    return Job(
        config, parts, search, reference, wanted, stage, solid, schedule, noise, starting, starts,
        given.by_networks, given.alignment, header,
    )  # fmt: skip


def _read(
    inputs: Inputs, config: RunConfig, parts: Components, search: Any, clock: Clock, progress: Progress
) -> _Given:
    """Scene, first view, reference and person, each as soon as what is wrong with it can show."""
    family: Family = "scene" if config.extract.inner == "geometric" else "image"
    scene = given_scene(inputs)  # read before the reference: what is wrong with it shows at once
    check_renderer(parts.renderer, scene)
    if config.lod > 0:
        check_merged(scene)
    view = None if inputs.init == "auto" else given_view(inputs.init)
    clock.lap("scene")
    lift = partial(lifted_scene, renderer=parts.renderer, extractors=parts.extractors, person=_person(inputs, scene))
    alignment = None
    if needs_scene(parts, inputs.reference, family):
        load_network(parts)
        scene = lift(scene)  # what the reference's depth means is read off it
        parts, alignment = align_parts(parts, scene)
        clock.lap("depth alignment")
    reference = read_reference(inputs.reference, parts, Reading(config.frames, config.output_side, family), progress)
    field = times_field(inputs.reference)
    check_times(inputs.reference, field, reference.times, HINT)  # the result has them too
    check_span(inputs.reference, field, reference.times, CUT)
    parts = as_read(parts, reference)
    by_networks = reference.family == "image" and config.extract.verify
    if by_networks or family == "image":
        parts.plan("image").load_networks()
    wanted = reference.features
    if reference.family == "image":
        wanted = cleaned(wanted, config.clean, places(reference.times), reference.times)
    parts.check_single(family, reference.features.names())  # rather than at the first candidate
    clock.lap("reference")
    if family == "scene" or search.needs_subject or view is None or isinstance(inputs.subject, int):
        scene = lift(scene, progress=lambda step: progress(step, 0, 0))
        clock.lap("lift")
    return _Given(parts, family, scene, view, reference, wanted, by_networks, alignment)


def _check_still(config: RunConfig, search: Any) -> None:
    """Refuse a lens that is to keep still where nothing keeps it.

    Raises:
        UsageError: frames are left as they are found, or the search does not tell what its lens is.
    """
    if config.zoom != "still":
        return
    if config.path != "smooth":
        hint = "set path=smooth, or zoom=fixed for the focal length of the first frame"
        raise UsageError("", "zoom", f"still is for a path, expected path smooth, got {config.path}", hint)
    if getattr(search, "lens", None) is None:
        name = next(iter(config.search))
        raise UsageError("", "zoom", f"search {name} does not tell what its lens is", "subject_orbit does")


def _person(inputs: Inputs, scene: Scene) -> int | None:
    """Which person of ``scene`` is to be lifted.

    Raises:
        UsageError: the scene tells by itself who its person is.
    """
    if not isinstance(inputs.subject, int):
        return None
    if scene.subject is not None:
        raise UsageError("", "--subject", "this scene tells its person itself, nobody is lifted", "leave it out")
    return inputs.subject


def _stage(config: RunConfig, parts: Components, scene: Scene, reference: Reference, family: Family) -> Stage:
    """What renders and scores ``scene`` as the reference was read, by its own ``family``."""
    watched = READ if config.guard and family == "scene" else frozenset()
    plan = parts.plan(family, reference.features.names(), watched)
    defined = parts.objective.defined(reference.features)
    parts.objective.check_residuals(reference.features, defined)
    told = defined.any(0).tolist()
    objective = replace(parts.objective, silent=frozenset(n for n, there in zip(parts.losses, told) if not there))
    guard = Guard(None if scene.subject is None else scene.subject.height) if config.guard else None
    small = fitted_size(reference.features.size, config.search_side)
    recent = Recent.of(len(reference), small)
    return Stage(scene, parts.renderer, plan, objective, small, guard=guard, recent=recent)
