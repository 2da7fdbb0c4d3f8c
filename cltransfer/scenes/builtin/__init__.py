"""Scenes that come with the program, made from code, with a person whose joints are known."""

from __future__ import annotations

import functools
import hashlib
from typing import Any

import numpy as np
import torch

from ...errors import UsageError
from ...subject import Subject
from .. import Scene
from .forms import as_grid, as_mesh, as_splats, painted
from .more_sets import path, room, stage
from .place import Place
from .sets import courtyard, plaza
from .surfaces import Array

VERSION = 3  # part of the digest: raise it when the same name and seed give other Gaussians

DRAWN = {"path": path, "room": room, "stage": stage}  # every seed is another person, furniture and texture
DESIGNED = {"courtyard": courtyard, "plaza": plaza}  # seed 0 is as designed, the others are drawn
SETS = (*DESIGNED, *DRAWN)
SEED_DIGITS = 18
FORMS = {"splats": as_splats, "mesh": as_mesh, "grid": as_grid}


@functools.lru_cache(maxsize=2)  # a bench asks for teacher and pupil again and again, and a grid takes 10 s
def builtin_scene(name: str, seed: int = 0, form: str = "splats") -> Scene:
    """Scene ``name`` in metres.

    Args:
        name: one of :data:`SETS`.
        seed: of textures, person and furniture, >= 0; every seed is another scene.
        form: splats, mesh or grid: the same geometry. A grid ends some way around the person, see
            :func:`cltransfer.scenes.builtin.forms.as_grid`.

    Raises:
        UsageError: there is no such scene or form.
    """
    _check(name, form)
    place = _place(name, seed)
    world = np.array(place.axes, float)
    cells = painted(
        [*place.parts, *place.body.parts()], np.array(place.sun), np.random.Generator(np.random.PCG64(seed))
    )
    geometry: Any = FORMS[form](cells, world)
    text = f"builtin:{name}:{seed}:{VERSION}" + ("" if form == "splats" else f":{form}")
    label = "-".join([name, *([str(seed)] if seed or form != "splats" else []), *([form] if form != "splats" else [])])
    up = torch.from_numpy(world[2].copy())
    return Scene(geometry, _subject(place, world), up, label, hashlib.sha256(text.encode()).hexdigest())


def named_scene(text: str) -> Scene:
    """The scene that ``text`` names, see :func:`read_name`.

    Raises:
        UsageError: there is no such scene or form, or the seed is no whole number of 18 digits or less.
    """
    return builtin_scene(*read_name(text))


def read_name(text: str) -> tuple[str, int, str]:
    """Name, seed and form of ``NAME``, ``NAME-SEED`` or ``NAME-SEED-FORM``, as in ``room-3-mesh``; nothing is made.

    Raises:
        UsageError: there is no such scene or form, or the seed is no whole number of 18 digits or less.
    """
    name, _, rest = text.partition("-")
    seed, _, form = rest.partition("-")
    if len(seed) > SEED_DIGITS:
        raise UsageError("", f"scene {text[:20]!r}...", f"expected a seed of at most {SEED_DIGITS} digits")
    if rest and not seed.isdecimal():
        raise UsageError("", f"scene {text!r}", f"expected NAME-SEED-FORM, got the seed {seed!r}", "as in room-3-mesh")
    form = form or "splats"
    _check(name, form)
    return name, int(seed or 0), form


def _check(name: str, form: str) -> None:
    if name not in SETS:
        raise UsageError("", f"scene {name!r}", "no such built-in scene", f"known: {', '.join(sorted(SETS))}")
    if form not in FORMS:
        raise UsageError("", f"scene {name}", f"no form {form!r}", f"known: {', '.join(FORMS)}")


def _place(name: str, seed: int) -> Place:
    rng = np.random.Generator(np.random.PCG64([seed, SETS.index(name)]))
    if name in DRAWN:
        return DRAWN[name](rng)
    return DESIGNED[name](rng if seed else None)


def _subject(place: Place, world: Array) -> Subject:
    up, facing = (torch.from_numpy(world[axis].copy()) for axis in (2, 0))
    joints = torch.from_numpy(place.body.joints() @ world)
    confidence = torch.ones(14, dtype=torch.float64)
    return Subject(joints, confidence, facing, up, place.body.height, 1.0, place.people)
