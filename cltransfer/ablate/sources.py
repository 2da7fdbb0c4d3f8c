"""What a sweep names, looked for before its first trial: each is told with its file and key."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..config.layers import origin
from ..errors import CltransferError
from ..reading.scene_source import split_scene
from ..registry.declared import BUILTIN
from ..scenes.builtin import read_name
from ..shots import own_setup
from .content import Digest, digests
from .read import DRAWN
from .sweep import SceneConfig, Sweep


def check_sources(sweep: Sweep, digest: Digest | None = None) -> None:
    """Look for every scene, view, person and reference of ``sweep``, and for every shot that is to be drawn.

    Args:
        sweep: the ablation.
        digest: what identifies a source, for one who will ask again.

    Raises:
        UsageError: there is no such built-in scene or shot.
        InputError: a file is missing or damaged.
    """
    digest = digest or digests()
    for key, scene in _scenes(sweep).items():
        person = None if isinstance(scene.subject, int) else scene.subject
        for name, source in (("scene", scene.scene), ("init", scene.init), ("subject", person)):
            with _under(sweep, f"{key}.{name}"):
                digest(source)
                if name == "scene":
                    _check_scene(scene.scene)
    for i, reference in enumerate(sweep.file.references):
        with _under(sweep, f"references[{i}]"):
            if reference.startswith(DRAWN):
                own_setup(reference.removeprefix(DRAWN))
            else:
                digest(reference)
                _check_reference(reference)


def _scenes(sweep: Sweep) -> dict[str, SceneConfig]:
    """Every scene that some row is run in, by its key."""
    own = {f"rows.{row.name}.scene": row.scene for row in sweep.rows if row.scene is not None}
    if len(own) == len(sweep.rows):
        return own
    return {**{f"scenes[{i}]": scene for i, scene in enumerate(sweep.file.scenes)}, **own}


def _check_scene(source: str) -> None:
    if source.startswith(BUILTIN):
        read_name(source.removeprefix(BUILTIN))


def _check_reference(source: str) -> None:
    split = split_scene(source)
    if split is not None:
        _check_scene(split[0])
    elif source.startswith(BUILTIN):
        own_setup(source.removeprefix(BUILTIN))


@contextmanager
def _under(sweep: Sweep, key: str) -> Iterator[None]:
    """What is wrong within is told with the ``key`` that it stands under, and where that was written."""
    try:
        yield
    except CltransferError as error:
        where = ": ".join(filter(None, (key, error.where, error.field)))
        raise type(error)(origin(sweep.origins, key.partition("[")[0]), where, error.reason, error.hint) from None
