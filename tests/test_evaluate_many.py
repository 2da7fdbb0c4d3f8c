"""Whole folders: clips matched by name, nothing left out, intervals over clips, tables without NaN."""

import csv
import errno
import io
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from cltransfer.cli.evaluate import methods_of
from cltransfer.cli.slips import is_override
from cltransfer.clips.clip import write_video
from cltransfer.clips.clip_folder import left_over
from cltransfer.clips.open_clip import ASSUMED
from cltransfer.config import load_config
from cltransfer.config.options import RunConfig
from cltransfer.errors import InputError, ModelError, UsageError
from cltransfer.evaluate import evaluate
from cltransfer.evaluate_kept import ClipScore, Kept
from cltransfer.evaluate_many import bootstrap_t, evaluate_many, interval, notes_of, summarise, worst_of
from cltransfer.evaluate_table import clips_csv, methods_csv, methods_json, methods_latex, methods_markdown
from cltransfer.features import Features
from cltransfer.registry import EXTRACTORS, LOSSES
from cltransfer.report.data import ReportData
from cltransfer.testing import sample_cameras, sample_features
from cltransfer.trajectory import Trajectory

ROWS = [
    ClipScore("ours", "a", {"shot_size": 0.1, "filmic_space": None}, {"shot_size": 4, "filmic_space": 0}, 4),
    ClipScore("ours", "b", {"shot_size": 0.3, "filmic_space": None}, {"shot_size": 4, "filmic_space": 0}, 4),
    ClipScore("old_way", "a", {"shot_size": 0.4, "filmic_space": None}, {"shot_size": 4, "filmic_space": 0}, 4),
    ClipScore("old_way", "b", {"shot_size": 0.6, "filmic_space": None}, {"shot_size": 4, "filmic_space": 0}, 4),
]
MISSING = ClipScore("old_way", "c", reason="the method has no clip of this name")


def wall(seed: int, drift: int) -> torch.Tensor:
    random = torch.Generator().manual_seed(seed)
    picture = torch.nn.functional.interpolate(torch.rand(1, 3, 9, 40, generator=random), (48, 200), mode="bilinear")[0]
    return torch.stack([picture[:, :, i * drift : i * drift + 64] for i in range(4)]).mul(255).byte()


def folder_of(path: Path, **clips: torch.Tensor) -> Path:
    path.mkdir()
    for name, image in clips.items():
        write_video(path / f"{name}.mkv", image, torch.arange(len(image)).double() / 8, lossless=True)
    return path


def test_an_interval_holds_the_mean_and_narrows_with_more_clips() -> None:
    few, many = interval([0.1, 0.3, 0.2] * 2), interval([0.1, 0.3, 0.2] * 20)
    for found in (few, many):
        assert found.low < found.mean < found.high
    assert many.high - many.low < few.high - few.low
    assert interval([0.1, 0.3, 0.2] * 2) == few


@pytest.mark.parametrize("clips", [6, 10])
@pytest.mark.parametrize("skewed", [False, True])
def test_an_interval_over_few_clips_holds_the_truth(clips: int, skewed: bool) -> None:
    rng, held = np.random.default_rng(0), []
    for _ in range(400):
        found = interval((rng.gamma(2, 1, clips) if skewed else rng.normal(2, 1, clips)).tolist())
        held.append(found.low <= 2 <= found.high)
    assert np.mean(held) >= 0.92


def test_of_fewer_clips_there_is_no_interval_but_a_reason() -> None:
    found = interval([0.1, 0.3, 0.2, 0.5, 0.4])
    assert (found.mean, found.low, found.high) == (pytest.approx(0.3), None, None)
    assert found.reason == "too few clips for an interval: 5, expected 6 or more"
    assert interval([0.1, 0.3, 0.2, 0.5, 0.4, 0.6]).reason == ""
    rows = [ClipScore("a", str(i), {"framing": 0.1 * i}, {"framing": 4}, 4) for i in range(5)]
    assert methods_csv(summarise(rows)).splitlines()[1].endswith(f'"{found.reason}"')
    assert "[" not in methods_markdown(summarise(rows))


@pytest.mark.parametrize("values", [[0.1] * 6, [0.0] * 5 + [1.0], [0.3] * 7])
def test_clips_of_one_value_tell_nothing_of_others(values: list[float]) -> None:
    found = interval(values)
    assert (found.low, found.high, found.clips) == (None, None, len(values))
    assert found.reason == "too many clips have one value for an interval"


