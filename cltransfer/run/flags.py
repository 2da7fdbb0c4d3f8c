"""What a reader of a result should know: what failed or is doubtful, in which frame, and why."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import torch

from ..along_clip import places
from ..driver.refine import least_curvature
from ..driver.schedule import tells_lens
from ..export.lens import FULL_FRAME, millimetres
from ..features import nobody
from ..losses.camera_movement import weight_note
from ..losses.filmic_space import counted
from ..losses.shot_size import ShotSize, degenerate
from ..near_plane import cut_note
from ..reading.frames import hidden
from ..reading.noise import noise_note
from ..reading.tracks import leaps, turned_back
from ..reading.zoom import lens_range
from ..registry import SEARCHES
from ..report.data import Flag
from ..search import limits
from .lean import lean_note
from .scene_end import SCENE_ENDS

if TYPE_CHECKING:
    from .result import Result

DEGENERATE = 1.0  # least curvature of the total along a direction of x below which nothing determines it; usually > 10
ON_BOUND = 1e-6  # of the half-range
ZOOMS = 1.25  # times its shortest focal length, up to which a lens stands
SHOWN = 0.3  # log range of the reference's as its flow and depth tell it, below which it stands
FAR_OFF = 2.0  # of the total, ten tolerances of one term, above which no view is like the reference's
WORSE_THAN_HELD = 1.05  # times the total of the first view held still, above which a result is worse
OTHERWISE, MUCH_MORE = 3.0, 1.0  # times the search's total, and so much more, above which it is read otherwise


def run_flags(result: Result) -> tuple[Flag, ...]:
    """The flags of a transfer, those of the whole run first, then by frame."""
    flags = [*_of_the_run(result), *_reference(result), *_undefined(result), *_views(result), *_search(result)]
    return tuple(sorted(flags, key=lambda flag: -1 if flag.frame is None else flag.frame))


def _of_the_run(result: Result) -> Iterator[Flag]:
    for term in result.verified.terms:
        if term.reason:
            yield Flag(None, f"{term.name}: {term.reason}")
    for flag in result.reference.flags:
        yield Flag(None, f"reference: {flag}")
    if result.alignment is not None:
        yield Flag(None, f"depth network: {result.alignment}")
    weight = weight_note(result.objective.losses, result.reference.features.size[0])
    for note in (noise_note(result.noise), result.schedule.note, result.note, weight):
        if note:
            yield Flag(None, note)
    yield from _poor(result)
    yield from _far_off(result)
    if lean := lean_note(result.scene.subject, result.reference.features):
        yield Flag(None, lean)
    yield from _floaters(result)
    yield from _near(result)
    yield from _scene_end(result)
    yield from _lens(result)
    person = result.scene.subject
    if person is not None and hasattr(result.search, "unit_note") and (told := result.search.unit_note(person)):
        yield Flag(None, told)
    if person is not None and (person.people or 1) > 1:
        hint = "in a scan --subject 0, 1, ... takes each, `cltransfer lift SCENE --person 1` shows whom"
        yield Flag(None, f"{person.people} people in the scene, one is filmed: {hint}")
    if not result.schedule.free_lens:
        yield Flag(None, _kept_lens(result))


def _kept_lens(result: Result) -> str:
    """Which focal length was kept, what names another, and why none was searched."""
    camera, objective = result.trajectory.camera[0], result.objective
    spaces = [result.verified.term(name) for name in counted(objective.losses)]
    lens = f"{math.degrees(float(camera.vertical_fov)):.3g} degrees high, {float(millimetres(camera)):.3g} mm"
    why = ""
    if not any(space is not None and space.defined for space in spaces):
        why = ": without filmic space it cannot be told apart from distance"
    elif not tells_lens(objective, result.reference.features):
        why = ": with nothing before or behind the person in the reference it cannot be told apart from distance"
    return f"focal length kept at {lens} on a gate {FULL_FRAME:g} mm wide (--init VIEW.json names another){why}"


def _poor(result: Result) -> Iterator[Flag]:
    """Whether the result is worse than standing still, or than the search took it for."""
    total, held, searched = result.verified.total, result.held, result.searched.total
    if held is None:
        yield Flag(
            None,
            "not compared with the first view held still, which lacks what was read from movement, as depth may be",
        )
    elif total > WORSE_THAN_HELD * held.total:
        yield Flag(None, f"worse than the first view held still: the total is {total:.3g} for {held.total:.3g}")
    read = result.kept.shown.features
    gone = nobody(read) & ~nobody(result.reference.features) & (result.family == "image")
    if bool(gone.any()):
        frames = f"{int(gone.sum())} of {len(read)} frames"
        told = f"the networks see nobody in {frames} of the render, and each term that is missing costs its penalty"
        yield Flag(None, f"{told}: the total is {total:.3g}, for {searched:.3g} in the search")
    elif total > OTHERWISE * searched + MUCH_MORE:
        where = "as it is read back, " if result.family == "image" else ""
        told = f"the total is {total:.3g}, {where}for {searched:.3g} in the search, most of it {_most(result)}"
        yield Flag(None, f"{told}: the search and the reading do not see the same")


def _most(result: Result) -> str:
    """The term that costs most, penalties among it."""
    objective, values = result.objective, torch.stack([term.values for term in result.verified.terms], dim=1)
    weighted = objective.weighted(values, objective.defined(result.reference.features))
    return list(objective.losses)[int(weighted.sum(0).argmax())]


def _far_off(result: Result) -> Iterator[Flag]:
    """Which terms the search left far from the reference's, those that cost most first; not by floaters alone."""
    objective, left_out = result.objective, result.kept.left_out
    if left_out is not None and left_out.matters and left_out.alone <= FAR_OFF:
        return
    terms = [term for term in result.searched.terms if term.name in objective.losses]
    defined = objective.defined(result.reference.features)
    weighted = objective.weighted(torch.stack([term.values for term in terms], dim=1), defined)
    costs = weighted.sum(0) / defined.sum(0).clamp_min(1)
    far = [terms[i] for i in costs.argsort(descending=True).tolist() if costs[i] > FAR_OFF]
    off = [f"{t.name} undefined" if t.mean is None else f"{t.name} {t.mean:.3g} {t.unit} off" for t in far]
    if off:
        yield Flag(None, f"no view that was found is like the reference's, in the search's mean: {', '.join(off)}")


