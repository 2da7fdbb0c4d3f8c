"""A depth network's shift, read off a scene."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import dataclass
from pathlib import Path

import cv2
import pytest
import torch
from typer.testing import CliRunner

from cltransfer.cli.app import app
from cltransfer.config import load_config
from cltransfer.errors import InputError, ModelError, UsageError
from cltransfer.extractors._disparity import aligned, fit_affine
from cltransfer.extractors.depth_onnx import DepthOnnx
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.reading.depth_alignment import VIEWS, align_config, align_depth, align_parts, needs_scene
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.registry import EXTRACTORS, RENDERERS
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.run.flags import run_flags
from cltransfer.run.folder import write_run
from cltransfer.run.inputs import Inputs
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import save_labels
from cltransfer.scenes.ply import write_splats
from cltransfer.transfer import transfer

PLUGIN = Path(__file__).parents[2] / "plugins" / "rule_of_thirds.py"


def depths(seed=0, views=5):
    """Sloping depths from 2 to 20 with a jump, (V, 12, 16)."""
    random = torch.Generator().manual_seed(seed)
    slope = torch.linspace(2, 8, 16).expand(views, 12, 16) * (1 + torch.rand(views, 1, 1, generator=random))
    return torch.where(torch.arange(12)[:, None] < 4, slope + 4, slope)


@pytest.mark.parametrize("unseen", [0.0, torch.nan])
def test_views_in_which_a_network_sees_nothing_do_not_stop_the_alignment(unseen):
    depth = depths()
    disparity = 1 / depth
    disparity[2:] = unseen
    alone = align_depth(disparity[:2], depth[:2], "metric")
    assert align_depth(disparity, depth, "metric").spread == pytest.approx(alone.spread)


def test_the_spread_of_a_network_whose_disparity_is_below_0_is_a_share_of_it():
    assert align_depth(1 / depths() - 5, depths(), "metric").spread >= 0


def test_the_affine_of_a_network_is_found_though_a_tenth_of_the_pixels_is_wrong():
    depth = depths()[0]
    disparity = (1 / depth - 0.03) / 0.25
    disparity.view(-1)[::10] += 1.0
    a, b = fit_affine(disparity.flatten(), depth.flatten())
    assert a == pytest.approx(0.25, rel=0.02)
    assert b == pytest.approx(0.03, abs=0.002)


def test_metric_is_exact_for_a_network_that_scales_all_frames_alike():
    depth = depths()
    found = align_depth((1 / depth - 0.03) / 0.25, depth, "metric")
    torch.testing.assert_close(torch.tensor(found.affine), torch.tensor([0.25, 0.03]), atol=1e-4, rtol=1e-4)
    assert found.spread < 1e-4
    assert found.error[0] > 0.05
    assert found.error[1] < 1e-4


def test_shift_is_exact_for_a_network_that_scales_each_frame_by_itself():
    depth = depths()
    normal = (1 / depth) / (1 / depth).amax(dim=(1, 2), keepdim=True)
    found = align_depth(7 * (normal - 0.1), depth, "shift")  # the largest it says is 6.3
    assert found.affine[0] == 1
    assert found.affine[1] == pytest.approx(0.1 / 0.9, abs=1e-3)
    assert found.error[1] < 1e-3
    depth_again = 1 / aligned(3 * (normal - 0.1), "shift", found.affine)
    ratio = depth_again / depth
    torch.testing.assert_close(ratio / ratio[:, :1, :1], torch.ones_like(ratio), atol=2e-3, rtol=0)


def test_an_unsteady_network_shows_in_the_spread():
    depth = depths()
    wandering = torch.linspace(-0.1, 0.1, 5)[:, None, None]
    assert align_depth(1 / depth - wandering, depth, "metric").spread > 0.05


@pytest.mark.parametrize("value", [0.0, 0.1, 7.0])
def test_a_constant_disparity_has_no_affine(value):
    depth = depths()[0].flatten()
    noise = 1 + 1e-6 * torch.rand(len(depth), generator=torch.Generator().manual_seed(0))  # as float32 rounds
    for disparity in (torch.full_like(depth, value), value * noise):
        assert all(math.isnan(number) for number in fit_affine(disparity, depth))


@pytest.mark.parametrize("value", [0.0, torch.nan])
def test_a_view_of_which_the_network_says_nothing_is_left_out(value):
    depth = depths()
    disparity = (1 / depth - 0.03) / 0.25
    whole = align_depth(disparity[1:], depth[1:], "metric")
    disparity[0] = value
    found = align_depth(disparity, depth, "metric")
    torch.testing.assert_close(torch.tensor(found.affine), torch.tensor(whole.affine), atol=1e-4, rtol=1e-4)
    assert found.error[0] == pytest.approx(whole.error[0])
    assert found.error[1] < 1e-3 or value == 0  # where all is 0 only the shift is left of the inverse depth


def test_views_that_do_not_tell_are_refused():
    wall = torch.full((2, 4, 4), 3.0)
    with pytest.raises(InputError, match="none of 2 views has disparity that falls with depth"):
        align_depth(1 / wall, wall, "shift")
    with pytest.raises(InputError, match="none of 5 views"):
        align_depth(depths(), depths(), "metric")  # depth, not disparity
    with pytest.raises(ValueError, match="which needs no alignment"):
        align_depth(1 / wall, wall, "raw")


@pytest.mark.parametrize("more", [[], ["extractors.depth_onnx={model: net.onnx, kind: disparity}"]])
def test_a_config_without_a_policy_is_refused(more):
    with pytest.raises(UsageError, match=r"extractors\.depth_onnx: expected align shift or metric, got"):
        align_config("builtin:plaza", load_config(overrides=more), 4)


def test_meanwhile_threads_are_the_config_s(blue, monkeypatch):
    during = set()

    @dataclass(frozen=True)
    class Counted(GaussianSplats):
        def render(self, scene, cameras, buffers):
            during.add(cv2.getNumThreads())
            return super().render(scene, cameras, buffers)

    monkeypatch.setitem(RENDERERS._classes, "counted", Counted)
    cv2.setNumThreads(3)
    align_config("builtin:plaza", load_config(overrides=[blue, "renderer.counted={}", "threads=1"]), 1)
    assert (during, cv2.getNumThreads()) == ({1}, 3)


@pytest.fixture
def blue(blue_network):
    return f"extractors.depth_onnx={{model: {blue_network}, kind: disparity, align: shift, width: 32, height: 16}}"


def test_the_verb_reads_a_network_off_a_scene_and_says_how_steady_it_is(blue):
    told = CliRunner().invoke(app, ["models", "align", "builtin:plaza", blue, "--views", "4", "--json"])
    assert told.exit_code == 0
    found = json.loads(told.stdout)
    assert found["align"] == "shift"
    assert found["affine"][0] == 1
    assert found["error"][1] < found["error"][0]
    assert found["spread"] > 0.1


def test_what_the_verb_prints_stands_in_for_the_options_that_it_was_given(blue, command, tmp_path):
    printed = shlex.split(command("models", "align", "builtin:plaza", blue, "--views", "4").out.splitlines()[0])
    given, network = (load_config(overrides=told).extractors["depth_onnx"] for told in ([blue], printed))
    assert network == {**given, "affine": network["affine"]}
    assert network["affine"][0] == 1
    answer = command("inspect", tmp_path / "gone.mp4", *printed)
    assert (answer.code, "gone.mp4: no such file" in answer.err) == (3, True), answer.err


def test_the_verb_looks_at_a_person_and_by_an_up_that_it_is_given(blue, tmp_path):
    plaza = load_scene("builtin:plaza")
    plaza.subject.save(tmp_path / "subject.json")
    save_labels(tmp_path, plaza.geometry.label)
    write_splats(tmp_path / "stage.ply", plaza.geometry)
    up = ",".join(str(value) for value in plaza.up.tolist())
    words = [blue, "--views", "4", "--json"]
    given = [str(tmp_path / "stage.ply"), "--up", up, "--subject", str(tmp_path / "subject.json")]
    commands = (["models", "align", *scene, *words] for scene in (given, ["builtin:plaza"]))
    told, same = (json.loads(CliRunner().invoke(app, command).stdout) for command in commands)
    assert told["affine"] == pytest.approx(same["affine"], rel=1e-3)


@pytest.mark.slow  # two processes; tests/cli/test_app.py has other verbs with plugins
def test_the_verb_takes_a_config_with_a_plugin(blue, fresh):
    words = ("models", "align", "builtin:plaza", blue, "losses.rule_of_thirds={}", "--views", "4", "--json")
    refused = fresh(*words)
    assert (refused.code, "--allow-plugin" in refused.err) == (2, True)
    told = fresh(*words, "--allow-plugin", PLUGIN)
    assert (told.code, told.err) == (0, "")
    assert json.loads(told.out)["align"] == "shift"


def test_a_depth_network_that_is_missing_is_told_before_a_person_is_lifted_for_it(tmp_path):
    """Nor are the networks here that people are lifted by."""
    write_splats(tmp_path / "stage.ply", load_scene("builtin:plaza").geometry)
    scene = str(tmp_path / "stage.ply")
    config = load_config(overrides=["extractors.depth_onnx={model: gone.onnx, kind: disparity, align: shift}"])
    with pytest.raises(ModelError, match=r"gone\.onnx"):
        align_config(scene, config, 4)
    with pytest.raises(ModelError, match=r"gone\.onnx"):
        transfer(Inputs(scene, str(tmp_path / "clip.mp4")), config)


def test_a_transfer_reads_the_shift_off_its_scene_and_keeps_it_in_the_run(blue, tmp_path):
    features, times = tmp_path / "seen.safetensors", torch.arange(2) / 24
    heights = torch.tensor([30.0, 30, 40, 40, 50, 50, 50, 50, 65, 65, 80, 80, 20, 28])  # as of JOINTS [px]
    joints = torch.stack([torch.full((14,), 80.0), heights, torch.ones(14)], dim=1).expand(2, 14, 3)
    FeatureFile(Features((160, 90), keypoints=joints), times, "made").save(features)
    settings = [blue, "losses.framing.mode=faithful", "extract.verify=false", "preset=fast", "output_side=64"]
    inputs, config = Inputs("builtin:plaza", str(features)), load_config(overrides=settings)
    result = transfer(inputs, config)
    assert result.alignment == align_config("builtin:plaza", config, VIEWS)
    write_run(tmp_path / "run", result, inputs, config)
    kept = load_config(tmp_path / "run" / "config.yaml").extractors["depth_onnx"]
    assert kept["affine"] == list(result.alignment.affine)
    assert any("in this scene (shift;" in flag.reason for flag in run_flags(result))


def test_a_clip_is_read_with_the_shift_of_the_scene(blue):
    config = load_config(overrides=[blue])
    parts, found = align_parts(Components.build(config), load_scene("builtin:plaza"))
    image = torch.rand(1, 3, 16, 32, generator=torch.Generator().manual_seed(0))
    seen = Features((32, 16), image=image)
    given = EXTRACTORS.build("depth_onnx", {**config.extractors["depth_onnx"], "affine": list(found.affine)})
    torch.testing.assert_close(parts.extractors["depth_onnx"](seen).depth, given(seen).depth, equal_nan=True)


@dataclass(frozen=True)
class Finer(DepthOnnx):
    """A plugin's depth network."""