SKEWED = [0.002, 0.004, 0.003, 0.006, 0.002, 0.53]  # one clip of six is far worse


def test_no_interval_reaches_below_what_nothing_costs() -> None:
    low, high = bootstrap_t(np.array(SKEWED))
    assert low < 0
    assert (interval(SKEWED).low, interval(SKEWED).high) == (0.0, high)


def test_an_upper_end_that_no_clip_comes_near_is_told_to_be_none() -> None:
    high = bootstrap_t(np.array(SKEWED))[1]
    found = interval(SKEWED, worst=1.0)
    assert (found.low, found.high) == (0.0, None)
    assert found.reason == f"no upper end: {high:.3g} is more than it costs to lose it in every clip, 1"
    assert interval(SKEWED, worst=high).high == high
    assert interval(SKEWED, worst=0.5).high == high  # a clip is worse than losing the person


def test_an_end_that_is_not_known_is_a_dash_and_no_number() -> None:
    rows = [ClipScore("a", str(i), {"shot_size": SKEWED[i]}, {"shot_size": 4}, 4) for i in range(6)]
    summary = summarise(rows, worst=worst_of(load_config(), rows))
    assert "| 0.0912 [0.00, –] |" in methods_markdown(summary)
    (line,) = csv.DictReader(io.StringIO(methods_csv(summary)))
    assert (line["low"], line["high"], line["reason"][:12]) == ("0.0", "", "no upper end")


def test_losing_everything_costs_every_penalty_that_weighs_something_and_that_a_clip_can_be_charged() -> None:
    config = load_config(overrides=["losses={shot_size: {weight: 3.0}, framing: {weight: 0.0}}"])
    losses = config.build("losses")
    had = ClipScore("ours", "a", dict.fromkeys(losses, 0.1), dict.fromkeys(losses, 4), 4, had=tuple(losses))
    worst = worst_of(config, [had])
    assert {name: worst[name] for name in ("shot_size", "framing")} == {"shot_size": 1.0, "framing": 2**0.5}
    rest = load_config(overrides=["losses={shot_size: null, framing: null}"]).build("losses")
    charged = {name: loss.weight * loss.penalty for name, loss in rest.items()}
    assert worst["total"] == pytest.approx(3.0 + sum(charged.values()))
    flat = replace(had, clip="b", had=tuple(name for name in losses if name != "filmic_space"))
    assert worst_of(config, [flat, had]) == worst
    without = worst_of(config, [flat, MISSING])
    assert without["total"] == pytest.approx(worst["total"] - charged["filmic_space"])
    assert without["filmic_space"] == worst["filmic_space"]


@dataclass(frozen=True)
class InTheLight:
    """One person in frames that are bright, nobody in dark ones."""

    requires: tuple[str, ...] = ("image",)
    provides: tuple[str, ...] = ("keypoints", "subject")
    family: str = "image"

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        bright = now.require("image").mean((1, 2, 3)) > 0.2
        person = Features.concatenate([sample_features(0, 1)] * len(bright))
        keypoints = torch.where(bright[:, None, None], person.require("keypoints"), torch.nan)
        subject = bright[:, None, None].expand_as(now.require("image")[:, 0])
        return replace(now, keypoints=keypoints, subject=subject)


@pytest.fixture
def in_the_light() -> Iterator[RunConfig]:
    EXTRACTORS.register("in_the_light")(InTheLight)
    config = load_config()
    losses = {name: config.losses[name] for name in ("framing", "filmic_space")}
    yield replace(config, losses=losses, extractors={"in_the_light": {}})
    EXTRACTORS._classes.pop("in_the_light")


