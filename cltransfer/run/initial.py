"""The view that somebody names for the search to begin at, read and held against the person and the reference."""

from __future__ import annotations

import logging
import math
import shlex
from pathlib import Path

from ..camera import Camera
from ..errors import InputError, UsageError
from ..reading.odd_lenses import ASIDE, tell_beside, tell_oblong
from ..scenes.posed import named_camera, read_posed
from ..scenes.posed.formats import SET_FILES
from ..subject import Subject
from ..trajectory import Trajectory

AMID = 1e-6  # subject heights from the middle of the body, below which rounding alone tells in which direction

_log = logging.getLogger("cltransfer")


def given_view(source: str) -> Camera:
    """The view a person names, at its own size.

    A principal point beside the middle is told of, and pixels that are not square: no search keeps either.

    Args:
        source: a trajectory file (its first camera), or ``SET:INDEX``, a camera of a posed image set, counted from 0
            in the set's own order (COLMAP: of names).

    Raises:
        InputError: the file is no trajectory, or the set cannot be read.
        UsageError: the set has no such camera, or is named without one.
    """
    camera = named_camera(source, "--init")
    camera = _first_camera(Path(source)) if camera is None else camera
    tell_beside(f"--init {source}", camera, "the search begins as if it were there")
    tell_oblong(f"--init {source}", camera, "the search begins with fy alone")
    return camera


def check_apart(source: str, view: Camera, subject: Subject) -> None:
    """Hold the view of ``source`` against the person's middle, from where a search about the person has no direction.

    Raises:
        InputError: it stands there.
    """
    if not float((view.center - subject.anchor).norm()) > AMID * subject.height:
        reason = "expected a camera beside the person, got one at the middle of the body"
        raise InputError(f"--init {source}", "", reason, "move it away by half a height or more")


def tell_turned_away(source: str, view: Camera, subject: Subject) -> None:
    """Tell where the view of ``source`` has the person behind it: a search about the person has no such view."""
    if float(view.project(subject.anchor[None])[1]) <= 0:
        hint = "the search begins there too, but turned to the person"
        _log.warning("--init %s: expected a view towards the person, who is behind this camera; %s", source, hint)


def tell_other_shape(source: str, view: Camera, size: tuple[int, int]) -> None:
    """Tell where the frame of ``view`` is of another shape than one of ``size`` (W, H): its lens is kept as high."""
    half = float(view.size[0] / view.K[0, 0, 0] / 2)  # of the frame's width, by its distance
    taken = float(view.size[1] / view.focal / 2) * size[0] / size[1]
    if abs(taken / half - 1) > ASIDE:
        shapes = "expected {} x {} as the reference, got {} x {}".format(*size, *view.size)
        across = f"{_degrees(taken)} across instead of {_degrees(half)}"
        lens = f"a lens that is as high as that one, {math.degrees(float(view.vertical_fov)):.3g} degrees, and {across}"
        _log.warning("--init %s: frame: %s; the search begins with %s", source, shapes, lens)


def _degrees(half: float) -> str:
    """The angle of a frame whose half is ``half`` of its distance."""
    return f"{math.degrees(2 * math.atan(half)):.3g}"


def _first_camera(path: Path) -> Camera:
    try:
        return Trajectory.load(path).camera[0]
    except InputError as error:
        if not path.is_dir() and path.name not in SET_FILES:
            raise
        told = error
    try:
        count = len(read_posed(path))
    except InputError:
        raise told from None
    first, last = (shlex.quote(f"{path}:{index}") for index in (0, count - 1))
    came = f"expected SET:INDEX, it has {count} cameras, {first} to {last}"
    raise UsageError(path, "--init", came)