def _floaters(result: Result) -> Iterator[Flag]:
    if not result.floaters:
        return
    hanging, left_out = f"Gaussians that hang in the air by themselves: {result.floaters}", result.kept.left_out
    if left_out is None:
        yield Flag(None, f"{hanging}, searched with them: what is found without is far worse among them")
        return
    yield Flag(None, f"{hanging}, left out of the search (floaters=keep would search with them)")
    if left_out.matters:
        told = float(result.searched.totals.isfinite().double().mean())  # in a search the others count as 0
        totals = f"the total is {left_out.among / told:.3g} for {left_out.alone / told:.3g} without"
        removed = "`cltransfer simplify SCENE --out clean.ply k=0 floaters=drop` removes them"
        yield Flag(None, f"they spoil the result, {totals}: {removed}")


def _near(result: Result) -> Iterator[Flag]:
    person = result.scene.subject
    if person is not None and (note := cut_note(result.renderer, result.trajectory.camera, person.joints)):
        yield Flag(None, note)


def _scene_end(result: Result) -> Iterator[Flag]:
    """In how many frames the scene ends; of the whole run, as a scan of a person alone ends in each of its views."""
    ends = result.kept.doubtful.get(SCENE_ENDS)
    if ends is not None and bool(ends.any()):
        yield Flag(None, f"{SCENE_ENDS}, in {int(ends.sum())} of {len(ends)} frames")


