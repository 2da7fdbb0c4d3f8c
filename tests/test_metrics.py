"""The losses as torchmetrics: means, coverage, collections, bootstraps, merging."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torchmetrics import Metric, MetricCollection
from torchmetrics.wrappers import BootStrapper

from cltransfer.config import load_config
from cltransfer.errors import ModelError
from cltransfer.features import Features
from cltransfer.metrics import PAPER, LossMetric, TotalMetric, camera_language_metrics
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.scores import score
from cltransfer.reading.frames import clip_features
from cltransfer.registry import LOSSES
from cltransfer.testing import sample_features, without_person

REFERENCE, RENDERED = sample_features(0, 6), sample_features(1, 6)


@pytest.mark.parametrize("name", PAPER)
def test_is_the_mean_of_the_loss(name: str) -> None:
    metric = LossMetric(name)
    metric.update(REFERENCE[:2], RENDERED[:2])
    metric.update(REFERENCE[2:], RENDERED[2:])
    torch.testing.assert_close(metric.compute(), LOSSES.build(name)(REFERENCE, RENDERED).double().mean())
    assert metric.coverage == (6, 6)


@pytest.mark.parametrize("reference", [REFERENCE[:1], REFERENCE[:0]])
def test_no_frames_are_none_and_nobodys_mistake(reference: Features) -> None:
    metric = LossMetric("framing")
    metric.update(reference, RENDERED[:0])
    metric.update(REFERENCE, RENDERED)
    assert metric.coverage == (6, 6)


@pytest.mark.parametrize(
    ("of", "came"),
    [(lambda n: torch.zeros(1), "shape (1,)"), (lambda n: torch.zeros(()), "shape ()"),
     (lambda n: torch.zeros(n, 1), "shape (6, 1)"), (lambda n: 0.5, "float")],
)  # fmt: skip
def test_a_loss_that_gives_no_value_a_frame_is_refused(of: Callable[[int], Any], came: str) -> None:
    """A mean of its batch would count as one frame."""

    class Mine(type(LOSSES.build("framing"))):
        def __call__(self, reference: Features, rendered: Features) -> Any:
            return of(len(rendered))

    metric = LossMetric("framing")
    metric.loss = Mine()
    with pytest.raises(ModelError) as caught:
        metric.update(REFERENCE, RENDERED)
    assert str(caught.value).startswith(f"loss Mine: expected values of shape (6,), got {came}")
    assert metric.coverage == (0, 0)


def test_undefined_frames_count_in_the_coverage_only() -> None:
    metric = LossMetric("camera_angle")
    metric.update(REFERENCE, RENDERED)
    before = metric.compute()
    metric.update(REFERENCE, without_person(RENDERED))
    assert metric.coverage == (6, 12)
    assert metric.compute() == before
    metric.reset()
    metric.update(REFERENCE, replace(RENDERED, orientation=None))
    assert metric.coverage == (0, 6)
    assert metric.compute().isnan()


def test_a_reference_against_itself_is_0_on_every_term() -> None:
    metrics = camera_language_metrics()
    metrics.update(REFERENCE, REFERENCE)
    covered = {f"{name}_coverage": 1.0 for name in PAPER}
    assert metrics.compute() == {"total": 0.0, **dict.fromkeys(PAPER, 0.0), **covered}


def lost(features: Features, frame: int) -> Features:
    """The same with nobody in ``frame``."""
    parts = [without_person(features[i]) if i == frame else features[i] for i in range(len(features))]
    return Features.concatenate(parts)


def test_losing_the_person_never_pays_in_the_total_and_shows_in_the_coverage() -> None:
    framing = LOSSES.build("framing")
    worst = int(framing(REFERENCE, RENDERED).argmax())
    kept, gone = camera_language_metrics(), camera_language_metrics()
    kept.update(reference=REFERENCE, rendered=RENDERED)
    gone.update(reference=REFERENCE, rendered=lost(RENDERED, worst))
    before, after = kept.compute(), gone.compute()
    assert after["framing"] < before["framing"]
    assert after["total"] > before["total"]
    assert float(after["framing_coverage"]) == pytest.approx(5 / 6)


TOTALS = {
    "whole": (REFERENCE, RENDERED),
    "the render has lost the person": (REFERENCE, lost(RENDERED, 2)),
    "the reference has nobody": (lost(REFERENCE, 3), RENDERED),
    "no depth": (REFERENCE, replace(RENDERED, depth=None)),
    "a frame without any term": (
        replace(lost(REFERENCE, 1), flow=None, depth=None).only({"keypoints", "subject"}),
        RENDERED,
    ),
    "one reference": (REFERENCE[:1], RENDERED),
}


@pytest.mark.parametrize("case", TOTALS)
def test_the_total_is_that_of_evaluate(case: str) -> None:
    reference, rendered = TOTALS[case]
    metrics = camera_language_metrics()
    metrics.update(reference[: len(reference) // 2 or 1], rendered[:3])
    metrics.update(reference[len(reference) // 2 :], rendered[3:])
    scores = score(Objective(Components.build(load_config()).losses), reference, rendered, {})
    values = metrics.compute()
    torch.testing.assert_close(float(values["total"]), scores.total, equal_nan=True)
    for term in scores.terms:
        assert float(values[f"{term.name}_coverage"]) == pytest.approx(term.defined / 6)


def test_a_collection_says_the_same_by_forward_as_by_update() -> None:
    updated, called = camera_language_metrics(), camera_language_metrics()
    for frames in (slice(0, 2), slice(2, 6)):
        updated.update(REFERENCE[frames], lost(RENDERED, 1)[frames])
        alone = called(REFERENCE[frames], lost(RENDERED, 1)[frames])
    assert updated.compute() == called.compute()
    assert float(alone["framing_coverage"]) == 1.0


def test_a_collection_of_no_loss_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^expected one loss or more, got none; leave them out for the paper's five$"):
        camera_language_metrics({})


@pytest.mark.parametrize("losses", [["framing", "shot_size"], {"framing": {}, "shot_size": {}}, "framing"])
def test_a_collection_is_of_losses_by_name(losses: Any) -> None:
    names = {"framing"} if losses == "framing" else {"framing", "shot_size"}
    assert set(camera_language_metrics(losses)) == {"total", *names, *(f"{name}_coverage" for name in names)}


def test_metrics_are_plotted_as_any_torchmetric() -> None:
    metric = LossMetric("framing")
    metric.update(REFERENCE, RENDERED)
    figure, axes = metric.plot()
    assert figure.axes == [axes]


def test_a_collection_keeps_losses_apart_that_were_equal_once() -> None:
    metrics = MetricCollection({name: LossMetric(name) for name in PAPER})
    metrics.update(REFERENCE, REFERENCE)
    metrics.update(REFERENCE, RENDERED)
    for name, value in metrics.compute().items():
        torch.testing.assert_close(value, LOSSES.build(name)(REFERENCE, RENDERED).double().mean() / 2)


def test_a_collection_keeps_options_of_one_loss_apart_that_were_equal_once() -> None:
    modes = ("robust", "faithful")
    metrics = MetricCollection({mode: LossMetric("shot_size", {"mode": mode}) for mode in modes})
    joints = REFERENCE.require("keypoints").clone()
    joints[..., 2] = 0.1  # seen by none: only one mode tells that
    for reference in (without_person(REFERENCE), replace(REFERENCE, keypoints=joints), REFERENCE):
        metrics.update(reference, RENDERED)
    for mode, value in metrics.compute().items():
        alone = LossMetric("shot_size", {"mode": mode})
        for reference in (without_person(REFERENCE), replace(REFERENCE, keypoints=joints), REFERENCE):
            alone.update(reference, RENDERED)
        torch.testing.assert_close(value, alone.compute())
        assert metrics[mode].coverage == alone.coverage


def test_a_bootstrap_draws_frames_again() -> None:
    values = LossMetric("framing").values(REFERENCE, RENDERED)
    bootstrap = BootStrapper(LossMetric("framing"), num_bootstraps=200, sampling_strategy="multinomial", raw=True)
    bootstrap.update(values)
    drawn = bootstrap.compute()["raw"]
    assert values.min() <= drawn.min() < drawn.max() <= values.max()
    torch.testing.assert_close(drawn.mean(), values.mean().double(), rtol=0.1, atol=0)


@pytest.mark.parametrize("make", [lambda: LossMetric("framing"), lambda: TotalMetric({"framing": {}})])
def test_states_of_two_processes_add_up(make: Callable[[], Metric]) -> None:
    first, second, both = make(), make(), make()
    first.update(REFERENCE[:2], RENDERED[:2])
    second.update(REFERENCE[2:], RENDERED[2:])
    both.update(REFERENCE, RENDERED)
    first.merge_state(second)
    torch.testing.assert_close(first.compute(), both.compute())


def test_coverage_is_that_of_all_processes_as_the_mean_is() -> None:
    def gathered(value: Tensor, group: object = None) -> list[Tensor]:
        """The state of this process and of another one, that holds [5, nan, nan]."""
        return [value, next(states)]

    metric = LossMetric("framing", dist_sync_fn=gathered, distributed_available_fn=lambda: True)
    for values, covered in (([1.0, 3.0], (3, 5)), ([7.0], (4, 6))):
        states = iter(torch.tensor([5.0, 1.0, 3.0], dtype=torch.float64))  # total, defined, frames
        metric.update(torch.tensor(values))
        assert metric.coverage == covered
        assert float(metric.compute()) == (3.0 if len(values) == 2 else 4.0)
        assert metric.coverage == covered  # and no process is asked again


@pytest.mark.parametrize("half", [torch.bfloat16, torch.float16])
def test_a_model_in_half_precision_leaves_its_scores_theirs(half: torch.dtype) -> None:
    model = torch.nn.ModuleDict({"scores": MetricCollection({"framing": LossMetric("framing")})}).to("cpu", half)
    metric = model["scores"]["framing"]
    for _ in range(300):
        metric.update(torch.tensor([0.5, 1.5]))
    metric = metric.to(half)
    assert (float(metric.compute()), metric.coverage) == (1.0, (600, 600))
    assert metric.compute().dtype is torch.float64
    metric.set_dtype(torch.float32)  # which says so
    assert metric.compute().dtype is torch.float32


def test_features_without_a_render_are_refused() -> None:
    with pytest.raises(ValueError, match="both sides"):
        LossMetric("framing").update(REFERENCE)


FRAMES = torch.zeros(4, 3, 9, 16, dtype=torch.uint8)


@pytest.mark.parametrize("pair", [(FRAMES, FRAMES), (FRAMES,), (FRAMES[:, 0, 0, 0], RENDERED), (REFERENCE, FRAMES)])
def test_frames_are_not_taken_for_values(pair: tuple[Tensor, ...]) -> None:
    metric = LossMetric("framing")
    with pytest.raises(ValueError, match=r"expected Features .*, got a tensor \(4"):
        metric.update(*pair)
    assert metric.coverage == (0, 0)


def test_sides_of_unequal_length_are_refused() -> None:
    with pytest.raises(ValueError, match="the reference has 6 and the render 4"):
        LossMetric("framing").update(REFERENCE, RENDERED[:4])
    with pytest.raises(ValueError, match="the reference has 6 and the render 1"):
        LossMetric("framing").update(REFERENCE, RENDERED[:1])
    metric = LossMetric("framing")
    metric.update(REFERENCE[:1], RENDERED)
    assert metric.coverage == (6, 6)


@pytest.mark.parametrize(
    ("frames", "told"),
    [
        (FRAMES.float(), r"float32 \(4, 3, 9, 16\): \(frames \* 255\)\.round\(\)\.byte\(\)$"),
        (FRAMES[0], r"uint8 \(3, 9, 16\)$"),
        (FRAMES.movedim(1, 3), r"uint8 \(4, 9, 16, 3\)$"),
        (FRAMES[:0], r"uint8 \(0, 3, 9, 16\)$"),
        (np.zeros((4, 3, 9, 16), np.uint8), "ndarray$"),
    ],
)
def test_what_is_no_frames_of_bytes_is_not_read(frames: Tensor, told: str) -> None:
    plan = Components.build(load_config()).plan("image")
    with pytest.raises(ValueError, match=r"^expected uint8 frames \(N, 3, H, W\), got " + told):
        clip_features(frames, plan)


@pytest.mark.parametrize(
    ("times", "came"),
    [
        ([0.0, 0.5], "got list"),
        (torch.zeros(1), r"got \(1,\)"),
        (torch.zeros(2), r"got \[0.0, 0.0\]"),
        (torch.tensor([0.0, torch.nan]), r"got \[0.0, nan\]"),
    ],
)
def test_times_of_a_clip_are_one_a_frame_and_increase(times: Any, came: str) -> None:
    plan = Components.build(load_config()).plan("image")
    with pytest.raises(ValueError, match=f"expected a tensor of the increasing times of 2 frames .s., {came}"):
        clip_features(torch.zeros(2, 3, 8, 8, dtype=torch.uint8), plan, times=times)


def test_a_movement_in_pixels_weighed_as_if_in_frame_widths_is_told() -> None:
    faithful = {"mode": "faithful"}
    total = TotalMetric({"camera_movement": faithful, "shot_size": faithful})
    with pytest.warns(UserWarning, match=r"camera_movement counts 64 times what its tolerance asks for"):
        total.update(REFERENCE, RENDERED)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        TotalMetric({"camera_movement": {**faithful, "weight": 40 / 64}}).update(REFERENCE, RENDERED)
        camera_language_metrics().update(REFERENCE, RENDERED)


def test_a_reference_that_shows_nobody_is_told() -> None:
    """What is left of its total is small: such a clip makes a mean better."""
    told = r"^reference: no person in any of 6 frames, .*leave such a clip out"
    with pytest.warns(UserWarning, match=told):
        camera_language_metrics().update(reference=without_person(REFERENCE), rendered=RENDERED)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for reference, rendered in ((lost(REFERENCE, 3), RENDERED), (REFERENCE, without_person(RENDERED))):
            camera_language_metrics().update(reference=reference, rendered=rendered)
        TotalMetric({"framing": {}}).update(REFERENCE[:0], RENDERED[:0])
        TotalMetric({"filmic_space": {}}).update(replace(REFERENCE, keypoints=None), RENDERED)  # nobody was looked for


def test_frames_of_two_shapes_are_told() -> None:
    width, height = REFERENCE.size
    wider = replace(RENDERED, size=(2 * width, height))
    with pytest.warns(UserWarning, match=rf"^render: its frames .*{2 * width}x{height} and {width}x{height}, are not"):
        camera_language_metrics().update(reference=REFERENCE, rendered=wider)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        TotalMetric({"framing": {}}).update(REFERENCE, replace(RENDERED, size=(2 * width, 2 * height)))
