"""What the header of an image file says of how it is shown."""

from __future__ import annotations

import contextlib
import io
import logging
import struct
import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_ORIENTATION = 0x0112  # of EXIF

_log = logging.getLogger("cltransfer")


def exif_orientation(path: Path) -> int:
    """Orientation that the EXIF of an image file states; 1, as stored, where it states none or cannot be read."""
    from PIL import Image

    exif = Image.Exif()
    with _unread(), Image.open(path, formats=("JPEG", "PNG")) as image:
        exif.load(image.info.get("exif", b""))
        stated = exif.get(_ORIENTATION, 1)
        if isinstance(stated, int) or stated in range(1, 9):
            return int(stated)
    _tell_unread(path.parent)
    return 1


def states_aspect(path: Path) -> bool:
    """Whether an image file states the shape of its pixels, and not how many of them go to an inch of paper."""
    from PIL import Image

    with _unread(), Image.open(path, formats=("JPEG", "PNG")) as image:
        return "aspect" in image.info or image.info.get("jfif_unit") == 0
    return False


def stored_size(data: bytes) -> tuple[int, int] | None:
    """(W, H) [px] that the header of an image file states; None where it cannot be read."""
    from PIL.JpegImagePlugin import JpegImageFile
    from PIL.PngImagePlugin import PngImageFile

    kind = JpegImageFile if data.startswith(b"\xff\xd8") else PngImageFile
    with _unread(), kind(io.BytesIO(data)) as image:  # Image.open tells of a huge one no size
        return image.size
    return None


@contextlib.contextmanager
def _unread() -> Iterator[None]:
    """What Pillow cannot read ends the block, no more, and Pillow does not warn of it."""
    from PIL import Image

    unread = (OSError, ValueError, TypeError, SyntaxError, struct.error, Image.DecompressionBombError)
    with warnings.catch_warnings(), contextlib.suppress(*unread):
        # what matters is told once a folder; a thread may leave this filter behind, so it is of Pillow alone
        warnings.filterwarnings("ignore", category=UserWarning, module=r"PIL\.")
        yield


@cache
def _tell_unread(folder: Path) -> None:
    """Tell of an image that is shown as any viewer shows it; once a folder, which may hold a thousand of them."""
    _log.warning("%s: EXIF that cannot be read in an image: it is shown as it is stored, and so are others", folder)
