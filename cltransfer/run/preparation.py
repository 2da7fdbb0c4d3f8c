"""Before a search: scene, reference, stage and starts, from what a transfer is given."""

from __future__ import annotations

import os
import re
import shlex
import time
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import torch

from ..camera import fitted_size, resized
from ..computer.threads import default_count, set_threads, thread_count
from ..config.options import RunConfig
from ..driver.guard import READ, Guard
from ..driver.initial_view import any_view, given_view, tell_turned_away
from ..driver.journal import VIEW, Journal, fingerprint
from ..driver.schedule import Schedule, make_schedule
from ..driver.stage import Stage
from ..driver.starts import Starting, Starts
from ..errors import UsageError
from ..features import Features
from ..models.content import files_content, model_content, own_model
from ..pipeline.components import Components
from ..pipeline.objective import Objective
from ..pipeline.plan import Family
from ..progress import Progress
from ..reading.depth_alignment import DepthAlignment, align_parts, needs_scene
from ..reading.places import places
from ..reading.reference import Reading, Reference, read_reference
from ..reading.tracks import cleaned, turned_back
from ..registry.plugin_code import code_of
from ..scenes import Scene
from ..scenes.floaters import without_floaters
from ..scenes.foreign import check_geometry
from ..scenes.load import load_scene
from ..scenes.person.lifted import lifted_scene, load_person
from ..search import check_search
from ..storage.run_files import DONE
from .readback import check_result


@dataclass(frozen=True)
class Inputs:
    """What a transfer is given beside its config.

    Args:
        scene: a scene file, ``builtin:NAME``, or from Python a scene, whose digest stands for it in caches and journal.
        reference: see :func:`cltransfer.reading.reference.read_reference`.
        init: ``auto``, or see :func:`cltransfer.driver.initial_view.given_view`.
        subject: a subject.json; None lifts the scene, or takes the lift from the cache.
        up: the scene's up; None takes the format's usual one, or the scene's own.

    A :class:`~pathlib.Path` is kept as text.
    """

    scene: str | Scene
    reference: str
    init: str = "auto"
    subject: Path | None = None
    up: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("scene", "reference", "init"):
            if isinstance(value := getattr(self, name), os.PathLike):
                object.__setattr__(self, name, os.fspath(value))

    @property
    def part(self) -> str:
        """What of the reference is taken, as in ``t=1,2``; empty for all of it."""
        return Path(self.reference).name.partition("#")[2]


@dataclass(frozen=True)
class Record:
    """The journal of a run.

    Args:
        path: of the file.
        resume: go on with what is there.
    """

    path: Path
    resume: bool = False

    def open(self, header: dict[str, Any]) -> Journal:
        """The journal of a run that depends on ``header``; from now on what lies beside it is not finished.

        Raises:
            InputError: it is resumed, and is of another run or no journal.
            UsageError: it is not, and this very run was begun here and has not come to its end.
        """
        done, folder = self.path.with_name(DONE), self.path.parent
        if not (self.resume or done.is_file()) and Journal.begun(self.path, header):
            hint = f"go on with --resume {shlex.quote(str(folder))}, or name another --out"
            raise UsageError(folder, "--out", "this run was begun there and has not come to its end", hint)
        journal = Journal(self.path, header, self.resume)
        done.unlink(missing_ok=True)
        return journal


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

    @property
    def floaters(self) -> int:
        """Gaussians that were left out of the scene."""
        whole, left = self.stage.scene, self.solid
        return 0 if left is whole else len(whole.geometry) - len(left.geometry)