def test_of_six_clips_in_which_nobody_is_found_every_penalty_that_is_charged_counts(
    in_the_light: RunConfig, tmp_path: Path
) -> None:
    clips = {name: wall(seed, 2) // 2 + 127 for seed, name in enumerate("abcdef")}
    references = folder_of(tmp_path / "references", **clips)
    dark = folder_of(tmp_path / "dark", **{name: image // 8 for name, image in clips.items()})
    rows = evaluate_many(references, {"dark": dark}, in_the_light, folder=tmp_path / "kept")
    assert [(row.reason, row.defined["framing"], row.had) for row in rows] == [("", 0, ("framing",))] * 6
    framing = in_the_light.build("losses")["framing"]
    worst = worst_of(in_the_light, rows)
    assert worst["total"] == pytest.approx(framing.weight * framing.penalty)
    found = summarise(rows, worst=worst)["dark"]
    assert (found["framing"].mean, found["total"].mean) == (None, pytest.approx(worst["total"]))
    assert evaluate_many(references, {"dark": dark}, in_the_light, folder=tmp_path / "kept") == rows


def test_clips_without_a_value_are_counted_not_used() -> None:
    found = interval([0.2, None, 0.4, None])
    assert (found.mean, found.clips, found.of) == (pytest.approx(0.3), 2, 4)
    assert found.reason == "too few clips for an interval: 2, expected 6 or more; 2 clips have no value"
    assert interval([None]).mean is None
    assert interval([None, *map(float, range(6))]).reason == "1 clip has no value"
    assert interval([0.2]).low is None


def test_no_table_holds_a_nan() -> None:
    summary = summarise([*ROWS, MISSING])
    text = json.dumps(methods_json([*ROWS, MISSING], summary), allow_nan=False)
    assert json.loads(text)["methods"]["ours"]["filmic_space"]["mean"] is None
    for table in (clips_csv([*ROWS, MISSING]), methods_csv(summary), methods_markdown(summary), methods_latex(summary)):
        assert "nan" not in table.lower()


def test_the_best_is_bold_only_where_both_have_the_same_clips() -> None:
    assert "**0.200" in methods_markdown(summarise(ROWS))
    assert "**" not in methods_markdown(summarise([*ROWS, MISSING]))
    assert "(2/3)" in methods_markdown(summarise([*ROWS, MISSING]))


def test_neither_is_bold_where_two_are_equal() -> None:
    twins = [replace(row, method="theirs") for row in ROWS[:2]]
    assert "**" not in methods_markdown(summarise([*ROWS[:2], *twins]))


def test_none_is_bold_where_a_clip_failed_for_all_alike() -> None:
    failed = [ClipScore(method, "c", reason="no person") for method in ("ours", "old_way")]
    assert "**" not in methods_markdown(summarise([*ROWS, *failed]))


def test_a_few_frames_that_survived_are_never_the_best() -> None:
    few = replace(ROWS[0], means={"shot_size": 0.01}, defined={"shot_size": 1})
    table = methods_markdown(summarise([few, *ROWS[1:]]))
    assert "**" not in table
    assert "(5/8 frames)" in table
    assert methods_csv(summarise([few, *ROWS[1:]])).splitlines()[0].endswith("most_frames,seconds,most_seconds,reason")


def test_nobody_is_the_best_whose_movement_is_measured_over_shorter_steps() -> None:
    sparse = [replace(row, defined={"shot_size": 2}) if row.method != "ours" else row for row in ROWS]
    table = methods_markdown(summarise(sparse))
    assert "**" not in table
    assert "(4/8 frames)" in table


@pytest.mark.parametrize(("seconds", "bold"), [(4.0, True), (3.97, True), (2.0, False)])
def test_nobody_is_the_best_whose_as_many_frames_are_closer_together(seconds: float, bold: bool) -> None:
    rows = [replace(row, seconds=seconds if row.method == "ours" else 4.0) for row in ROWS]
    table = methods_markdown(summarise(rows))
    assert ("**0.200" in table) == bold
    assert ("(4.00/8.00 s)" in table) == (not bold)


def test_of_clips_that_end_early_as_many_frames_are_closer_together(mean_flow: tuple[str, ...], tmp_path: Path) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2))
    ends = {
        "whole": folder_of(tmp_path / "whole", a=wall(1, 3)),
        "half": folder_of(tmp_path / "half", a=wall(1, 3)[:3]),
    }
    rows = evaluate_many(references, ends, load_config(overrides=[*mean_flow, "frames=3"]))
    assert [row.frames for row in rows] == [3, 3]
    table = methods_markdown(summarise(rows))
    assert "**" not in table
    assert "(0.25/0.38 s)" in table


def test_frames_that_are_missing_of_one_clip_are_not_made_up_for_by_another() -> None:
    other = [
        ClipScore("a", "c1", {"framing": 0.01}, {"framing": 10}),
        ClipScore("a", "c2", {"framing": 0.03}, {"framing": 4}),
    ]
    swapped = [
        ClipScore("b", "c1", {"framing": 0.02}, {"framing": 4}),
        ClipScore("b", "c2", {"framing": 0.04}, {"framing": 10}),
    ]
    table = methods_markdown(summarise([*other, *swapped]))
    assert "**" not in table
    assert table.count("(14/20 frames)") == 2


def test_why_a_term_has_no_value_is_told_once() -> None:
    rows = [replace(row, lacking={"filmic_space": "no depth"}) for row in ROWS]
    assert summarise(rows)["ours"]["filmic_space"].reason == "2 clips have no value; no depth"


def test_latex_escapes_names() -> None:
    latex = methods_latex(summarise(ROWS))
    assert r"old\_way" in latex
    assert r"shot\_size" in latex
    assert latex.count("&") == 2 * 3
    assert latex.count(r"\\") == 3


def test_heads_have_the_unit_of_their_column() -> None:
    rows = [replace(row, units={"shot_size": "frame", "filmic_space": ""}) for row in ROWS]
    summary = summarise([*rows, MISSING])
    assert methods_latex(summary).splitlines()[2] == r"method & shot\_size [frame] & filmic\_space \\"
    assert [line["unit"] for line in csv.DictReader(io.StringIO(methods_csv(summary)))] == ["frame", ""] * 2


def test_no_name_breaks_a_table() -> None:
    summary = summarise([replace(row, method="a|b^c~d") if row.method == "ours" else row for row in ROWS])
    assert methods_markdown(summary).splitlines()[2].startswith(r"| a\|b^c~d |")
    assert r"a\textbar{}b\textasciicircum{}c\textasciitilde{}d & " in methods_latex(summary)


def test_every_clip_has_its_row_in_the_csv() -> None:
    rows = list(csv.DictReader(io.StringIO(clips_csv([*ROWS, MISSING]))))
    assert [row["clip"] for row in rows] == ["a", "b", "a", "b", "c"]
    assert rows[-1]["shot_size"] == ""
    assert rows[-1]["reason"] == MISSING.reason


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("=1+1", "'=1+1"), ("+1", "'+1"), ("-1+1", "'-1+1"), ("@SUM(A1)", "'@SUM(A1)"), ("＝1＋1", "'＝1＋1"),
        ("\t=1", "'\t'=1"), ("\r=1", "'\n'=1"), ("a\r=1", "a\n'=1"), ('=a,"b"\n', "'=a,\"b\"\n"),
        ("a;=1", "a;'=1"), ("a\t-1", "a\t'-1"), ('a; "=1"', "a; \"'=1\""), ("a;b=1", "a;b=1"),
    ],
)  # fmt: skip
def test_no_name_is_a_formula_and_every_number_stays_one(name: str, shown: str) -> None:
    rows = [
        ClipScore(name, name, {"offset": -0.5}, {"offset": 4}, 4, name),
        ClipScore("b", name, {"offset": -0.1}, {"offset": 4}, 4),
    ]
    clips = list(csv.DictReader(io.StringIO(clips_csv(rows), newline="")))
    assert [(clip["method"], clip["clip"], clip["reason"]) for clip in clips] == [
        (shown, shown, shown),
        ("b", shown, ""),
    ]
    assert [clip["offset"] for clip in clips] == ["-0.5", "-0.1"]
    methods = list(csv.DictReader(io.StringIO(methods_csv(summarise(rows)), newline="")))
    assert [(method["method"], method["mean"]) for method in methods] == [(shown, "-0.5"), ("b", "-0.1")]
    assert "\r" not in clips_csv(rows)


