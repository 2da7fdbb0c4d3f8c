"""Depth from the camera's movement, through the graph to the loss and its reason."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
import torch

pytest.importorskip("pycolmap", reason="needs the extra sfm")

from cltransfer.errors import UsageError
from cltransfer.extractors.depth_sfm import DepthSfm
from cltransfer.extractors.layers import Layers
from cltransfer.extractors.scene_subject import SceneSubject
from cltransfer.features import Features, OfThisRun
from cltransfer.losses.filmic_space import FilmicSpace, layer_depths
from cltransfer.pipeline.graph import run, run_clip
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.plan import make_plan
from cltransfer.pipeline.scores import score
from cltransfer.registry import RENDERERS
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import shot

SIZE = (480, 270)


class ImageSubject(SceneSubject):
    """The person's pixels as a network would read them, here from the renderer's label."""

    family = "image"


@pytest.fixture(scope="module")
def filmed():
    """A function: name of a shot -> all that a renderer knows of 12 frames."""
    scene = builtin_scene("courtyard")

    def film(name):
        path = shot(name, scene.subject, SIZE, 12)
        return RENDERERS.build("gaussian_splats").render(scene, path.camera, frozenset({"image", "depth", "label"}))

    return film


class HalvedSubject(ImageSubject):
    """The same of every second row and column."""

    def __call__(self, now, before):
        made = super().__call__(now, before)
        return replace(made, subject=made.subject[:, ::2, ::2])


def read(clip, depth=None, subject=None):
    """The clip as the graph reads it, with nothing but pixels and who is the subject."""
    extractors = {"subject": subject or ImageSubject(), "depth_sfm": depth or DepthSfm(), "layers": Layers()}
    plan = make_plan(frozenset({"depth", "layers", "subject"}), extractors, frozenset({"image", "label"}), "image")
    pixels = Features(clip.size, image=clip.image, label=clip.label)
    return plan, run_clip(plan, lambda start, stop: pixels[slice(start, stop)], len(clip))


@pytest.fixture(scope="module")
def trucked(filmed):
    clip = filmed("truck")
    return clip, *read(clip)


def test_depth_of_the_layers_is_right_up_to_scale(trucked):
    clip, _, got = trucked
    true = layer_depths(replace(got, depth=clip.depth), 0.005)
    ratio = (layer_depths(got, 0.005) / true).log()
    ratio -= ratio[:, 1].nanmedian()  # the unknown scale, taken from the subject
    character, background = ratio[:, 1].abs().nanmedian(), ratio[:, 2].abs().nanmedian()
    assert float(character) < 0.02
    assert float(background) < 0.15
    within = (got.depth / clip.depth).log()
    within -= within[got.subject].nanmedian()
    assert float(within.abs().nanmedian()) < 0.1


@pytest.mark.slow  # COLMAP has to look again
def test_a_subject_of_fewer_pixels_than_the_frame_gives_nearly_the_same_depth(trucked):
    clip, _, full = trucked
    _, half = read(clip, subject=HalvedSubject())
    assert half.depth.shape == full.depth.shape
    ratio = (layer_depths(half, 0.005) / layer_depths(full, 0.005)).log()
    ratio -= ratio[:, 1].nanmedian()  # the unknown scale, taken from the subject
    assert float(ratio[:, 1:].abs().nanmedian()) < 0.03


def test_most_of_the_frame_has_a_depth_and_every_depth_a_confidence(trucked):
    _, _, got = trucked
    known = got.depth.isfinite()
    assert float(known.float().mean()) > 0.7
    confidence = got.extras["depth_confidence"]
    assert torch.equal(confidence.isfinite(), known)
    assert bool((confidence[known] >= 0.5).all() and (confidence[known] <= 1).all())


def test_layers_are_told_apart_by_it(trucked):
    clip, _, got = trucked
    exact = Layers()(Features(clip.size, depth=clip.depth, subject=got.subject), None).layers
    for layer, least in ((0, 0.5), (2, 0.85)):  # few points on the floor: the foreground spreads over its edges
        both = (got.layers[:, layer] & exact[:, layer]).sum() / got.layers[:, layer].sum()
        assert float(both) > least


def test_a_clip_that_does_not_tell_says_why_and_keeps_its_other_features(filmed):
    _, got = read(filmed("zoom"))
    assert not got.has("depth")
    assert got.reasons["depth"].startswith("depth_sfm: no parallax: a homography of each pair of frames explains 9")
    assert bool((got.layers[:, 1] | got.layers[:, 2]).all())  # without depth, all but the subject is background
    scores = score(Objective({"filmic_space": FilmicSpace()}), got, got, {})
    assert scores.term("filmic_space").reason == f"the reference has no 'depth': {got.reasons['depth']}"
    assert bool(scores.totals.isnan().all())


class NoSubject(ImageSubject):
    """A pixel in which nothing is found again."""

    def __call__(self, now, before):
        made = torch.zeros_like(super().__call__(now, before).subject)
        made[:, 0, 0] = True
        return replace(now, subject=made)


@pytest.mark.slow  # COLMAP has to look again
def test_a_clip_that_tells_no_depth_of_the_subject_says_so(filmed):
    _, got = read(filmed("truck"), subject=NoSubject())
    told = "depth_sfm: no point on the subject stands still (it moves, or shows too little)"
    assert got.reasons == dict.fromkeys(("depth", "depth_confidence"), told)


@pytest.mark.slow  # it runs out
def test_a_clip_for_which_time_ran_out_is_not_blamed(filmed, monkeypatch):
    import pycolmap

    def slow(database, folder, models, options):
        time.sleep(options.max_runtime_seconds)
        return {}

    monkeypatch.setattr(pycolmap, "incremental_mapping", slow)
    _, got = read(filmed("truck"), DepthSfm(lens=1.1, seconds=1))
    told = "depth_sfm: time ran out after 1 s with 0 of 12 frames placed (extractors.depth_sfm.seconds=2)"
    assert got.reasons == dict.fromkeys(("depth", "depth_confidence"), told)
    assert all(isinstance(reason, OfThisRun) for reason in got.reasons.values())
    monkeypatch.setattr(pycolmap, "incremental_mapping", lambda *given: {})
    _, got = read(filmed("truck"), DepthSfm(lens=1.1, seconds=1))
    assert got.reasons["depth"].startswith("depth_sfm: only 0 of 12 frames could be placed with one lens")
    assert not isinstance(got.reasons["depth"], OfThisRun)


def test_a_single_render_is_refused_in_one_line(trucked):
    clip, plan, _ = trucked
    with pytest.raises(UsageError, match="extractor depth_sfm: reads a whole clip, not single renders"):
        run(plan, Features(clip.size, image=clip.image, label=clip.label), None)


@pytest.mark.parametrize("options", [{"reach": 0}, {"seconds": 0}, {"lens": -1.0}, {"min_confidence": 1.5}])
def test_options_out_of_range_are_refused(options):
    with pytest.raises(ValueError, match="must be"):
        DepthSfm(**options)
