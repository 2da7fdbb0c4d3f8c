"""A scene is searched without its floaters; its result shows them, and says where they matter. What is tried counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from cltransfer.bench.stress.case import Case
from cltransfer.bench.stress.scenery import floaters
from cltransfer.config import load_config
from cltransfer.driver.aside import FEW
from cltransfer.driver.frame import Solved
from cltransfer.driver.stage import Stage
from cltransfer.driver.starts import NoViewError, Starts
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.errors import InputError
from cltransfer.features import Features
from cltransfer.pipeline.scores import Scores
from cltransfer.progress import silent
from cltransfer.run import search_path as searches
from cltransfer.run.flags import run_flags
from cltransfer.run.left_out import LeftOut
from cltransfer.run.preparation import Clock, Job, prepare
from cltransfer.run.search_path import _all_told, _aside, _left_out, _past_steps, _with_floaters, search_path
from cltransfer.run.take import Take, searched
from cltransfer.scenes.floaters import without_floaters
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import load_person, save_labels
from cltransfer.scenes.ply import write_splats
from cltransfer.transfer import Inputs, Result, transfer

TINY = ["preset=fast", "frames=2", "search_side=48", "output_side=96"]


def solved(inputs: Inputs) -> Result:
    return transfer(inputs, load_config(overrides=TINY))


@pytest.fixture(scope="module")
def clean() -> Result:
    """A push in into the plaza, of which only leaves float."""
    return solved(Inputs("builtin:plaza", "builtin:push_in"))


def with_blobs(folder: Path, stage: str, count: int, seed: int, reference: str) -> Inputs:
    """A scene with ``count`` large blobs in the air about the person."""
    bare = load_scene(stage)
    assert bare.subject is not None
    scene = floaters(Case(None, None, bare, None), count, np.random.default_rng(seed)).scene  # type: ignore[arg-type]
    write_splats(folder / "scene.ply", scene.geometry)
    bare.subject.save(folder / "subject.json")
    save_labels(folder, scene.geometry.label)
    x, y, z = bare.up.tolist()
    return Inputs(str(folder / "scene.ply"), reference, subject=folder / "subject.json", up=(x, y, z))


@pytest.fixture(scope="module")
def hanging(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    """The same push in with blobs that hide the person."""
    return with_blobs(tmp_path_factory.mktemp("hung"), "builtin:plaza", 150, 1, "builtin:push_in")


@pytest.fixture(scope="module")
def hung(hanging: Inputs) -> Result:
    return solved(hanging)


def test_what_hangs_in_the_air_moves_no_camera(clean: Result, hung: Result) -> None:
    torch.testing.assert_close(hung.trajectory.camera.w2c, clean.trajectory.camera.w2c, rtol=0, atol=1e-5)
    torch.testing.assert_close(hung.trajectory.camera.K, clean.trajectory.camera.K, rtol=1e-5, atol=0)


def test_a_result_is_of_the_scene_as_it_was_given(clean: Result, hung: Result) -> None:
    left_out = hung.kept.left_out
    assert left_out is not None
    assert hung.floaters > 300
    assert len(hung.scene.geometry) == len(clean.scene.geometry) + 150
    assert hung.searched.total == pytest.approx(left_out.among)
    assert left_out.alone < 0.1 < 1 < left_out.among
    assert hung.verified.total > 1 > 0.2 > clean.verified.total
    assert not torch.equal(hung.image, clean.image)


def test_floaters_that_spoil_a_result_are_told(clean: Result, hung: Result) -> None:
    told, why = [flag.reason for flag in run_flags(hung) if flag.frame is None]
    hanging = f"Gaussians that hang in the air by themselves: {hung.floaters}"
    assert told == f"{hanging}, left out of the search (floaters=keep would search with them)"
    assert why.startswith("they spoil the result, the total is ")
    assert why.endswith(" without: `cltransfer simplify SCENE --out clean.ply k=0 floaters=drop` removes them")
    (told,) = [flag.reason for flag in run_flags(clean)]
    assert "left out of the search" in told


def test_what_floaters_cost_is_told_on_the_scale_of_the_score(hung: Result) -> None:
    """A search takes the mean over all frames, a score over those that have a term: here one of two."""
    totals = torch.tensor([torch.nan, 1.0])
    terms = tuple(replace(term, values=torch.ones(2)) for term in hung.searched.terms)
    _, why = [flag.reason for flag in run_flags(replace(hung, searched=Scores(terms, totals))) if flag.frame is None]
    left_out = hung.kept.left_out
    assert left_out is not None
    assert f"the total is {2 * left_out.among:.3g} for {2 * left_out.alone:.3g} without" in why


def test_frames_as_they_were_found_are_measured_alike_with_floaters_and_without() -> None:
    found = transfer(
        Inputs("builtin:plaza", "builtin:push_in"),
        load_config(overrides=[*TINY[:1], "frames=4", *TINY[2:], "path=exact"]),
    )
    left_out = found.kept.left_out
    assert left_out is not None
    assert left_out.among == pytest.approx(found.searched.total)
    assert left_out.alone == pytest.approx(left_out.among, rel=0.1)  # the leaves of the plaza are far from the person


def test_the_person_of_a_run_is_that_of_the_scene(clean: Result, tmp_path: Path) -> None:
    assert clean.scene.subject is not None
    clean.scene.subject.save(tmp_path / "subject.json")
    save_labels(tmp_path, clean.scene.geometry.label)
    scene = load_scene("builtin:plaza")
    assert len(without_floaters(scene).geometry) < len(scene.geometry)
    assert torch.equal(load_person(scene, tmp_path / "subject.json").geometry.label, clean.scene.geometry.label)


@pytest.mark.parametrize(
    ("alone", "among", "matters"), [(0.05, 0.16, False), (0.05, 0.17, True), (1.0, 1.43, False), (1.0, 1.44, True)]
)
def test_what_counts_as_far_worse(alone: float, among: float, matters: bool) -> None:
    assert LeftOut(alone, among).matters == matters


@pytest.mark.parametrize(
    ("alone", "among", "better"),
    [
        (0.5, 0.8, True),
        (0.4, 0.9, True),
        (0.5, 1.0, False),
        (0.7, 0.85, False),
        (0.1, 1.05, False),
        (0.7, 0.7, True),
        (0.9, 0.1, True),
        (0.95, 0.1, False),
    ],
)
def test_a_path_past_floaters_gains_more_than_it_loses_and_is_no_path_for_them_alone(
    alone: float, among: float, better: bool
) -> None:
    assert LeftOut(alone, among).better(LeftOut(0.5, 1.0)) == better


def quiet(frame: int, solved: Solved) -> None:
    """Hears how far a search is."""


@pytest.mark.parametrize(
    ("poor", "all_of_them"), [((1, 0, 1), True), ((1, 1, 1), True), ((0, 1, 1), False), ((0, 0, 0), False)]
)
def test_a_frame_whose_reference_tells_nothing_does_not_keep_a_path_where_it_stands(
    poor: tuple[int, ...], all_of_them: bool
) -> None:
    clip: Any = SimpleNamespace(placed=torch.tensor([True, False, True]))
    assert _all_told(clip, torch.tensor(poor, dtype=torch.bool)) == all_of_them


def found_without_floaters(hanging: Inputs) -> tuple[Job, Take]:
    """What is found in the scene without its floaters, which hide the person from there in every frame."""
    config = load_config(overrides=TINY)
    job = prepare(hanging, config, Clock(), silent, None)
    take = searched(job, replace(job.stage, scene=job.solid), job.wanted, job.starts, quiet)
    assert take.path is not None
    return job, take


def cost(job: Job, step: Callable[[], Any]) -> tuple[int, Any]:
    """Evaluations that are counted while ``step`` is done, and what it finds."""
    before = job.stage.spent.evaluations
    found = step()
    return job.stage.spent.evaluations - before, found


def test_a_path_that_is_tried_past_floaters_is_counted_wherever_it_is_scored(hanging: Inputs) -> None:
    job, take = found_without_floaters(hanging)
    job = replace(job, config=replace(job.config, joint=0))  # nothing is refined
    left_out, frames = _left_out(job, take), len(take.x)
    assert take.path is not None
    assert take.path.residuals is not None  # so the path itself is not scored again
    tried, (kept, _) = cost(job, lambda: _aside(job, take, left_out))
    assert kept is take  # another was tried, and not taken
    ways = len(job.search.aside) * len(range(0, frames, FEW.every))
    scored = ["what is chosen of all ways", "the same without floaters"]
    assert tried == ways + len(scored) * frames


def test_a_path_that_floaters_make_dearer_is_refined_among_them(tmp_path: Path) -> None:
    """A dolly zoom that no way aside makes cheaper."""
    inputs = with_blobs(tmp_path, "builtin:courtyard", 30, 2, "builtin:dolly_zoom")
    config = load_config(overrides=["preset=fast", "frames=6", "search_side=64", "output_side=96", "threads=1"])
    job = prepare(inputs, config, Clock(), silent, None)
    take = searched(job, replace(job.stage, scene=job.solid), job.wanted, job.starts, quiet)
    left_out = _left_out(job, take)
    assert _aside(replace(job, config=replace(config, joint=0)), take, left_out)[0] is take
    moved, there = _aside(job, take, left_out)
    assert there.among < 0.9 * left_out.among  # measured 0.80
    assert (there.alone, there.among) == pytest.approx((moved.total, moved.total_in(job.stage)), abs=1e-6)
    assert moved.path is not None
    assert (moved.path.refined, moved.path.aside) == (True, False)


@pytest.mark.parametrize(("count", "other"), [(30, True), (0, False)], ids=["refined among them", "there are none"])
def test_what_floaters_cost_is_counted_where_another_path_is_kept(tmp_path: Path, count: int, other: bool) -> None:
    """That of the path that is kept is its score."""
    inputs = with_blobs(tmp_path, "builtin:courtyard", count, 2, "builtin:dolly_zoom")
    least = ["preset=fast", "frames=6", "search_side=64", "output_side=96", "threads=1", "joint=2", "joint_steps=4"]
    config = load_config(overrides=least)
    job = prepare(inputs, config, Clock(), silent, None)
    solid = replace(job.stage, scene=job.solid)
    search, take = cost(job, lambda: searched(job, solid, job.wanted, job.starts, quiet))
    beside, kept = cost(job, lambda: _with_floaters(job, take, quiet))
    assert (kept.path is not take.path) is other
    whole, _ = cost(job, lambda: search_path(job, solid, job.wanted, job.starts, quiet))
    assert whole - search - beside == (len(take.x) if other else 0)


def test_frames_far_above_the_others_go_aside_where_there_are_no_floaters_too(monkeypatch: pytest.MonkeyPatch) -> None:
    least = ["preset=fast", "frames=8", "search_side=64", "output_side=96", "threads=1"]
    config = load_config(overrides=[*least, "joint=2", "floaters=keep", "losses.camera_angle.weight=20"])
    job = prepare(Inputs("builtin:plaza", "builtin:orbit"), config, Clock(), silent, None)
    take = searched(job, job.stage, job.wanted, job.starts, quiet)
    assert take.path is not None
    assert _past_steps(job, take) is take
    x, clip = take.path.x.clone(), take.clip
    x[5:, 0] += 0.15  # azimuth, as far as a way leads: a frame at 3
    off = clip.residuals(x)
    away = replace(take, path=replace(take.path, x=x, residuals=off, total=clip.mean_total(off)))
    scored: list[bytes] = []
    residuals = WholeClip.residuals

    def heard(clip: WholeClip, x: torch.Tensor) -> torch.Tensor:
        scored.append(x.numpy().tobytes())
        return residuals(clip, x)

    monkeypatch.setattr(WholeClip, "residuals", heard)
    found = _past_steps(job, away)
    assert len(set(scored)) == len(scored)
    assert found.path is not None
    assert found.path.aside
    assert found.left_out is None
    assert found.total < 0.5 * away.total
    assert found.total == pytest.approx(clip.total(found.x), abs=1e-6)
    assert _past_steps(replace(job, config=replace(config, joint=1)), away) is away


def test_a_path_that_is_searched_among_floaters_is_counted_without_them_too(hanging: Inputs) -> None:
    job, take = found_without_floaters(hanging)
    left_out, target = _left_out(job, take), take.clip.reference
    assert left_out.matters
    past, _ = cost(job, lambda: _aside(job, take, left_out))
    search, _ = cost(
        job,
        lambda: searched(job, job.stage, target, job.starting.starts(job.stage, target), quiet),
    )
    whole, _ = cost(job, lambda: _with_floaters(job, take, quiet))
    assert whole == past + search + len(take.x)


@pytest.mark.parametrize("error", [NoViewError, InputError])
def test_where_no_view_among_floaters_shows_anything_what_was_found_without_is_kept(
    hanging: Inputs, error: type[InputError]
) -> None:
    """And another error is one, as that of a journal of another run."""
    job, take = found_without_floaters(hanging)

    class Lost:
        def starts(self, stage: Stage, target: Features) -> Starts:
            raise error("", "--init", "no view")

    lost: Any = replace(job, starting=Lost())  # type: ignore[arg-type]
    if error is NoViewError:
        kept = _with_floaters(lost, take, quiet)
        assert kept.found is take.found
        assert kept.left_out is not None
    else:
        with pytest.raises(InputError, match="no view"):
            _with_floaters(lost, take, quiet)


@dataclass(frozen=True)
class Priced:
    """A take of which only what it costs is known, without floaters and among them."""

    alone: float
    among: float
    path: Any = None
    left_out: LeftOut | None = None
    given: bool = False  # whether it was searched in the scene as it was given
    x: Any = None

    @property
    def clip(self) -> Any:
        return SimpleNamespace(stage=SimpleNamespace(given=self.given), reference=None)

    @property
    def total(self) -> float:
        return self.total_in(self.clip.stage)

    def total_in(self, stage: Any) -> float:
        return self.among if stage.given else self.alone


def kept_of(first: Priced, aside: LeftOut, second: Priced, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What is kept of a path that costs so much once it went ``aside``, and what a search among floaters finds."""
    monkeypatch.setattr(searches, "_aside", lambda job, take, before: (take, aside))
    monkeypatch.setattr(searches, "searched", lambda *told: second)
    monkeypatch.setattr(searches, "views", lambda x: 1)
    stage = SimpleNamespace(given=True, spent=SimpleNamespace(evaluations=0))
    starting: Any = SimpleNamespace(starts=lambda stage, target: None)
    job: Any = SimpleNamespace(stage=stage, starting=starting)
    take: Any = first
    return _with_floaters(job, take, quiet)


@pytest.mark.parametrize(
    ("alone", "among", "taken"),
    [(0.4, 0.95, True), (0.7, 0.4, True), (0.95, 0.1, False), (0.4, 1.05, False)],
    ids=["better", "gains more among them than it loses", "good among them alone", "worse among them"],
)
def test_a_path_that_was_searched_among_floaters_is_taken_where_it_gains_by_it(
    alone: float, among: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second, left_out = Priced(0.5, 1.0), Priced(alone, among, given=True), LeftOut(0.5, 1.0)
    assert kept_of(first, left_out, second, monkeypatch) == (second if taken else replace(first, left_out=left_out))


@pytest.mark.parametrize("steady", [True, False])
def test_where_a_path_lost_much_as_a_whole_floaters_are_judged_by_what_it_cost_before(
    steady: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = Priced(0.05, 0.6, SimpleNamespace(steady=steady)), Priced(0.05, 0.1, given=True)
    gone = LeftOut(0.5, 0.55)
    assert kept_of(first, gone, second, monkeypatch) == (second if steady else replace(first, left_out=gone))
