"""Metric-only evaluation: two clips, no scene. The losses are the metrics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from .clip import Clip, pair_by_time, read_clip
from .config import RunConfig
from .errors import InputError
from .features import Features
from .graph import Plan
from .objective import Objective
from .reference import Components, Progress, clip_features, silent


@dataclass(frozen=True)
class Score:
    """Terms of N paired frames.

    Args:
        names: of the L terms.
        terms: raw, (N, L); NaN where undefined.
        defined: which the reference has, (N, L) bool.
        totals: weighted, (N,) (Eq. 15).
        missing: why a term has no value on any frame, by term.
    """

    names: tuple[str, ...]
    terms: Tensor  # (N, L)
    defined: Tensor  # (N, L)
    totals: Tensor  # (N,)
    missing: dict[str, str]

    def mean(self, name: str) -> float | None:
        """Mean raw value over the frames where it is defined; None where there is none."""
        values = self.terms[:, self.names.index(name)]
        values = values[torch.isfinite(values)]
        return float(values.mean()) if len(values) else None

    def coverage(self, name: str) -> tuple[int, int]:
        """Frames with a value, and frames in all."""
        values = self.terms[:, self.names.index(name)]
        return int(torch.isfinite(values).sum()), len(values)


def score(objective: Objective, plan: Plan, reference: Features, rendered: Features) -> Score:
    """Score N rendered frames against N reference frames that were read by ``plan``."""
    terms = objective.terms(reference, rendered)
    defined = objective.defined(reference)
    reasons = {}
    for name, loss in objective.losses.items():
        lacking = [n for n in loss.requires if not reference.has(n)]
        if lacking:
            reasons[name] = plan.missing.get(lacking[0], f"the reference has no {lacking[0]!r}")
        elif not bool(defined[:, objective.names.index(name)].any()):
            reasons[name] = "undefined on every frame of the reference"
    return Score(objective.names, terms, defined, objective.totals(terms, defined), reasons)


def evaluate(reference: str, render: str, config: RunConfig, progress: Progress = silent) -> tuple[Score, Tensor]:
    """Score the clip ``render`` against the clip ``reference``; returns the score and the times of its frames.

    Frames are paired by time: each frame of the render with the nearest of the reference. Both are read by the same
    image extractors.

    Raises:
        InputError: a clip is missing, damaged, or the two do not overlap in time.
    """
    parts = Components(config.build_one("renderer"), config.build("extractors"), config.build("losses"))
    plan = parts.plan("image")
    shown = read_clip(Path(render), config.frames)
    original = read_clip(Path(reference), None)
    paired = original.image[_pairs(original, shown)]
    features = clip_features(paired, plan, progress)
    if features.has("keypoints") and not bool(torch.isfinite(features.require("keypoints")).any()):
        raise InputError(reference, "person", f"none found in {len(paired)} frames")
    rendered = clip_features(shown.image, plan, progress)
    return score(Objective(parts.losses), plan, features, rendered), shown.times


def _pairs(original: Clip, shown: Clip) -> list[int]:
    index: list[int] = pair_by_time(original.times, shown.times).tolist()
    return index