def finer(options):
    return f"extractors.depth_finer={json.dumps(options)}"


def test_a_class_of_a_depth_network_under_another_name_is_aligned_too(blue, monkeypatch):
    monkeypatch.setitem(EXTRACTORS._classes, "depth_finer", Finer)
    options = load_config(overrides=[blue]).extractors["depth_onnx"]
    config = load_config(overrides=[finer(options)])
    parts = Components.build(config)
    assert needs_scene(parts, "clip.mp4", "image")
    aligned, found = align_parts(parts, load_scene("builtin:plaza"), 2)
    assert aligned.extractors["depth_finer"].affine == found.affine
    assert align_config("builtin:plaza", config, 2) == found
    told = CliRunner().invoke(app, ["models", "align", "builtin:plaza", finer(options), "--views", "2"])
    assert told.stdout.startswith("'extractors.depth_finer={")
    with pytest.raises(UsageError, match=r"extractors\.depth_finer: expected align shift or metric, got align raw"):
        align_config("builtin:plaza", load_config(overrides=[finer({**options, "align": "raw"})]), 2)


def test_without_a_scene_a_shift_that_is_not_known_is_refused(blue):
    network = Components.build(load_config(overrides=[blue])).extractors["depth_onnx"]
    with pytest.raises(UsageError, match=r"affine: expected \[a, b\] for align shift, got null .*models align SCENE"):
        network(Features((32, 16), image=torch.rand(1, 3, 16, 32)))