def test_of_a_run_the_kept_frames_are_scored_and_none_before_it_is_done(
    mean_flow: tuple[str, ...], tmp_path: Path
) -> None:
    folder_of(tmp_path / "references", a=wall(0, 1), b=wall(0, 1))
    for name in ("a", "b"):
        run = tmp_path / "runs" / name
        write_video(run / "video" / "frames.mkv", wall(0, 1), torch.arange(4).double() / 8, lossless=True)
        (run / "manifest.json").write_text('{"format": "cltransfer.run"}')
    (tmp_path / "runs" / "a" / "DONE").touch()
    runs = {"ours": tmp_path / "runs"}
    done, killed = evaluate_many(tmp_path / "references", runs, load_config(overrides=mean_flow))
    assert done.reason == ""
    assert "b: DONE: this run was not finished" in killed.reason


def test_a_score_of_a_run_that_was_kept_is_none_of_its_frames_at_other_times(
    mean_flow: tuple[str, ...], tmp_path: Path
) -> None:
    references, run = folder_of(tmp_path / "references", a=wall(0, 1)), tmp_path / "runs" / "a"
    write_video(run / "video" / "frames.mkv", wall(0, 1), torch.arange(4).double() / 8, lossless=True)
    (run / "manifest.json").write_text('{"format": "cltransfer.run"}')
    (run / "DONE").touch()
    scored = []
    for step in (0.125, 0.25):
        Trajectory(sample_cameras(0, 4), step * torch.arange(4).double()).save(run / "trajectory.json")
        runs, config = {"ours": tmp_path / "runs"}, load_config(overrides=mean_flow)
        scored += evaluate_many(references, runs, config, folder=tmp_path / "kept")
    assert [(row.reason, row.frames) for row in scored] == [("", 4), ("", 2)]