def _lens(result: Result) -> Iterator[Flag]:
    """Whether the lens of the result goes where that of the reference stands."""
    focal, reference = result.trajectory.camera.focal, result.reference
    zoom = float(focal.max() / focal.min())
    if zoom <= ZOOMS:
        return
    if reference.zoom is None:
        by, stands = ", as its flow and depth tell,", lens_range(reference.features) < SHOWN
    else:
        by, stands = "", reference.zoom <= ZOOMS
    if stands:
        told = f"the lens zooms {zoom:.3g} times, which the reference{by} does not"
        still = result.kept.path is not None and getattr(result.search, "lens", None) is not None
        hint = "zoom=still keeps one focal length" if still else "zoom=fixed keeps that of the first frame"
        yield Flag(None, f"{told}: {hint}")


def _reference(result: Result) -> Iterator[Flag]:
    features, times = result.reference.features, result.reference.times
    if result.reference.family == "image":
        for i in leaps(turned_back(features, times), places(times), times):
            yield Flag(i, "the person's angle in the reference leaps away from that of the frames beside it: misread?")
    if not features.has("keypoints"):
        return
    unseen = nobody(features)
    if bool((unseen | hidden(features)).all()):
        yield Flag(None, "no frame of the reference shows the person: the result moves alike, and stands anywhere")
    for i in unseen.nonzero()[:, 0].tolist():
        yield Flag(i, "no person in the reference")
    loss = result.objective.losses.get("shot_size")
    if not isinstance(loss, ShotSize) or loss.mode != "robust" or any(not features.has(n) for n in loss.requires):
        return
    joints = "key joints" if loss.joints == "key" else "joints"
    told = torch.isfinite(loss(features, features))  # a sliver of a mask tells none
    for i in (degenerate(features, loss.joints) & ~unseen & told).nonzero()[:, 0].tolist():
        yield Flag(i, f"fewer than two {joints} in the reference: the size is that of the mask, and not certain")


def _undefined(result: Result) -> Iterator[Flag]:
    known = dict(zip(result.objective.losses, result.objective.defined(result.reference.features).T))
    for term in result.verified.terms:
        lost = ~torch.isfinite(term.values)
        if term.reason:
            lost &= known[term.name]  # of what the whole reference lacks a note tells once
        for i in lost.nonzero()[:, 0].tolist():
            if i > 0 or not result.objective.moves(result.objective.losses[term.name]):
                yield Flag(i, f"{term.name} undefined")


def _views(result: Result) -> Iterator[Flag]:
    for reason, frames in result.kept.doubtful.items():
        if reason == SCENE_ENDS:  # of the whole run
            continue
        for i in frames.nonzero()[:, 0].tolist():
            yield Flag(i, reason)


def _search(result: Result) -> Iterator[Flag]:
    x, search = result.kept.x, result.search
    for i in result.kept.cuts:
        yield Flag(i, "the camera jumps here and the reference's does not: what lies between costs far more")
    low, high = limits(search, x.shape[1])
    above = x >= high - ON_BOUND
    for i, d in ((x <= low + ON_BOUND) | above).nonzero().tolist():
        yield Flag(i, _bound(search, d, bool(above[i, d])))
    if hasattr(search, "limited"):
        for i in search.limited(x).nonzero()[:, 0].tolist():
            yield Flag(i, "focal length at its limit")
    path = result.kept.path
    local = result.kept.found.local or (None if path is None else path.local)
    if local is None or not getattr(search, "refinable", True):  # the length of a free axis never changes a camera
        return
    for i, (jacobian, residuals) in enumerate(zip(local.jacobian, local.residuals)):
        if least_curvature(jacobian, residuals, local.groups) < DEGENERATE:
            yield Flag(i, "degenerate: some change of the camera costs nothing, it is not determined")


def _bound(search: Any, d: int, above: bool) -> str:
    """Which parameter ended at its bound, and the option that sets it, where there is one."""
    if not hasattr(search, "names"):
        return f"x[{d}] at its bound"
    name, key = search.names[d], SEARCHES.name_of(search)
    options = getattr(search, "bounding", {}).get(name)
    if options is None or not key:
        return f"{name} at its bound"
    option = options[above]
    return f"{name} at its bound ({SEARCHES.section}.{key}.{option}={getattr(search, option):g})"
