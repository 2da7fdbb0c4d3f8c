"""The page of a clip's reading: a contact sheet of overlays, and what each term is made of."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, StrictUndefined

from ..files import write_text

if TYPE_CHECKING:
    from ..inspect_clip import Inspection


def write_page(folder: Path, shown: Inspection) -> Path:
    """Write ``index.html`` beside the folder ``frames``, and return its path."""
    reference = shown.reference
    frames = [
        {"name": f"{i:04d}", "caption": caption, "doubtful": float(shown.confidence[i]) < 0.5}
        for i, caption in enumerate(shown.captions())
    ]
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string(Path(__file__).with_name("inspection.html").read_text(encoding="utf-8"))
    page = template.render(
        name=reference.name,
        count=len(reference),
        seen=shown.seen,
        seconds=f"{shown.seconds:.1f}",
        terms=shown.scores.terms,
        flags=reference.flags,
        frames=frames,
        flow=reference.features.has("flow"),
    )
    write_text(folder / "index.html", page)
    return folder / "index.html"