def test_folders_are_scored_clip_by_clip(command: Any, mean_flow: tuple[str, ...], tmp_path: Path) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2), b=wall(1, 2))
    same = folder_of(tmp_path / "same", a=wall(0, 2), b=wall(1, 2))
    other = folder_of(tmp_path / "other", a=wall(0, 6))
    said = command(
        "evaluate", references, f"same={same}", f"other={other}", *mean_flow, "--out", tmp_path / "out", "--json"
    )
    assert said.code == 0, said.err
    value = json.loads(said.out)
    assert value["methods"]["same"]["mean_flow"]["mean"] == 0
    assert value["methods"]["other"]["mean_flow"]["mean"] > 0
    assert value["methods"]["other"]["mean_flow"]["clips"] == 1
    assert [c["reason"] for c in value["clips"] if c["method"] == "other"] == [
        "",
        "the method has no clip of this name",
    ]
    written = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert written == ["clips.csv", "methods.csv", "methods.md", "methods.tex", "metrics.json", "scores.jsonl"]


def test_a_clip_that_is_a_link_out_of_its_folder_is_a_row_and_the_others_are_scored(
    command: Any, mean_flow: tuple[str, ...], tmp_path: Path
) -> None:
    references, elsewhere = (
        folder_of(tmp_path / name, a=wall(0, 2), b=wall(1, 2), c=wall(2, 2), d=wall(3, 2))
        for name in ("references", "elsewhere")
    )
    ours = folder_of(tmp_path / "ours", a=wall(0, 2), c=wall(2, 2))
    (ours / "b.mkv").symlink_to(elsewhere / "b.mkv")
    (ours / "d.mkv").symlink_to("d.mkv")  # to itself
    (references / "c.mkv").unlink()
    (references / "c.mkv").symlink_to(elsewhere / "c.mkv")
    said = command("evaluate", references, f"ours={ours}", *mean_flow, "--out", tmp_path / "out", "--json")
    assert said.code == 0, said.err
    clips = {clip["clip"]: clip["reason"] for clip in json.loads(said.out)["clips"]}
    assert clips["a"] == ""
    assert clips["d"] != ""
    for name, folder in (("b", ours), ("c", references)):
        assert clips[name].startswith(f"{folder / name}.mkv: is a link that leads out of its folder (a hard link ")


def test_a_clip_that_a_loss_fails_on_is_a_row_and_the_others_are_scored(
    mean_flow: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loss = LOSSES._classes["mean_flow"]
    measure = loss.__call__

    def careful(self: Any, reference: Features, rendered: Features) -> torch.Tensor:
        if rendered.require("flow")[:, 0].nanmean().abs() > 4:
            raise ArithmeticError("too fast")
        return measure(self, reference, rendered)

    monkeypatch.setattr(loss, "__call__", careful)
    references = folder_of(tmp_path / "references", a=wall(0, 2), b=wall(1, 2), c=wall(2, 2))
    ours = folder_of(tmp_path / "ours", a=wall(0, 2), b=wall(1, 6), c=wall(2, 2))
    rows = evaluate_many(references, {"ours": ours}, load_config(overrides=mean_flow))
    assert [bool(row.means) for row in rows] == [True, False, True]
    assert "it raised ArithmeticError: too fast" in rows[1].reason


def test_what_was_scored_before_a_kill_is_not_scored_again(
    mean_flow: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2), b=wall(1, 2))
    ours, config = folder_of(tmp_path / "ours", a=wall(0, 3), b=wall(1, 3)), load_config(overrides=mean_flow)
    scored = list[str]()

    def counted(reference: str, render: str, config: RunConfig) -> ReportData:
        scored.append(Path(render).stem)
        return evaluate(reference, render, config)

    monkeypatch.setattr("cltransfer.evaluate_many.evaluate", counted)
    first = evaluate_many(references, {"ours": ours}, config, folder=tmp_path / "out")
    kept = tmp_path / "out" / "scores.jsonl"
    kept.write_bytes(kept.read_bytes()[:-20])  # killed while the second was written
    assert evaluate_many(references, {"ours": ours}, config, folder=tmp_path / "out") == first
    assert scored == ["a", "b", "b"]
    evaluate_many(references, {"ours": ours}, replace(config, seed=5), folder=tmp_path / "out")
    assert scored[3:] == []  # the seed is that of the intervals
    with monkeypatch.context() as other:
        other.setattr("cltransfer.evaluate_kept.read_by", lambda: ["other packages"])
        evaluate_many(references, {"ours": ours}, config, folder=tmp_path / "out")
    evaluate_many(references, {"ours": ours}, replace(config, frames=3), folder=tmp_path / "out")
    assert scored[3:] == ["a", "b"] * 2  # otherwise
    (ours / "a.mkv").write_bytes((ours / "b.mkv").read_bytes())
    evaluate_many(references, {"ours": ours}, config, folder=tmp_path / "out")
    assert scored[7:] == ["a"]  # another clip
    kept.write_text("{}\n")
    with pytest.raises(InputError, match=r"scores\.jsonl: line 1: is no score"):
        evaluate_many(references, {"ours": ours}, config, folder=tmp_path / "out")


