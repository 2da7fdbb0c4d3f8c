"""What nothing measures is told before the first trial, with what would measure it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.ablate import pool
from cltransfer.ablate.measurable import check_measurable, unmeasured
from cltransfer.ablate.outcome import Outcome
from cltransfer.ablate.read import ablations, read_sweep
from cltransfer.ablate.run import Options, ablate
from cltransfer.errors import UsageError
from cltransfer.features import Features
from cltransfer.registry import EXTRACTORS, LOSSES

SweepFile = Callable[..., Path]
ROW = "{as it is: {}, moody: {losses: {mood: {}}, extractors: {read_mood: {}}}}"


@dataclass(frozen=True)
class ReadMood:
    """How high the person's joints stand, as an extractor of pixels and of scenes."""

    requires: ClassVar[tuple[str, ...]] = ("keypoints",)
    provides: ClassVar[tuple[str, ...]] = ("mood",)
    family: ClassVar[str] = "both"

    def __call__(self, features: Features, before: Features | None) -> Features:
        return features.having("mood", features.require("keypoints")[:, 0, 1])


@dataclass(frozen=True)
class Mood:
    """How far apart they stand."""

    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("mood",)
    unit: ClassVar[str] = "px"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return torch.abs(reference.require("mood") - rendered.require("mood"))


@pytest.fixture(autouse=True)
def mood(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LOSSES._classes, "mood", Mood)
    monkeypatch.setitem(EXTRACTORS._classes, "read_mood", ReadMood)


@pytest.mark.parametrize("written", ["metrics: {losses: {mood: {}}}", ""])
def test_a_loss_that_the_metrics_name_and_cannot_feed_is_refused_before_the_first_trial(
    written: str, sweep_file: SweepFile, tmp_path: Path
) -> None:
    path = sweep_file(ROW, written)
    sweep = read_sweep(str(path), [] if written else ["metrics.losses.mood={}"])
    with pytest.raises(UsageError) as caught:
        ablate(sweep, Options(tmp_path / "out"))
    error = caught.value
    assert (error.where, error.field) == (str(path) if written else "command line", "metrics.losses.mood")
    assert error.reason == "needs 'mood', which nothing gives in the metrics"
    assert error.hint == "add `metrics: {extractors: {read_mood: {}}}`, or leave it out"
    assert not (tmp_path / "out").exists()


def test_a_loss_whose_extractor_the_metrics_have_is_measured(sweep_file: SweepFile) -> None:
    sweep = read_sweep(str(sweep_file(ROW, "metrics: {losses: {mood: {}}, extractors: {read_mood: {}}}")))
    assert (check_measurable(sweep), unmeasured(sweep)) == ([], [])


def test_what_feeds_an_extractor_must_be_given_too(sweep_file: SweepFile) -> None:
    joints = "extractors: {read_mood: {}, scene_joints: null, pose_blazepose: null}"
    sweep = read_sweep(str(sweep_file(ROW, f"metrics: {{losses: {{mood: {{}}}}, {joints}}}")))
    with pytest.raises(UsageError, match=r"mood: needs 'mood', which nothing gives in the metrics \(add an extractor"):
        check_measurable(sweep)


def test_a_loss_that_the_metrics_have_unnamed_is_told_with_what_a_row_feeds_it_by(sweep_file: SweepFile) -> None:
    """A row may feed it that the metrics do not: that is no mistake in what they name."""
    rows = "{as it is: {losses: {mood: null}}, moody: {extractors: {read_mood: {}}}}"
    sweep = read_sweep(str(sweep_file(rows)), ["losses.mood.weight=2"])
    (told,) = check_measurable(sweep)
    assert told == (
        "mood is not measured: it needs 'mood', which nothing gives in the metrics; "
        "`metrics: {extractors: {read_mood: {}}}` does"
    )


def test_a_loss_of_a_row_that_the_metrics_lack_is_told_with_its_extractor(sweep_file: SweepFile) -> None:
    sweep = read_sweep(str(sweep_file(ROW)))
    assert unmeasured(sweep, str.upper) == [
        "MOODY: MOOD is not measured; `metrics: {losses: {mood: {}}, extractors: {read_mood: {}}}` measures it in "
        "every row, and adds it to the total"
    ]


@pytest.mark.parametrize(("rows", "who"), [(2, "losses.mood.weight=1; losses.mood"), (4, "4 rows, as losses")])
def test_a_loss_of_many_rows_is_told_in_one_line(rows: int, who: str, tmp_path: Path) -> None:
    weights = list(range(1, rows + 1))
    (tmp_path / "grid.yaml").write_text(f"axes: {{losses.mood.weight: {weights}, extractors.read_mood: [{{}}]}}\n")
    (line,) = unmeasured(read_sweep(str(tmp_path / "grid.yaml")))
    assert line.replace(", extractors.read_mood={}", "").startswith(who)


def test_what_is_not_measured_is_told_before_the_first_trial_and_not_again(
    sweep_file: SweepFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    told: list[int] = []

    def failed(trials: list[object], job: object, workers: int) -> list[Outcome]:
        told.append(sum("is not measured" in record.message for record in caplog.records))
        return [Outcome(t.key, t.row, t.case, failed="not run") for t in trials]  # type: ignore[attr-defined]

    monkeypatch.setattr(pool, "_by_processes", failed)
    sweep = read_sweep(str(sweep_file(ROW)))
    with caplog.at_level(logging.WARNING, "cltransfer"):
        ablate(sweep, Options(tmp_path / "out"))
        assert told == [1]
        ablate(sweep, Options(tmp_path / "out"))
    assert sum("is not measured" in record.message for record in caplog.records) == 1


@pytest.mark.parametrize("name", ablations())
def test_what_shipped_files_measure_can_be_measured(name: str) -> None:
    assert check_measurable(read_sweep(name)) == []