def prepare(inputs: Inputs, config: RunConfig, clock: Clock, progress: Progress, record: Record | None) -> Job:
    """Everything a search starts from.

    Raises:
        UsageError: the config asks for what the scene or the reference cannot give.
        InputError: a file is missing or damaged, or shows no person.
        ModelError: a network is missing.
        ResourceError: the frames to render cannot be kept in memory.
    """
    set_threads(config.threads or default_count())
    parts = Components.build(config)
    family: Family = "scene" if config.extract.inner == "geometric" else "image"
    search = config.build_one("search")
    scene = given_scene(inputs)  # read before the reference: what is wrong with it shows at once
    view = None if inputs.init == "auto" else given_view(inputs.init)
    clock.lap("scene")
    lift = partial(lifted_scene, renderer=parts.renderer, extractors=parts.extractors)
    alignment = None
    if needs_scene(parts, inputs.reference, family):
        scene = lift(scene)  # what the reference's depth means is read off it
        parts, alignment = align_parts(parts, scene)
        clock.lap("depth alignment")
    reference = read_reference(inputs.reference, parts, Reading(config.frames, config.output_side, family), progress)
    by_networks = reference.family == "image" and config.extract.verify
    if by_networks or family == "image":
        parts.plan("image").load_networks()
    at = places(reference.times)
    wanted = cleaned(reference.features, config.clean, at) if reference.family == "image" else reference.features
    clock.lap("reference")
    if family == "scene" or search.needs_subject or view is None:
        scene = lift(scene, progress=lambda step: progress(step, 0, 0))
        clock.lap("lift")
    solid = scene
    if config.floaters == "drop":
        solid = without_floaters(scene)
        clock.lap("floaters")
    watched = READ if config.guard and family == "scene" else frozenset()
    plan = parts.plan(family, reference.features.names(), watched)
    small, output = (fitted_size(reference.features.size, side) for side in (config.search_side, config.output_side))
    check_result(len(reference), output)  # rather than after the search
    journal = None
    if record is not None:
        held = {} if view is None else {VIEW: fingerprint(view)}
        journal = record.open(_header(inputs, config, parts, search, scene, reference) | held)
    told = parts.objective.defined(reference.features).any(0).tolist()
    objective = replace(parts.objective, silent=frozenset(n for n, there in zip(parts.losses, told) if not there))
    stage = Stage(scene, parts.renderer, plan, objective, small, guard=_guard(config, scene), journal=journal)
    noise = noise_floor(stage.objective, reference.features, wanted)
    schedule = make_schedule(config, search, stage.objective, wanted, noise)
    given, read = None if view is None else resized(view, output), reference.family == "image"
    home = any_view(scene.subject, output) if given is None and scene.subject is not None else given
    if home is not None:
        check_search(search, home, scene.subject)
    if given is not None and search.needs_subject and scene.subject is not None:
        tell_turned_away(inputs.init, given, scene.subject)
    starting = Starting(search, schedule, config.guide, given, output, read, at)
    starts = starting.starts(replace(stage, scene=solid), wanted)
    clock.lap("initial view")
    return Job(
        parts, search, reference, wanted, stage, solid, schedule, noise, starting, starts, by_networks, alignment
    )


def _guard(config: RunConfig, scene: Scene) -> Guard | None:
    return Guard(None if scene.subject is None else scene.subject.height) if config.guard else None


def _header(
    inputs: Inputs, config: RunConfig, parts: Components, search: Any, scene: Scene, reference: Reference
) -> dict[str, Any]:
    """What the answers of a run depend on."""
    networks = {name: own_model(extractor) for name, extractor in parts.extractors.items()}
    named = {f"extractor {name}": extractor for name, extractor in parts.extractors.items()}
    named |= {f"loss {name}": loss for name, loss in parts.losses.items()}  # an extractor may have the same name
    named |= {"the renderer": parts.renderer, "the search": search}
    # what a scene's file says is in its digest; a path that stands in it is nobody's option
    code = {**{name: code_of(part) for name, part in named.items()}, "the scene": scene.code}
    return {
        **{f"config.{key}": value for key, value in asdict(config).items()},
        "order of losses and extractors": [list(config.losses), list(config.extractors)],  # that of the terms recorded
        "scene": scene.digest,
        "person": scene.person_digest,
        "reference": reference.digest,
        "unread of the reference": sorted(reference.features.reasons),  # this time: OfThisRun
        "part of the reference": inputs.part,
        "init": inputs.init,
        **{f"network of {name}": model_content(model) for name, model in networks.items() if model is not None},
        **{f"files of {name}": content for name, part in named.items() if (content := files_content(part))},
        **{f"code of {name}": content for name, content in code.items() if content},
        "versions": {name: metadata.version(name) for name in ("cltransfer", "torch", "numpy", "numba", "cma")},
        "threads": thread_count(),
    }


def noise_floor(objective: Objective, read: Features, wanted: Features) -> float:
    """Total that the networks' jitter makes up: the reference as it was read against itself filtered.

    0 where it was not filtered. Nothing below it can be told apart. A frame read back to front is an error, no jitter.
    """
    terms = objective.terms(read if wanted is read else turned_back(read), wanted)
    defined = torch.isfinite(terms) & objective.defined(read)
    return float(objective.totals(terms, defined).mean())


def given_scene(inputs: Inputs) -> Scene:
    """The scene, with its person where that is given or known.

    Raises:
        UsageError: ``up`` is told of a scene that has its own, or a scene has no name or no digest.
        InputError: a file is missing or damaged.
        ModelError: what a plugin has made of it is no geometry.
    """
    scene = (
        _checked(inputs.scene, inputs.up) if isinstance(inputs.scene, Scene) else load_scene(inputs.scene, inputs.up)
    )
    return scene if inputs.subject is None else load_person(scene, inputs.subject)


def _checked(scene: Scene, up: tuple[float, float, float] | None) -> Scene:
    """A scene that somebody's code has made: as :func:`load_scene` would have left it."""
    if up is not None:
        raise UsageError(scene.name, "up", "a scene has its own", "leave it out")
    if not scene.name:
        raise UsageError("", "scene", "expected a name, got none", 'replace(scene, name="stage")')
    if not re.fullmatch("[0-9a-f]{64}", scene.digest):
        hint = "caches and journals know it again by that: hashlib.sha256(what it is made from).hexdigest()"
        raise UsageError(scene.name, "digest", f"expected a SHA-256 in hex, got {scene.digest!r}", hint)
    check_geometry(scene.name, "scene", scene.geometry)
    return scene
