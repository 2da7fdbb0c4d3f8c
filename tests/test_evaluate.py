"""Two clips scored: frames are paired by time, and what their times are taken to be is told."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import pytest
import torch
from torch import Tensor

from cltransfer.bench.synthetic_room import room_cameras
from cltransfer.clips.clip import write_video
from cltransfer.clips.image_folder import clip_hash
from cltransfer.clips.open_clip import ASSUMED
from cltransfer.clips.pairs import OWN_BARS, open_pairs
from cltransfer.clips.source import ClipSource
from cltransfer.config import load_config, to_yaml
from cltransfer.config.options import RunConfig
from cltransfer.driver.stage import Stage
from cltransfer.errors import InputError, ResourceError
from cltransfer.evaluate import evaluate, undefined
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.scores import score
from cltransfer.reading.frames import read_alike
from cltransfer.reading.reference import Reading, read_reference
from cltransfer.registry import EXTRACTORS, LOSSES
from cltransfer.report.metrics import metrics_json, number
from cltransfer.run.kept_reading import Read
from cltransfer.run.readback import read_back, read_held
from cltransfer.testing import sample_cameras, sample_features, without_person
from cltransfer.trajectory import Trajectory


def pan() -> Tensor:
    """Ten frames of a camera that pans ever faster over a blotchy wall."""
    coarse = torch.rand(1, 3, 9, 40, generator=torch.Generator().manual_seed(0))
    wall = torch.nn.functional.interpolate(coarse, (48, 200), mode="bilinear")[0]
    return torch.stack([wall[:, :, i * i : i * i + 64] for i in range(10)]).mul(255).byte()


def images(folder: Path, image: Tensor) -> Path:
    folder.mkdir()
    for i, rgb in enumerate(image):
        assert cv2.imwrite(str(folder / f"{i}.png"), rgb.permute(1, 2, 0).numpy()[..., ::-1])
    return folder


@pytest.fixture
def config(mean_flow: tuple[str, ...]) -> RunConfig:
    return load_config(overrides=mean_flow)


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """A video of 30 frames a second; what is exported of it lies in ``frames``."""
    write_video(tmp_path / "clip.mkv", pan(), torch.arange(10).double() / 30, lossless=True)
    images(tmp_path / "frames", pan())
    return tmp_path / "clip.mkv"


def test_threads_are_the_config_s_and_afterwards_the_caller_s(clip: Path, config: RunConfig) -> None:
    before, during = torch.get_num_threads(), set[int]()
    cv2.setNumThreads(3)
    evaluate(clip, clip, replace(config, threads=1), lambda step, done, of: during.add(cv2.getNumThreads()))
    assert (during, cv2.getNumThreads(), torch.get_num_threads()) == ({1}, 3, before)


def test_the_images_of_a_clip_at_its_rate_score_zero(clip: Path, config: RunConfig) -> None:
    folder = clip.with_name("frames")
    for first, second in ((str(clip), f"{folder}#fps=30"), (f"{folder}#fps=30", str(clip))):
        report = evaluate(first, second, config)
        assert report.scores.totals.isnan().tolist() == [True] + [False] * 9  # a first frame has no flow
        assert report.scores.totals[1:].tolist() == [0.0] * 9
        assert report.notes == ()


@pytest.mark.parametrize(("weight", "told"), [("40", ["64 times"]), ("0.625", [])])
def test_a_movement_in_pixels_that_is_weighed_as_if_in_frame_widths_is_told(
    clip: Path, weight: str, told: list[str]
) -> None:
    others = [f"losses.{name}=null" for name in load_config().losses if name != "camera_movement"]
    options = {"mode": "faithful", "layered": "false", "weight": weight}
    config = load_config(overrides=[*others, *(f"losses.camera_movement.{k}={v}" for k, v in options.items())])
    notes = evaluate(clip, clip, config).notes
    assert [note.removeprefix("camera_movement counts ").partition(" what")[0] for note in notes] == told


def test_images_whose_rate_nothing_says_are_told(clip: Path, config: RunConfig) -> None:
    folder = str(clip.with_name("frames"))
    report = evaluate(str(clip), folder, config)
    assert report.scores.total > 0  # 24 images a second are other moments
    assert f"render: {ASSUMED}" in report.notes
    assert f"reference: {ASSUMED}" in evaluate(folder, str(clip), config).notes


@pytest.mark.parametrize(("count", "rate", "told"), [(10, 30, True), (9, 30, False), (10, 24, False)])
def test_an_image_for_each_frame_of_the_reference_is_told_where_its_times_are_not_taken(
    tmp_path: Path, config: RunConfig, count: int, rate: int, told: bool
) -> None:
    write_video(tmp_path / "clip.mkv", pan(), torch.arange(10).double() / rate, lossless=True)
    folder = images(tmp_path / "frames", pan()[:count])
    few = replace(config, frames=3)
    notes = evaluate(str(tmp_path / "clip.mkv"), str(folder), few).notes
    wanted = "render: it has as many images as the reference has frames, 10: "
    assert [note.removeprefix(wanted) for note in notes if note.startswith(wanted)] == [
        "if its times are meant, name FOLDER#fps=30 or write a times.json"
    ] * told


def test_a_run_is_scored_by_the_frames_it_has_kept(
    command: Any, mean_flow: tuple[str, ...], clip: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    write_video(run / "video" / "frames.mkv", pan(), torch.arange(10).double() / 30, lossless=True)
    write_video(run / "video" / "render.mp4", pan() // 2, torch.arange(10).double() / 30)
    (run / "manifest.json").write_text('{"format": "cltransfer.run"}')
    pairs = ((clip, run), (run, clip), (f"{clip}#t=0,0.2", f"{run}#t=0,0.2"))
    for pair in pairs:
        killed = command("evaluate", *pair, *mean_flow, "--quiet")
        assert (killed.code, killed.err.count("\n")) == (3, 1)
        assert f"{run}: DONE: this run was not finished" in killed.err
    (run / "DONE").touch()
    for pair, title in zip(pairs, ("run against clip.mkv", "clip.mkv against run", "run against clip.mkv")):
        answer = command("evaluate", *pair, *mean_flow, "--quiet", "--json")
        assert answer.code == 0, answer.err
        said = json.loads(answer.out)
        assert (said["metrics"]["total"]["mean"], said["title"]) == (0, title)
    assert command("evaluate", clip, f"{run}#fps=30", *mean_flow, "--quiet").code == 2


def test_a_run_that_a_part_of_the_reference_taught_is_told_to_be_scored_against_other_moments(
    config: RunConfig, clip: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    write_video(run / "video" / "frames.mkv", pan()[4:], torch.arange(6).double() / 30, lossless=True)
    taught = {"sha256": clip_hash(clip), "part": "t=0.133"}
    (run / "manifest.json").write_text(json.dumps({"format": "cltransfer.run", "reference": taught}))
    (run / "DONE").touch()
    notes = evaluate(clip, run, config).notes
    assert notes[0].startswith("render: taught by REFERENCE#t=0.133, and scored against another part of it")
    report = evaluate(f"{clip}#t=0.133", run, config)
    assert (report.scores.total, report.notes) == (0, ())


def test_a_run_whose_frames_are_closer_than_a_millisecond_is_scored_by_all_of_them(
    config: RunConfig, tmp_path: Path
) -> None:
    times, run = torch.arange(10).double() / 5000, tmp_path / "run"
    write_video(tmp_path / "clip.mp4", pan(), times)
    write_video(run / "video" / "frames.mkv", pan(), times, lossless=True)
    Trajectory(sample_cameras(0, 10), times).save(run / "trajectory.json")
    (run / "manifest.json").write_text('{"format": "cltransfer.run"}')
    (run / "DONE").touch()
    report = evaluate(tmp_path / "clip.mp4", run, config)
    assert (len(report.times), report.notes) == (10, ())


def test_notes_are_printed_and_kept(command: Any, mean_flow: tuple[str, ...], clip: Path, tmp_path: Path) -> None:
    answer = command("evaluate", clip, clip.with_name("frames"), *mean_flow, "--quiet", "--out", tmp_path / "out")
    assert answer.code == 0, answer.err
    assert f"\nnote: render: {ASSUMED}\n" in answer.out
    assert answer.out.startswith("| metric | mean | unit | weighted | coverage |\n")
    flags = json.loads((tmp_path / "out" / "metrics.json").read_text())["flags"]
    assert {"frame": None, "reason": f"render: {ASSUMED}"} in flags


def test_how_far_apart_the_scored_frames_are_is_told(command: Any, mean_flow: tuple[str, ...], clip: Path) -> None:
    for frames, apart in ((None, 1 / 30), (4, 0.1), (1, None)):
        chosen = (clip, clip, *mean_flow, "--quiet", *(() if frames is None else (f"frames={frames}",)))
        said = json.loads(command("evaluate", *chosen, "--json").out)["seconds_apart"]
        assert said == (None if apart is None else pytest.approx(apart, abs=0.001))
        told = [line for line in command("evaluate", *chosen).out.splitlines() if "apart" in line]
        assert told == ([] if apart is None else [f"note: scored frames are {number(said)} s apart"])


def steady(path: Path, rate: float, seconds: float, speed: float = 36.0) -> str:
    """A video of a camera that pans by ``speed`` pixels a second over a blotchy wall."""
    coarse = torch.rand(1, 3, 9, 80, generator=torch.Generator().manual_seed(1))
    wall = torch.nn.functional.interpolate(coarse, (48, 1600), mode="bicubic")[0].clamp(0, 1)  # a quarter pixel wide
    times = torch.arange(round(rate * seconds) + 1).double() / rate
    at = [round(float(t) * speed * 4) for t in times]
    image = torch.stack([wall[:, :, x : x + 256].reshape(3, 48, 64, 4).mean(3) for x in at])
    write_video(path, image.mul(255).byte(), times, lossless=True)
    return str(path)


def test_the_same_movement_scores_alike_at_any_rate(tmp_path: Path, config: RunConfig) -> None:
    reference = steady(tmp_path / "reference.mkv", 24, 1)
    still = evaluate(reference, steady(tmp_path / "still.mkv", 24, 1, speed=0), config)
    for rate, seconds, scored in ((48, 1, 25), (25, 1, 25), (24, 3, 25), (12, 1, 13)):
        report = evaluate(reference, steady(tmp_path / f"{rate} {seconds}.mkv", rate, seconds), config)
        assert len(report.times) == scored
        apart = 1 / min(rate, 24)  # of the reference, in whose steps movement is
        assert report.apart == pytest.approx(apart, abs=0.001)
        assert report.scores.total < 0.06 * still.scores.total
        count = round(rate * seconds) + 1
        ends, rest = "which has 25 up to 1.00 s", "the others are not scored"
        spare = f"render: {scored} of its {count} frames are paired with frames of the reference, {ends}; {rest}"
        assert (spare in report.notes) == (count > scored)
        skipped = f"render: {scored} of 25 frames of the reference are paired with frames of the render; {rest}"
        assert (skipped in report.notes) == (scored < 25)


def test_which_pairs_are_scored_is_told_where_not_all_are(tmp_path: Path) -> None:
    times = torch.arange(10).double()
    for name, rate in (("quick", 20), ("slow", 10)):
        write_video(tmp_path / f"{name}.mkv", pan(), times / rate, lossless=True)
    quick, slow = (ClipSource.parse(str(tmp_path / f"{name}.mkv")) for name in ("quick", "slow"))
    few = "3 of the pairs are scored (frames=3)"
    for frames, rest in ((None, "the others are not scored"), (5, "the others are not scored"), (3, few)):
        (_, note) = open_pairs(quick, slow, frames)[2]
        assert note == f"5 of 10 frames of the reference are paired with frames of the render; {rest}"
        (note, _) = open_pairs(slow, quick, frames)[2]
        assert note == f"5 of its 10 frames are paired with frames of the reference, which has 10 up to 0.90 s; {rest}"


def test_a_render_that_ends_early_is_told(tmp_path: Path, config: RunConfig) -> None:
    reference, short = steady(tmp_path / "reference.mkv", 24, 2), steady(tmp_path / "render.mkv", 24, 1)
    (note,) = evaluate(reference, short, config).notes
    assert note == "render: ends at 1.00 s, the reference at 2.00 s: what comes after is not scored"


def test_a_last_frame_that_the_render_lacks_is_told(tmp_path: Path) -> None:
    reference, short = steady(tmp_path / "reference.mkv", 24, 1), steady(tmp_path / "render.mkv", 24, 23 / 24)
    assert open_pairs(ClipSource.parse(short), ClipSource.parse(short), None)[2] == ()
    (note,) = open_pairs(ClipSource.parse(reference), ClipSource.parse(short), None)[2]
    assert note == "ends at 0.96 s, the reference at 1.00 s: what comes after is not scored"


def told(reference: Features, rendered: Features) -> list[str]:
    """The notes on what is undefined, by framing, filmic space and camera angle."""
    objective = Objective({name: LOSSES.build(name) for name in ("framing", "filmic_space", "camera_angle")})
    scores = score(objective, reference, rendered, {"depth": "no extractor provides depth"})
    return undefined(scores, objective.defined(reference), reference, rendered)


def test_what_the_render_has_lost_is_told() -> None:
    whole = sample_features(0, 12)
    nobody = [*range(2, 10)]
    lost = Features.concatenate([whole[[0, 1]], without_person(whole[nobody]), whole[[10, 11]]])
    price = "each missing term costs its penalty in the total"
    assert told(whole, whole) == []
    assert told(whole, lost) == [f"render: no person in 8 of 12 frames; {price}"]
    assert told(lost, lost) == ["reference: no person in 8 of 12 frames"]
    turned = lost.having("orientation", lost.require("orientation").index_fill(0, torch.tensor([0]), torch.nan))
    more = "camera_angle undefined in 1 more of 12 frames"
    assert told(whole, turned) == [f"render: no person in 8 of 12 frames; {more}; {price}"]
    seen = whole.having("orientation", turned.require("orientation"))
    assert told(whole, seen) == [f"render: camera_angle undefined in 9 of 12 frames; {price}"]


def test_why_a_term_has_no_value_is_told() -> None:
    whole = sample_features(0, 3)
    assert told(whole.having("depth", None), whole) == ["filmic_space: no extractor provides depth"]
    assert told(whole, without_person(whole)) == [
        "framing, filmic_space, camera_angle: undefined on every frame of the render",
        "render: no person in 3 of 3 frames; each missing term costs its penalty in the total",
    ]
    assert told(whole, whole.having("depth", None)) == [
        "filmic_space: the render has no 'depth'",
        "render: each missing term costs its penalty in the total",
    ]


@dataclass(frozen=True)
class SomeDepth:
    """Depth of a whole clip, if it begins bright."""

    requires: tuple[str, ...] = ("flow",)
    provides: tuple[str, ...] = ("depth",)
    family: str = "image"
    whole_clip: bool = True
    note: str = ""

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        first = load(0, 1).require("image")
        if float(first.mean()) < 0.5:
            return replace(found, reasons={**found.reasons, "depth": "it is too dark"})
        depth = torch.linspace(1, 5, first.shape[2])[:, None].expand(first.shape[2:])
        return replace(found, depth=depth.repeat(len(found), 1, 1))


@dataclass(frozen=True)
class SomeLayers:
    """Three stripes of the frame, others where there is depth."""

    requires: tuple[str, ...] = ("image",)
    uses: tuple[str, ...] = ("depth",)
    provides: tuple[str, ...] = ("layers",)
    family: str = "image"

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        layers = torch.zeros(len(now), 3, *now.require("image").shape[2:], dtype=torch.bool)
        for i, row in enumerate((0, 24, 36) if now.has("depth") else (0, 8, 16)):
            layers[:, i, row : row + 8] = True
        return replace(now, layers=layers)


@pytest.fixture
def with_depth() -> Iterator[RunConfig]:
    """Movement by layers, which use a depth that not every clip has, and filmic space, which requires it."""
    EXTRACTORS.register("some_depth")(SomeDepth)
    EXTRACTORS.register("some_layers")(SomeLayers)
    others = [f"extractors.{name}=null" for name in load_config().extractors if name != "flow_dis"]
    losses = [f"losses.{name}=null" for name in ("shot_size", "framing", "camera_angle")]
    yield load_config(overrides=[*others, *losses, "extractors.some_depth={}", "extractors.some_layers={}"])
    for name in ("some_depth", "some_layers"):
        EXTRACTORS._classes.pop(name)


def test_what_only_one_clip_has_helps_neither_to_read_the_rest(tmp_path: Path, with_depth: RunConfig) -> None:
    dark = pan().float().mul(0.4).byte()
    bright = 255 - dark
    for name, image in (("dark", dark), ("bright", bright)):
        write_video(tmp_path / f"{name}.mkv", image, torch.arange(10).double() / 24, lossless=True)
    found = []
    for reference, render in (("bright", "dark"), ("dark", "bright"), ("dark", "dark")):
        report = evaluate(str(tmp_path / f"{reference}.mkv"), str(tmp_path / f"{render}.mkv"), with_depth)
        space, movement = (report.scores.term(name) for name in ("filmic_space", "camera_movement"))
        assert space is not None
        assert movement is not None
        whose = "the render" if reference == "bright" else "the reference"
        assert space.reason == f"{whose} has no 'depth': it is too dark"
        found.append(movement.mean)
    assert found[2] == 0.0
    assert max(found[:2]) < 0.002  # other stripes differ by more


class Film:
    """Draws the frames of a clip, one after the other, whatever is asked for."""

    provides = frozenset({"image"})

    def __init__(self, image: Tensor) -> None:
        self.left = image.float() / 255

    def render(self, scene: Any, cameras: Any, buffers: frozenset[str]) -> Features:
        image, self.left = self.left[: len(cameras)], self.left[len(cameras) :]
        return Features(cameras.size, image=image, camera=cameras)


def test_a_result_is_read_back_by_the_rule_by_which_clips_are_scored(
    tmp_path: Path, with_depth: RunConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And nothing is read anew for a view that is held, nor for another round."""
    dark = pan().float().mul(0.4).byte()
    bright = 255 - dark
    for name, image in (("dark", dark), ("bright", bright)):
        write_video(tmp_path / f"{name}.mkv", image, torch.arange(10).double() / 24, lossless=True)
    parts = replace(Components.build(with_depth), renderer=Film(dark))
    reference = read_reference(str(tmp_path / "bright.mkv"), parts, Reading())
    scene: Any = SimpleNamespace(subject=None)
    stage = Stage(scene, parts.renderer, parts.plan("image"), parts.objective, (64, 48))
    anew, read_anew = list[int](), read_alike

    def counted(features: Features, *others: Any) -> Features:
        anew.append(len(features))
        return read_anew(features, *others)

    monkeypatch.setattr("cltransfer.reading.reference.read_alike", counted)
    found = read_back(stage, parts, reference, room_cameras(10, (64, 48)), by_networks=True)
    assert anew == [10]
    scored = evaluate(str(tmp_path / "bright.mkv"), str(tmp_path / "dark.mkv"), with_depth).scores
    assert found.features.reasons == {"depth": "it is too dark"}
    for name in ("camera_movement", "filmic_space"):
        mine, theirs = found.scores.term(name), scored.term(name)
        assert mine is not None
        assert theirs is not None
        torch.testing.assert_close(mine.values, theirs.values, rtol=0, atol=0, equal_nan=True)
    monkeypatch.setattr("cltransfer.reading.reference.read_alike", lambda features, *_: features)
    parts = replace(parts, renderer=Film(dark))
    again = read_back(stage, parts, found.reference, room_cameras(10, (64, 48)), by_networks=True)
    torch.testing.assert_close(again.scores.totals, found.scores.totals, rtol=0, atol=0, equal_nan=True)
    held = read_held(stage, parts, found, room_cameras(10, (64, 48)))
    assert held is not None
    assert held.term("camera_movement").mean > 0  # type: ignore[union-attr]
    with_its_own = replace(found, read=Read.of(reference.features, found.scores), reference=reference)
    assert read_held(stage, parts, with_its_own, room_cameras(10, (64, 48))) is None