def test_a_score_that_cannot_be_kept_is_no_fault_of_its_clip(
    mean_flow: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    references, ours = folder_of(tmp_path / "references", a=wall(0, 2)), folder_of(tmp_path / "ours", a=wall(0, 3))

    def full(path: Path, value: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("cltransfer.evaluate_kept.keep", full)
    with pytest.raises(OSError, match="No space left"):
        evaluate_many(references, {"ours": ours}, load_config(overrides=mean_flow), folder=tmp_path / "out")


def test_a_loss_that_fails_on_every_clip_is_to_blame_and_not_the_folder(
    command: Any, mean_flow: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def bad(self: Any, reference: Features, rendered: Features) -> torch.Tensor:
        raise ArithmeticError("never")

    monkeypatch.setattr(LOSSES._classes["mean_flow"], "__call__", bad)
    references = folder_of(tmp_path / "references", a=wall(0, 2), b=wall(1, 2), c=wall(0, 2))
    ours = folder_of(tmp_path / "ours", a=wall(0, 2), b=wall(1, 2))
    said = command("evaluate", references, f"ours={ours}", *mean_flow, "--quiet")
    assert (said.code, said.err.count("\n")) == (4, 1)
    assert said.err.startswith("error: loss 'mean_flow': expected ")
    assert "it raised ArithmeticError: never" in said.err
    (ours / "b.mkv").write_bytes(b"nothing")  # and a clip that is at fault itself
    said = command("evaluate", references, f"ours={ours}", *mean_flow, "--quiet")
    assert (said.code, "expected one that can be scored, 3 failed" in said.err) == (3, True)


def test_without_a_network_no_clip_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_MODELS", "")
    folder_of(tmp_path / "references", a=wall(0, 2))
    with pytest.raises(ModelError, match="no such file"):
        evaluate_many(tmp_path / "references", {"same": tmp_path / "references"}, load_config())


def test_what_a_reader_should_know_of_the_clips_is_told(
    command: Any, mean_flow: tuple[str, ...], tmp_path: Path
) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2), b=wall(1, 2))
    for clip in ("a", "b"):
        (tmp_path / "ours" / clip).mkdir(parents=True)
        for i, rgb in enumerate(wall(0, 2)):
            assert cv2.imwrite(str(tmp_path / "ours" / clip / f"{i}.png"), rgb.permute(1, 2, 0).numpy())
    (tmp_path / "ours" / "b" / "times.json").write_text("[0, 0.5, 2, 4]")
    said = command(
        "evaluate", references, f"ours={tmp_path / 'ours'}", *mean_flow, "--quiet", "--out", tmp_path / "out"
    )
    assert said.code == 0, said.err
    assert f"note: ours, a: render: {ASSUMED}" in said.out.splitlines()
    first, second = json.loads((tmp_path / "out" / "metrics.json").read_text())["clips"]
    assert f"render: {ASSUMED}" in first["notes"]
    assert f"render: {ASSUMED}" not in second["notes"]


def test_clips_that_no_reference_has_the_name_of_are_told(
    command: Any, mean_flow: tuple[str, ...], tmp_path: Path
) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2))
    ours = folder_of(tmp_path / "ours", a=wall(0, 2), a_typo=wall(0, 2))
    said = command("evaluate", references, f"ours={ours}", *mean_flow, "--quiet", "--out", tmp_path / "out")
    note = "ours: a_typo is not scored: no reference of this name"
    assert f"note: {note}" in said.out.splitlines()
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["notes"] == [note]
    for name in "bcde":
        (ours / f"{name}.mkv").touch()
    more = "ours: a_typo, b, c and 2 more are not scored: no reference of this name"
    assert left_over(references, {"ours": ours, "same": references}) == [more]
    (ours / "f.m4v").touch()  # a clip as others are
    (ours / "a.mp5").touch()
    assert left_over(references, {"ours": ours}) == [
        more.replace("2 more", "3 more"),
        "ours: a.mp5 is not scored: no video by its suffix",
    ]


