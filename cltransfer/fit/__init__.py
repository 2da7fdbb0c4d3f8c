"""Fitting a scene to posed images. One module per representation; its name is the file's name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from ..progress import Progress
    from ._curve import Level
    from ._views import Views


class Fitter(Protocol):
    """What ``cltransfer fit`` needs of a fitter; a frozen dataclass whose fields are its options."""

    side: int
    """Of the images, the longer one at most [px]."""

    def require(self) -> None:
        """Look, before anything is read, whether the computer has what this fitter needs.

        Raises:
            ModelError: the line says what is missing.
        """
        ...

    def fit(self, views: Views, folder: Path, progress: Progress) -> list[Level]:
        """Fit a scene, leave it in ``folder``, which is there, and return what each level of detail reached.

        Raises:
            UsageError: the folder holds a fit with other options or views, or something else.
        """
        ...