def test_what_one_round_had_to_do_without_helps_to_read_no_later_one(
    tmp_path: Path, with_depth: RunConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first of a bright clip is dark, which has no depth; the second and third are the clip itself."""
    dark = pan().float().mul(0.4).byte()
    bright = 255 - dark
    write_video(tmp_path / "bright.mkv", bright, torch.arange(10).double() / 24, lossless=True)
    parts = replace(Components.build(with_depth), renderer=Film(torch.cat([dark, bright, bright])))
    reference = read_reference(str(tmp_path / "bright.mkv"), parts, Reading())
    scene: Any = SimpleNamespace(subject=None)
    stage = Stage(scene, parts.renderer, parts.plan("image"), parts.objective, (64, 48))
    cameras, means = room_cameras(10, (64, 48)), []
    for _ in range(3):
        shown = read_back(stage, parts, reference, cameras, by_networks=True)
        reference = shown.reference
        means.append(shown.scores.term("camera_movement").mean)  # type: ignore[union-attr]
    assert means[0] > 0.0
    assert means[1:] == [0.0, 0.0]


def test_what_an_extractor_says_of_itself_is_told(tmp_path: Path, with_depth: RunConfig) -> None:
    clip = str(images(tmp_path / "a", 255 - pan().float().mul(0.4).byte()))
    noted = replace(with_depth, extractors={**with_depth.extractors, "some_depth": {"note": "is a guess"}})
    told = [{flag.reason for flag in evaluate(clip, clip, config).flags} for config in (with_depth, noted)]
    assert told[1] - told[0] == {"some_depth: is a guess"}
    parts = Components.build(noted)
    assert "some_depth: is a guess" in read_reference(clip, parts, Reading(4, 64, "scene")).flags


def test_two_clips_of_which_nothing_can_be_measured_have_no_total(tmp_path: Path, with_depth: RunConfig) -> None:
    alone = replace(with_depth, losses={"filmic_space": with_depth.losses["filmic_space"]})
    for name, seed in (("a", 0.3), ("b", 0.4)):
        write_video(
            tmp_path / f"{name}.mkv", pan().float().mul(seed).byte(), torch.arange(10).double() / 24, lossless=True
        )
    report = evaluate(str(tmp_path / "a.mkv"), str(tmp_path / "b.mkv"), alone)
    total = metrics_json(report)["metrics"]["total"]
    assert (total["mean"], total["defined"], total["frames"]) == (None, 0, 10)
    assert total["reason"] == "no term is defined on any frame of the reference"


@dataclass(frozen=True)
class NoJoints:
    """Nobody in any frame."""

    requires: tuple[str, ...] = ("image",)
    provides: tuple[str, ...] = ("keypoints", "subject", "orientation")
    family: str = "image"

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        count, _, height, width = now.require("image").shape
        keypoints, orientation = torch.full((count, 14, 3), torch.nan), torch.full((count, 3), torch.nan)
        subject = torch.zeros(count, height, width, dtype=torch.bool)
        return replace(now, keypoints=keypoints, subject=subject, orientation=orientation)


@pytest.fixture
def without_joints() -> Iterator[RunConfig]:
    """Framing, of a clip in which nobody is found."""
    EXTRACTORS.register("no_joints")(NoJoints)
    config = load_config()
    yield replace(config, losses={"framing": config.losses["framing"]}, extractors={"no_joints": {}})
    EXTRACTORS._classes.pop("no_joints")


def test_a_reference_that_shows_nobody_is_refused_with_what_to_do(clip: Path, without_joints: RunConfig) -> None:
    with pytest.raises(InputError) as caught:
        evaluate(str(clip), str(clip), without_joints)
    hint = "another part of it: #t=START,END, or more frames="
    assert str(caught.value) == f"{clip}: person: none found in 10 frames ({hint})"


def barred(path: Path, bars: int) -> str:
    """The pan with black bars on its left and right."""
    image = pan() // 2 + 60
    image[:, :, :bars] = image[:, :, 48 - bars :] = 0
    write_video(path, image, torch.arange(10).double() / 24, lossless=True)
    return str(path)


def test_bars_of_a_render_are_cropped_where_the_reference_has_the_same(tmp_path: Path, config: RunConfig) -> None:
    reference, render = barred(tmp_path / "reference.mkv", 6), barred(tmp_path / "render.mkv", 6)
    report = evaluate(reference, render, config)
    assert report.render_frames.shape[2] == 36
    assert report.scores.total == 0.0
    assert [note.split(":")[0] for note in report.notes] == ["reference", "render"]  # both are told to be cropped
    assert evaluate(f"{reference}#letterbox=keep", render, config).render_frames.shape[2] == 48


def test_other_bars_of_a_render_are_cropped_only_when_asked(tmp_path: Path) -> None:
    reference, render = barred(tmp_path / "reference.mkv", 6), barred(tmp_path / "render.mkv", 8)
    both, _, notes = open_pairs(ClipSource.parse(reference), ClipSource.parse(render), None)
    assert (both.reference.size, both.render.size) == ((64, 36), (64, 48))
    assert notes[-1].startswith("its frames and those of the reference, 64x48 and 64x36, are not of one shape")
    assert notes[-2] == OWN_BARS
    both, _, notes = open_pairs(ClipSource.parse(reference), ClipSource.parse(f"{render}#letterbox=crop"), None)
    assert both.render.size == (64, 32)
    assert OWN_BARS not in notes


def test_bars_of_a_render_whose_reference_has_none_are_told(tmp_path: Path) -> None:
    plain, render = barred(tmp_path / "reference.mkv", 0), barred(tmp_path / "render.mkv", 8)
    sources = [ClipSource.parse(name) for name in (plain, render)]
    told, plain_told = (open_pairs(sources[0], source, None)[2] for source in (sources[1], sources[0]))
    assert OWN_BARS in told
    assert plain_told == ()


def test_clips_that_memory_has_no_room_for_are_refused_before_they_are_read(
    clip: Path, config: RunConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CLTRANSFER_MEMORY", "1")  # MB, less than this process takes
    with pytest.raises(ResourceError, match=r"clip\.mkv: memory: 10 frames of 64x48 need 0 MB, 0 MB are free"):
        evaluate(str(clip), str(clip), config)


def test_maps_that_memory_has_no_room_for_are_refused(
    clip: Path, config: RunConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltransfer.reading.frames.MAPS", 10**9)
    with pytest.raises(ResourceError, match="the maps of frames, 10 of 64x48 and 10 of 64x48, need"):
        evaluate(str(clip), str(clip), config)


def test_pairs_are_thinned_whichever_clip_is_longer(
    clip: Path, config: RunConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    thin = replace(config, frames=4)
    for first, second in ((f"{clip}#t=0,0.2", str(clip)), (str(clip), f"{clip}#t=0,0.2"), (str(clip), str(clip))):
        report = evaluate(first, second, thin)
        assert len(report.times) == 4
        assert report.scores.totals[1:].tolist() == [0.0] * 3
    monkeypatch.setattr("cltransfer.clips.part.FRAME_LIMIT", 4)  # of those that are kept
    assert len(evaluate(str(clip), str(clip), thin).times) == 4
    with pytest.raises(InputError, match=r"clip\.mkv: frames: expected at most 4 to keep, got 10"):
        evaluate(str(clip), str(clip), config)


def test_where_no_loss_can_be_read_every_frame_is_undefined_and_the_note_tells_why(command: Any, clip: Path) -> None:
    others = [f"losses.{name}=null" for name in ("shot_size", "framing", "filmic_space", "camera_angle")]
    words = (*others, "losses.camera_movement.layered=false", "extractors.flow_dis=null", "--quiet", "--json")
    answer = command("evaluate", clip, clip, *words)
    assert answer.code == 0, answer.err
    said = json.loads(answer.out)["metrics"]
    assert said["camera_movement"]["mean"] is None
    assert said["total"]["mean"] is None
    assert "no image extractor provides" in said["camera_movement"]["reason"]


def test_what_a_run_has_written_is_not_replaced(command: Any, tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    (run / "manifest.json").write_text('{"format": "cltransfer.run"}')
    (run / "metrics.json").write_text("the run's own")
    said = command("evaluate", tmp_path / "a.mp4", run, "--out", run)
    assert (said.code, said.err.count("\n")) == (2, 1)
    assert "run: --out: expected another folder than that of a run" in said.err
    assert (run / "metrics.json").read_text() == "the run's own"


@pytest.mark.parametrize("word", ["output_side=1280", "seed=1", "extract.verify=false", "search.paper_box={}"])
def test_a_key_that_changes_no_score_is_refused(command: Any, tmp_path: Path, word: str) -> None:
    said = command("evaluate", tmp_path / "a.mp4", tmp_path / "b.mp4", "frames=3", word)
    key = word.partition("=")[0].partition(".")[0]
    assert (said.code, said.err.count("\n")) == (2, 1)
    told = "changes nothing of the scores, expected a key that it looks at (frames, renderer, extractors, "
    assert f"error: {key}: {told}" in said.err


def test_the_config_of_a_run_may_say_what_changes_no_score(
    command: Any, mean_flow: tuple[str, ...], clip: Path, tmp_path: Path
) -> None:
    (tmp_path / "config.yaml").write_text(to_yaml(load_config(overrides=["output_side=1280", "engine=cma"])))
    said = command("evaluate", clip, clip, "--config", tmp_path / "config.yaml", *mean_flow, "--quiet", "--json")
    assert said.code == 0, said.err