def test_a_note_on_several_clips_is_told_once_a_method() -> None:
    rows = [ClipScore(method, clip, notes=("dark",)) for method in ("ours", "theirs") for clip in ("a", "b")]
    assert notes_of([*rows, ClipScore("ours", "c", notes=("far",))]) == [
        "ours, 2 clips: dark",
        "theirs, 2 clips: dark",
        "ours, c: far",
    ]


def test_one_clip_against_a_folder_of_clips_is_a_usage_error(command: Any, tmp_path: Path) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2))
    said = command("evaluate", references, references / "a.mkv")
    assert (said.code, said.err.count("\n")) == (2, 1)


def test_a_method_that_is_called_as_a_key_is_told_so(command: Any, tmp_path: Path) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2))
    said = command("evaluate", references, f"lean={references}")
    told = "as the reference is one ('lean' is a key of the config: give the method another name)"
    assert (said.code, told in said.err) == (2, True), said.err


def test_an_override_is_none_of_the_methods_whatever_folders_there_are(
    mean_flow: tuple[str, ...], command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder_of(tmp_path / "references", a=wall(0, 2))
    folder_of(tmp_path / "ours", a=wall(0, 2))
    (tmp_path / "3").mkdir()
    for name in ("._a.mkv", "._poster.png"):
        (tmp_path / "references" / name).write_bytes(b"a Mac has been here")
    monkeypatch.chdir(tmp_path)
    words = [word.replace("filmic_space=null", "filmic_space=") for word in (*mean_flow, "frames=3", "--json")]
    said = command("evaluate", "references", "ours", *words)
    assert said.code == 0, said.err
    value = json.loads(said.out)
    assert list(value["methods"]) == ["ours"]
    assert [(clip["clip"], clip["frames"]) for clip in value["clips"]] == [("a", 3)]


def test_a_part_behind_a_folder_is_scored_of_each_clip_in_it(
    mean_flow: tuple[str, ...], command: Any, tmp_path: Path
) -> None:
    """Of two clips, where before all of them was scored into the same folder."""
    references = folder_of(tmp_path / "references", a=wall(0, 2), b=wall(1, 2))
    frames = []
    for part in ("", "#t=0.1", "#t=0.1,0.3"):
        words = (f"{references}{part}", f"ours={references}{part}", f"{references}#t=0.1")
        said = command("evaluate", *words, *mean_flow, "--json", "--out", tmp_path / "out")
        assert said.code == 0, said.err
        frames.append([(clip["method"], clip["frames"]) for clip in json.loads(said.out)["clips"]])
    names = ("ours", "references") * 2
    assert frames == [list(zip(names, counts)) for counts in ((4, 3, 4, 3), (3,) * 4, (2,) * 4)]


def test_a_person_behind_a_folder_is_asked_of_each_clip_in_it(mean_flow: tuple[str, ...], tmp_path: Path) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2), b=wall(1, 2))
    config = load_config(overrides=mean_flow)
    for row in evaluate_many(f"{references}#person=1", {"ours": references}, config):
        assert "#person: no extractor in use tells persons apart" in row.reason
        assert f"{row.clip}.mkv" in row.reason


def test_a_part_of_one_clip_is_none_of_a_folder(tmp_path: Path) -> None:
    folder = str(folder_of(tmp_path / "references", a=wall(0, 2)))
    clip = f"{folder}/a.mkv#t=0,1"
    assert methods_of(clip, clip, []) == ({}, [])
    with pytest.raises(UsageError, match="holds clips, expected one"):
        methods_of(clip, f"{folder}#t=0,1", [])


