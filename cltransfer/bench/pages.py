"""Pages of figures: which section a verb rewrites, between which marks, and whether it can."""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from ..storage.files import check_out_file, read_text

PAGE_LIMIT = 2**24  # bytes
SECTIONS = {  # of a page, by verb
    "speed": "Splat rendering",
    "cuda": "Splats on a GPU",
    "mesh": "Mesh rendering",
    "grid": "Voxel grid rendering",
    "lod": "Level of detail",
    "flow": "Optical flow",
    "describe": "Description",
    "driver": "The driver",
    "pool": "Runs together",
    "stress": "Stress",
    "table1": "Table 1",
    "chart": "Speed against accuracy",
}


def markers(title: str) -> tuple[str, str]:
    """The comments that a section stands between.

    >>> markers("Mesh rendering")
    ('<!-- mesh rendering: begin -->', '<!-- mesh rendering: end -->')
    """
    return f"<!-- {title.lower()}: begin -->", f"<!-- {title.lower()}: end -->"


def check_page(path: Path, title: str) -> None:
    """Refuse a page that the section ``title`` cannot be written into.

    Raises:
        UsageError: it is a folder, a device or a pipe.
        InputError: it is no text, or the section's markers are damaged.
    """
    check_out_file(path)
    page_text(path, title)


def page_text(path: Path, title: str) -> str:
    """The page as it is, a heading where there is none.

    Raises:
        InputError: it is no text, or only one of the markers of ``title`` stands in it, or the end before the begin.
    """
    begin, end = markers(title)
    text = read_text(path, PAGE_LIMIT) if path.exists() else "# Benchmarks\n"
    between = text.partition(begin)[2]
    if (begin in text or end in text) and end not in between:
        raise InputError(path, title, f"expected {begin!r}, then {end!r}", "mend or remove these two lines")
    return text
