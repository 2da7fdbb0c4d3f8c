"""What rows come to: numbers a clip, with and without the frames that failed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean

from .judge import SIDE
from .trial import Row

PRINTED = {  # units of the terms as the paper prints them
    **{"shot_size": "frame", "framing": "frame", "filmic_space": "log ratio"},
    **{"camera_movement": f"px of {SIDE}", "camera_angle": "rad"},
}
BY_NETWORKS = ("shot_size", "framing", "camera_angle")
Measure = Callable[[Row], float]


def number(value: float | None) -> float:
    """A value of a row; what was undefined is NaN."""
    return math.nan if value is None else float(value)


def mean(values: Iterable[float | None]) -> float:
    """Mean of what is defined; NaN of nothing."""
    known = [v for v in map(number, values) if math.isfinite(v)]
    return fmean(known) if known else math.nan


def failed_frames(row: Row) -> frozenset[int]:
    """Frames that failed for any reason."""
    return frozenset(i for frames in row["failed"].values() for i in frames)


def term(row: Row, name: str, without: frozenset[int] = frozenset()) -> float:
    """Mean of a term over the frames that the reference defines; a render that lacks it pays the penalty."""
    return mean(v for i, v in enumerate(row["priced"][name]) if i not in without)


def faithful(name: str) -> Measure:
    """Mean of the term as the paper prints it, over the frames where both sides define it."""
    return lambda row: mean(row["faithful"][name])


def held_out(reading: str, name: str) -> Measure:
    """Mean of a term by extractors that no objective had, priced as :func:`term` is; NaN where it was not read."""
    return lambda row: mean(row["held_out"].get(reading, {}).get(name, ()))


def truth(name: str) -> Measure:
    """An error against the true cameras."""
    return lambda row: number(row["truth"][name])


# lower is better in all
SIDE_MEASURES: Mapping[str, tuple[str, Measure]] = {
    "total": ("1 is every term at its tolerance", lambda row: number(row["total"])),
    "failed clips": ("share", lambda row: float(row["failed_clip"])),
    "failed frames": ("share", lambda row: len(failed_frames(row)) / row["frames"]),
    "position error": ("subject heights", truth("position")),
    "rotation error": ("deg", truth("rotation")),
    "log focal error": ("log", truth("log_focal")),
    "path position error": ("subject heights", truth("path_position")),
    "path rotation error": ("deg", truth("path_rotation")),
    "jerk apart from the reference's": (
        "per frame cubed",
        lambda row: abs(number(row["jerk"]) - number(row["reference_jerk"])),
    ),
    "other shot scale": ("share of frames", lambda row: 1 - number(row["scale_agreement"])),
    **{f"{name}, as printed": (unit, faithful(name)) for name, unit in PRINTED.items()},
    "camera_movement by DIS flow": ("frame widths", held_out("dis_flow", "camera_movement")),
    **{f"{name} by networks": (PRINTED[name], held_out("networks", name)) for name in BY_NETWORKS},
    "evaluations a frame": ("", lambda row: number(row["evaluations"])),
    "seconds a clip": ("", lambda row: number(row["seconds"])),
}


def clip_of(row: Row) -> tuple[str, str, str, int, int]:
    """What rows of all methods are paired by."""
    return row["shot"], row["teacher"], row["pupil"], row["seed"], row["frames"]


def paired(rows: Sequence[Row], baseline: str, ours: str) -> list[tuple[Row, Row]]:
    """Rows of two methods, clip by clip, where both have run."""
    by = {name: {clip_of(row): row for row in rows if row["method"] == name} for name in (baseline, ours)}
    return [(row, by[ours][clip]) for clip, row in by[baseline].items() if clip in by[ours]]


def is_self(row: Row) -> bool:
    """Whether the scene was taught its own shot, in any form, so that the true cameras are known."""
    return bool(row["teacher"].split("-")[:2] == row["pupil"].split("-")[:2])
