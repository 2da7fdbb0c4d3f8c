"""Structure from motion: the camera path of a clip and the depth of what stands still in it, from its own movement."""

from __future__ import annotations

from typing import Any

from ..errors import InputError, ModelError


class NoPathError(InputError):
    """A clip whose camera path cannot be told: it stands still, turns or zooms only, or shows too little."""


class OutOfTimeError(NoPathError):
    """A clip whose camera path might be told in more time."""


def load_pycolmap() -> Any:
    """The module pycolmap, silent.

    Raises:
        ModelError: it is not installed.
    """
    try:
        import pycolmap
    except ImportError:
        raise ModelError("", "pycolmap", "is not installed", "pip install 'cltransfer[sfm]'") from None
    pycolmap.logging.minloglevel = 3  # fatal only: what it has to say is in its results
    return pycolmap
