"""A real person in a real splat scene, and a real clip: lift, transfer, evaluate. Skipped where the data is absent."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.config.options import RunConfig
from cltransfer.evaluate import evaluate
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.progress import silent
from cltransfer.registry import EXTRACTORS
from cltransfer.run.folder import write_run
from cltransfer.run.preparation import Clock, prepare
from cltransfer.scenes import Scene
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lift import Lift, LiftOptions, summary
from cltransfer.scenes.person.lifted import cached_lift, lift_scene, save_lift
from cltransfer.storage.run_files import open_run
from cltransfer.transfer import Inputs, Result, transfer

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"
SCENE, CLIP = DATA / "splat" / "biker_on_lawn.ply", DATA / "video" / "lp_s20.mp4"
MAN = 152_746  # the scene's first Gaussians are the man

NETWORKS = ("models/yolox_nano.onnx", "models/mp_pose_landmark_lite.onnx")

pytestmark = pytest.mark.needs("splat/biker_on_lawn.ply", "video/lp_s20.mp4", *NETWORKS)


@pytest.fixture(scope="module")
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def config(own_cache: Path) -> Iterator[RunConfig]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
        patch.setenv("CLTRANSFER_CACHE", str(own_cache))
        yield load_config(overrides=["preset=fast", "frames=3", "output_side=320"])


@pytest.fixture(autouse=True)
def real_networks(own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For the tests themselves what ``config`` sets for the module's fixtures."""
    monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
    monkeypatch.setenv("CLTRANSFER_CACHE", str(own_cache))


@pytest.fixture(scope="module")
def lifted(config: RunConfig) -> Lift:
    parts = Components.build(config)
    scene = load_scene(SCENE)
    found = lift_scene(scene, parts.renderer, parts.extractors)
    save_lift(cached_lift(scene, parts.renderer, parts.extractors).parent, found)
    return found


@pytest.fixture(scope="module")
def run(config: RunConfig, lifted: Lift, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    folder = open_run(tmp_path_factory.mktemp("run") / "run")
    inputs = Inputs(str(SCENE), str(CLIP))
    result = transfer(inputs, config)
    write_run(folder, result, inputs, config)
    return folder, result


def test_the_man_is_lifted_from_his_own_renders(lifted: Lift) -> None:
    told = summary(lifted)
    assert told["views_with_person"] >= 12
    assert told["joints_known"] >= 9
    assert told["median_error_widths"] <= 0.01
    assert lifted.subject.height == pytest.approx(1.8, abs=0.12)
    facing = lifted.subject.facing
    assert math.degrees(math.acos(float(facing @ torch.tensor([-1.0, 0, 0], dtype=torch.float64)))) < 15


def test_his_gaussians_are_labelled(lifted: Lift) -> None:
    truth = torch.zeros(len(lifted.label), dtype=torch.bool)
    truth[:MAN] = True
    label = lifted.label > 0.5
    assert float((label & truth).sum() / (label | truth).sum()) >= 0.9


def test_shot_size_and_framing_follow_the_pull_back(run: tuple[Path, Result]) -> None:
    _, result = run
    for name, limit in (("shot_size", 0.05), ("framing", 0.06)):
        term, held = result.verified.term(name), result.held.term(name)
        assert term is not None
        assert held is not None
        assert term.mean < limit
        assert term.mean < held.mean  # the first view held still
    anchor = result.scene.subject.anchor
    distance = (result.trajectory.camera.center - anchor).norm(dim=1)
    assert float(distance[-1]) > 1.15 * float(distance[0])


def test_without_a_depth_network_filmic_space_is_absent_and_the_lens_is_kept(run: tuple[Path, Result]) -> None:
    _, result = run
    term = result.verified.term("filmic_space")
    assert term is not None
    assert term.defined == 0
    assert "depth" in term.reason
    focal = result.trajectory.camera.focal
    torch.testing.assert_close(focal, focal[:1].expand(len(focal)))


@pytest.mark.slow  # tests/networks has it of a run by its verb
def test_evaluate_agrees_exactly_on_the_lossless_frames(run: tuple[Path, Result], config: RunConfig) -> None:
    folder, result = run
    again = evaluate(str(CLIP), str(folder / "video" / "frames.mkv"), config)
    for mine, theirs in zip(result.verified.terms, again.scores.terms):
        torch.testing.assert_close(mine.values, theirs.values, rtol=0, atol=0, equal_nan=True)


def test_evaluate_agrees_within_compression_on_the_video(run: tuple[Path, Result], config: RunConfig) -> None:
    folder, result = run
    again = evaluate(str(CLIP), str(folder / "video" / "render.mp4"), config)
    assert float(again.scores.totals.mean()) == pytest.approx(float(result.verified.totals.mean()), rel=0.1)


def test_a_clip_is_read_whole_with_the_shift_of_its_scene(config: RunConfig, lifted: Lift, blue_network: Path) -> None:
    network = {"model": str(blue_network), "kind": "disparity", "align": "shift", "width": 32, "height": 16}
    overrides = ["preset=fast", "frames=3", "search_side=64", "output_side=320"]
    short = replace(load_config(overrides=overrides), extractors={**config.extractors, "depth_onnx": network})
    job = prepare(Inputs(str(SCENE), str(CLIP)), short, Clock(), silent, None)
    assert job.alignment is not None
    given = EXTRACTORS.build("depth_onnx", {**network, "affine": list(job.alignment.affine)})
    assert job.reference.image is not None
    image = job.reference.image.float() / 255
    seen = given(Features(job.reference.features.size, image=image)).depth
    torch.testing.assert_close(job.reference.features.depth, seen, equal_nan=True)  # as of the sky
    (space,) = (i for i, name in enumerate(job.stage.objective.losses) if name == "filmic_space")
    assert bool(job.stage.objective.defined(job.reference.features)[:, space].all())


@pytest.fixture(scope="module")
def pair(config: RunConfig) -> tuple[Scene, torch.Tensor]:
    """The man beside himself, on another part of the lawn, and the way from one to the other."""
    scene = load_scene(SCENE)
    one = scene.geometry
    apart = torch.tensor([0.3, 0.0, 2.4])
    parts = {name: getattr(one, name) for name in ("means", "scales", "quats", "opacity", "sh", "label")}
    both = {name: torch.cat([part, part[:MAN]]) for name, part in parts.items()}
    both["means"][len(one) :] += apart
    return replace(scene, geometry=replace(one, **both), digest="pair"), apart.double()


@pytest.mark.slow  # tests/networks has two persons made by code
def test_either_of_two_men_is_lifted(config: RunConfig, pair: tuple[Scene, torch.Tensor]) -> None:
    scene, apart = pair
    parts = Components.build(config)
    lifts = [
        lift_scene(scene, parts.renderer, parts.extractors, LiftOptions(views=10, person=person)) for person in (0, 1)
    ]
    assert [found.subject.people for found in lifts] == [2, 2]
    way = lifts[1].subject.anchor - lifts[0].subject.anchor
    assert min(float((way - apart).norm()), float((way + apart).norm())) < 0.15
    own = (torch.arange(len(scene.geometry)) < MAN, torch.arange(len(scene.geometry)) >= len(scene.geometry) - MAN)
    for found in lifts:
        label = found.label > 0.5
        assert max(float((label & man).sum() / (label | man).sum()) for man in own) >= 0.85
    assert float((lifts[0].label * lifts[1].label).sum()) == 0
