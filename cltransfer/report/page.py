"""One page about one run, complete in itself: no script, no link, nothing fetched."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup
from torch import Tensor

from ..storage.files import write_text
from ..storage.run_files import REPORT
from .data import ReportData
from .figures import lens_curves, term_curves, top_view
from .metrics import compared, head, number, rows, sums
from .picture import encoded
from .strip import evenly, thumbnail
from .template import rendered

_COLUMNS = 8
_QUALITY = 82  # of JPEG


@dataclass(frozen=True)
class Pair:
    """One column of the strip: the time [s] and both frames as data URIs; the reference may have no pixels."""

    time: str
    reference: str | None
    render: str


def write_report(run: Path, report: ReportData) -> Path:
    """Write ``report.html`` into ``run``, whole or not at all, and return its path."""
    write_text(run / REPORT, page(report))
    return run / REPORT


def page(report: ReportData) -> str:
    """The page as HTML."""
    found = rows(report)
    # Markup: our own SVG, in which the writer has escaped every text
    charts = {"terms": Markup(term_curves(report))}
    if report.trajectory is not None:
        charts["lens"] = Markup(lens_curves(report.trajectory, report.subject))
        if report.subject is not None:
            charts["top"] = Markup(top_view(report.trajectory, report.subject))
    return rendered(
        Path(__file__).with_name("page.html"),
        report=report,
        head=head(report),
        rows=found,
        sums=sums(report),
        compared=compared(report),
        total=found[-1],
        charts=charts,
        pairs=_pairs(report),
        number=number,
        duration=f"{float(report.times[-1] - report.times[0]):.2f}",
    )


def _pairs(report: ReportData) -> list[Pair]:
    """Up to eight frames spread evenly over the clip."""
    return [
        Pair(
            f"{float(report.times[i]):.2f} s",
            None if report.reference_frames is None else _data_uri(report.reference_frames[i]),
            _data_uri(report.render_frames[i]),
        )
        for i in evenly(len(report.times), _COLUMNS)
    ]


def _data_uri(frame: Tensor) -> str:
    """A frame (3, H, W) uint8 as a small JPEG data URI.

    Raises:
        ValueError: the encoder refused it.
    """
    coded = encoded(thumbnail(frame), ".jpg", _QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(coded).decode()
