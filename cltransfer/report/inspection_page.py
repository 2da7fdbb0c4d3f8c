"""The page of a clip's reading: a contact sheet of overlays, and what each term is made of."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from ..clips.source import unnamed
from ..reading.scene_source import is_scene
from ..storage.files import write_text
from ..storage.pages import INDEX
from .policy import csp_hash
from .template import rendered

if TYPE_CHECKING:
    from ..inspect_clip import Inspection


MARK = "cltransfer inspect"


def write_page(folder: Path, shown: Inspection) -> Path:
    """Write ``index.html`` beside the folder ``frames``, and return its path."""
    reference = shown.reference
    frames = [
        {"name": f"{i:04d}", "time": f"{moment:.3f}", "caption": caption, "doubtful": float(shown.confidence[i]) < 0.5}
        for i, (caption, moment) in enumerate(zip(shown.captions(), reference.times.tolist()))
    ]
    script = Path(__file__).with_name("inspection.js").read_text("utf-8")
    file, rest = unnamed(shown.source)
    page = rendered(
        Path(__file__).with_name("inspection.html"),
        mark=MARK,
        name=reference.name,
        count=len(reference),
        seen=shown.seen,
        seconds=f"{shown.seconds:.1f}",
        terms=shown.scores.terms,
        flags=reference.flags,
        frames=frames,
        flow=reference.features.has("flow"),
        clickable=not is_scene(shown.source),
        clip=f"{file}#{rest}",
        example=shlex.quote(f"{file}#{rest}person=X,Y,SECONDS"),
        script=script,
        script_hash=csp_hash(script),
    )
    write_text(folder / INDEX, page)
    return folder / INDEX
