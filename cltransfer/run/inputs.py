"""What a transfer is given beside its config."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path

from ..errors import UsageError
from ..scenes import Scene
from ..scenes.foreign import check_geometry
from ..scenes.load import load_scene
from ..scenes.person.lifted import load_person


@dataclass(frozen=True)
class Inputs:
    """What a transfer is given beside its config.

    Args:
        scene: a scene file, ``builtin:NAME``, or from Python a scene, whose digest stands for it in caches and journal.
        reference: see :func:`cltransfer.reading.reference.read_reference`.
        init: ``auto``, or see :func:`cltransfer.run.initial.given_view`.
        subject: a subject.json; or which person is lifted, or taken from the cache, 0 for the one that most views see;
            None is that one, and who the scene tells by itself.
        up: the scene's up; None takes the format's usual one, or the scene's own.

    A :class:`~pathlib.Path` is kept as text, but for ``subject``, whose text becomes a path.

    Raises:
        UsageError: ``subject`` is neither a path nor a number.
    """

    scene: str | Scene
    reference: str
    init: str = "auto"
    subject: Path | int | None = None
    up: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("scene", "reference", "init"):
            if isinstance(value := getattr(self, name), os.PathLike):
                object.__setattr__(self, name, os.fspath(value))
        if self.subject is not None:
            object.__setattr__(self, "subject", _subject(self.subject))

    @property
    def part(self) -> str:
        """What of the reference is taken, as in ``t=1,2``; empty for all of it."""
        return Path(self.reference).name.partition("#")[2]


def _subject(given: object) -> Path | int:
    """A file's path, as text too, or a number, as numpy's too."""
    if isinstance(given, str | Path):
        return Path(given)
    if isinstance(given, Integral) and not isinstance(given, bool):
        return int(given)
    expected = f"expected a path or a whole number, got {type(given).__name__}"
    raise UsageError(
        "", "subject", expected, "a subject.json, or a number: 0 is the person that most views see, 1 the next"
    )


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
    return load_person(scene, inputs.subject) if isinstance(inputs.subject, Path) else scene


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
