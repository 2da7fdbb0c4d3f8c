"""Metric-only evaluation: two clips, no scene. The losses are the metrics."""

from __future__ import annotations

import os
import time

from torch import Tensor

from .along_clip import places
from .clips.kept_clip import kept_clip
from .clips.pairs import open_pairs
from .clips.source import ClipSource
from .clips.taught import taught_notes
from .computer.threads import default_count, set_threads, threads_restored
from .config.options import RunConfig
from .errors import InputError
from .features import Features, nobody
from .losses.camera_movement import weight_note
from .pipeline.components import Components
from .pipeline.scores import Scores, score
from .progress import Progress, silent
from .reading.frames import check_maps, read_alike, read_frames, require_person
from .reading.in_time import in_other_steps, in_time, own_steps
from .reading.noise import noise_floor, noise_note
from .reading.scene_source import split_scene
from .reading.tracks import cleaned
from .registry.declared import BUILTIN
from .report.data import Flag, ReportData

OWN_STEPS = "compares two frames of each side, whose steps are not equally long: give both one frame rate"
CLIPS = "expected clips, image folders or folders of runs"


@threads_restored()
def evaluate(
    reference: str | os.PathLike[str], rendered: str | os.PathLike[str], config: RunConfig, progress: Progress = silent
) -> ReportData:
    """Score the clip ``rendered`` against the clip ``reference``.

    Frames are paired by time, each of the reference with one of the render at most. Both are read by the same image
    extractors, and by one rule: what only one side has (depth from its movement, say) helps neither to read the rest.
    Flow goes from one pair to the next; the render's is taken in the time that passes in the reference.

    Args:
        reference: a video, an image folder or the folder of a run, which has kept its frames; or a part of one, as in
            ``clip.mp4#t=1.5,4`` (:meth:`cltransfer.clips.source.ClipSource.parse`).
        rendered: as the reference, and starts when it does.
        config: which losses and extractors; ``frames`` thins the pairs, evenly by time. Meanwhile the threads of the
            whole process are as it says.
        progress: called with a step, frames done, frames in all.

    Returns:
        What the report shows: ``scores`` with the raw terms of each pair, their weighted totals and coverage, ``flags``
        and times.

    Raises:
        UsageError: the config or the part of a clip cannot be meant.
        InputError: a clip is missing, damaged or of an unfinished run, the reference has a cut or shows no person, or
            the two do not overlap in time.
        ModelError: a network or plugin is missing or fails.
        ResourceError: there is not memory enough for the frames of both, or to read them.
    """
    set_threads(config.threads or default_count())
    start = time.perf_counter()
    reference, rendered = os.fspath(reference), os.fspath(rendered)
    for source in (reference, rendered):
        if source.startswith(BUILTIN):
            raise InputError(source, "", "is made by code, no clip", CLIPS)
        if split_scene(source) is not None:
            hint = f"{CLIPS}; `describe` and `transfer` take a scene"
            raise InputError(source, "", "is a scene with a trajectory, no clip", hint)
    parts = Components.build(config)
    plan = parts.plan("image")
    asked, found = ClipSource.parse(reference), ClipSource.parse(rendered)
    title = f"{found.path.name} against {asked.path.name}"
    asked, found = kept_clip(asked), kept_clip(found)
    both, flags, drawn = open_pairs(asked, found, config.frames)
    drawn = (*taught_notes(found, asked), *drawn)
    plan.load_networks()
    taught, made, times = both.reference.image, both.render.image, both.shown
    check_maps(taught, made)
    whom, who = asked.who(both.original, both.reference.size), found.who(times, both.render.size)
    features, read = read_frames(taught, plan, whom, progress, both.original, asked.path)
    require_person(reference, features)
    steps = both.original.diff(), times.diff()
    shown, seen = read_frames(made, in_time(plan, *steps), who, progress, times, found.path)
    alike = (
        read_alike(features, taught, plan, shown, progress),
        read_alike(shown, made, in_time(plan, *steps), features, progress),
    )
    again = (alike[0] is not features) + (alike[1] is not shown)
    lasts = all(side.lasts for side in (features, shown, *alike))  # what one side lacks hides it from the other
    features, shown = alike
    objective = parts.objective
    scores = score(objective, features, shown, plan.missing)
    passes = len(times) * (2 * plan.clip_passes + again * plan.person_known.passes)
    steady = cleaned(features, config.clean, places(both.original), both.original)
    noise = noise_floor(objective, features, steady, both.original)
    seconds = time.perf_counter() - start
    spent = {"network_passes": passes, "noise floor": round(noise, 4), "seconds": round(seconds, 2)}
    notes = [*(f"reference: {flag}" for flag in (*flags, *read)), *(f"render: {flag}" for flag in (*drawn, *seen))]
    notes += plan.notes
    notes.append(noise_note(noise))
    notes += undefined(scores, objective.defined(features), features, shown)
    if own := own_steps(plan, objective.losses) if in_other_steps(*steps) else []:
        notes.append(f"{', '.join(own)}: {OWN_STEPS}")
    notes.append(weight_note(objective.losses, features.size[0]))
    told = tuple(Flag(None, note) for note in notes if note)
    return ReportData(title, both.original, scores, None, None, None, taught, made, told, spent, lasts=lasts)


def undefined(scores: Scores, defined: Tensor, reference: Features, rendered: Features) -> list[str]:
    """Notes on terms without a value and on what the render has lost; the reference has ``defined`` (N, L) bool."""
    count = len(scores.totals)
    names: dict[str, list[str]] = {}
    for term in scores.terms:
        names.setdefault(term.reason, []).append(term.name)
    notes = [f"{', '.join(terms)}: {reason}" for reason, terms in names.items() if reason]
    unseen, gone = nobody(reference), nobody(rendered)
    if bool(unseen.any()):
        notes.append(f"reference: no person in {int(unseen.sum())} of {count} frames")
    lost = {term.name: defined[:, i] & ~term.values.isfinite() for i, term in enumerate(scores.terms)}
    if not any(bool(frames.any()) for frames in lost.values()):
        return notes
    parts = [f"no person in {int(gone.sum())} of {count} frames"] * bool(gone.any())
    for name in names.get("", []):
        if others := int((lost[name] & ~gone).sum()):
            parts.append(f"{name} undefined in {others}{' more' * bool(gone.any())} of {count} frames")
    return [*notes, f"render: {'; '.join([*parts, 'each missing term costs its penalty in the total'])}"]