def test_images_of_a_method_play_as_fast_as_is_said_behind_its_folder(
    mean_flow: tuple[str, ...], command: Any, tmp_path: Path
) -> None:
    """Four at 8 a second, as the reference plays them, go together one by one; scored twice into one folder."""
    references, picture = folder_of(tmp_path / "references", a=wall(0, 2)), wall(0, 2)
    (tmp_path / "theirs" / "a").mkdir(parents=True)
    for i in range(4):
        cv2.imwrite(str(tmp_path / "theirs" / "a" / f"{i}.png"), picture[i].permute(1, 2, 0).numpy()[..., ::-1])
    frames = []
    for behind in ("", "#fps=8"):
        words = (references, f"{tmp_path / 'theirs'}{behind}", *mean_flow, "--json", "--out", tmp_path / "out")
        said = command("evaluate", *words)
        assert said.code == 0, said.err
        (clip,) = json.loads(said.out)["clips"]
        assert (clip["method"], f"render: {ASSUMED}" in clip["notes"]) == ("theirs", not behind)
        frames.append(clip["frames"])
    assert frames == [2, 4]


@pytest.mark.parametrize("argument", [f"losses={{shot_size: {{weight: 1.0}}}}{' ' * 300}", f"seed=1{' ' * 300}"])
def test_an_override_may_be_longer_than_the_name_of_a_file(argument: str, tmp_path: Path) -> None:
    folder = str(folder_of(tmp_path / "references", a=wall(0, 2)))
    assert is_override(argument)
    assert methods_of(folder, f"ours={folder}", [argument]) == ({"ours": folder}, [argument])
    assert methods_of(f"{folder}/a.mkv", argument, []) == ({}, [])


def test_a_comparison_in_which_every_clip_failed_is_written_and_ends_with_the_first_reason(
    mean_flow: tuple[str, ...], command: Any, tmp_path: Path
) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2), b=wall(0, 2))
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours" / "a.mkv").write_bytes(b"nothing")
    words = (references, f"ours={tmp_path / 'ours'}", *mean_flow, "--quiet", "--out", tmp_path / "out")
    said = command("evaluate", *words)
    assert (said.code, said.err.count("\n")) == (3, 1)
    assert "2 failed; the first: " in said.err
    assert "a.mkv: video: cannot be decoded" in said.err
    assert "ours, b: the method has no clip of this name" in said.out
    assert len(json.loads((tmp_path / "out" / "metrics.json").read_text())["clips"]) == 2


def test_of_folders_the_seed_of_the_intervals_is_looked_at_and_no_size(command: Any, tmp_path: Path) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2))
    said = command("evaluate", references, f"ours={references}", "seed=1", "output_side=1280")
    assert said.code == 2
    assert "error: output_side: changes nothing of the scores, expected a key" in said.err


def test_a_folder_of_a_method_that_is_not_there_is_named(command: Any, tmp_path: Path) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2))
    for words in ((references, "theirs=thiers"), (references, f"ours={references}", "theirs=thiers")):
        said = command("evaluate", *words)
        assert (said.code, said.err.count("\n")) == (2, 1)
        assert "theirs=thiers: no such folder, and 'theirs' is no key of the config" in said.err


def test_a_picture_among_the_clips_is_told_to_make_them_one(command: Any, tmp_path: Path) -> None:
    references = folder_of(tmp_path / "references", a=wall(0, 2))
    assert cv2.imwrite(str(references / "poster.png"), wall(0, 2)[0].permute(1, 2, 0).numpy())
    for reference, what in ((references, "holds poster.png"), (references / "a.mkv", "is a file")):
        said = command("evaluate", reference, f"ours={references}")
        assert (said.code, said.err.count("\n")) == (2, 1)
        assert f"{what}, so it is taken for one clip" in said.err


def test_a_clip_that_failed_is_tried_again(tmp_path: Path) -> None:
    Kept(tmp_path / "scores.jsonl", "", {}).keep("k", ClipScore("ours", "a", reason="out of memory"))
    assert not (tmp_path / "scores.jsonl").exists()


def test_an_interval_is_that_of_resampled_t_by_hand() -> None:
    values = np.random.default_rng(0).normal(0, 1, 6)
    drawn = np.random.default_rng(0).choice(values, (2000, 6))
    t = (drawn.mean(1) - values.mean()) / drawn.std(1, ddof=1)
    high, low = np.quantile(t, (0.025, 0.975), method="inverted_cdf")
    spread = values.std(ddof=1)
    np.testing.assert_allclose(bootstrap_t(values), [values.mean() - low * spread, values.mean() - high * spread])
