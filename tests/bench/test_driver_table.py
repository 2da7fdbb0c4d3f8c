"""The driver bench's table and chart: what they say of planted clips."""

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from cltransfer.bench.driver import Clip
from cltransfer.bench.driver_chart import write_driver_chart
from cltransfer.bench.driver_table import HEADER, comparable, summary, write_driver
from cltransfer.bench.methods import ON_ROBUST_LOSSES

NAN = float("nan")
CLIP = Clip("fast", "cross", "pan", 1, 0.5, 0.6, 12.0, 2.0, NAN, NAN, NAN, 0.1, 0.2, 0.02, 0.01)


def test_presets_are_held_against_the_paper_on_the_same_clips_only() -> None:
    paper = replace(CLIP, preset="paper", total=1.0, evaluations=960.0)
    clips = [CLIP, replace(CLIP, shot="zoom", total=2.5), paper, replace(CLIP, shot="orbit", total=9.0)]
    clips += [replace(paper, shot="zoom", total=2.0, judged=0.3)]
    row = dict(zip(HEADER, summary(clips)[0]))
    assert row["at or below paper"] == "1 of 2"
    assert row["share of paper's mean"] == "1.00"
    assert row["total, mean"] == "4.000"
    assert row["judged, mean"] == "0.600"
    assert row["judged at or below"] == "1 of 2"
    assert row["judged share"] == "1.33"
    assert row["position [heights]"] == ""
    assert row["cost of the path"] == "+0.100"
    assert row["jerk before / after / of the reference"] == "0.2000 / 0.0200 / 0.0100"


def test_seconds_are_those_of_the_clip_in_the_middle() -> None:
    clips = [replace(CLIP, seed=seed, seconds=seconds) for seed, seconds in enumerate((1.0, 2.0, 9.0))]
    assert dict(zip(HEADER, summary(clips)[0]))["seconds a clip"] == "2.00"


def test_clips_too_short_for_a_jerk_have_none_in_the_table() -> None:
    row = dict(zip(HEADER, summary([replace(CLIP, shaken=NAN, smooth=NAN, true=NAN)])[0]))
    assert row["jerk before / after / of the reference"] == "– / – / –"


def test_a_camera_is_found_where_place_turn_and_lens_are_right() -> None:
    right = replace(CLIP, target="self", position=0.005, rotation=0.09, focal=-0.004)
    wrong = [replace(right, position=0.007), replace(right, rotation=0.11), replace(right, focal=-0.006)]
    row = dict(zip(HEADER, summary([right, *wrong, replace(right, position=NAN)])[0]))
    assert row["camera found"] == "1 of 4"  # of one it is not known
    assert (row["position [heights]"], row["rotation [deg]"], row["focal [%]"]) == ("0.0050", "0.0900", "0.4000")
    assert dict(zip(HEADER, summary([CLIP])[0]))["camera found"] == ""


def test_what_older_clips_do_not_tell_is_left_out_of_the_means() -> None:
    old = replace(CLIP, seed=2, judged=NAN, true=NAN)
    papers = [replace(CLIP, preset="paper", seed=seed, judged=0.9) for seed in (1, 2)]
    row = dict(zip(HEADER, summary([CLIP, old, *papers])[0]))
    assert (row["judged, mean"], row["judged at or below"], row["at or below paper"]) == ("0.600", "1 of 1", "2 of 2")
    assert row["jerk before / after / of the reference"] == "0.2000 / 0.0200 / 0.0100"


def test_a_preset_of_other_losses_is_held_against_the_paper_by_the_judge_alone() -> None:
    other = replace(CLIP, preset="jaws_clean", total=0.1)
    row = dict(zip(HEADER, summary([other, replace(CLIP, preset="paper", judged=1.2)])[0]))
    assert (row["at or below paper"], row["share of paper's mean"]) == ("", "")
    assert (row["judged at or below"], row["judged share"]) == ("1 of 1", "0.50")


def test_totals_of_the_same_losses_in_another_mode_or_of_another_weight_are_not_compared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert [comparable(preset) for preset in ("balanced", "five_adam", "jaws_clean")] == [True, True, False]
    for same in ((), (*ON_ROBUST_LOSSES, "losses.framing.weight=5")):  # as printed, and with a weight of its own
        monkeypatch.setattr("cltransfer.bench.driver.ON_ROBUST_LOSSES", same)
        assert not comparable("balanced")
        assert comparable("paper")


def test_more_presets_than_colours_are_drawn(tmp_path: Path) -> None:
    names = ("fast", "balanced", "max", "five_adam", "jaws_clean", "jaws_code", "paper")
    write_driver_chart([replace(CLIP, preset=name) for name in names], tmp_path)
    assert ">paper</text>" in (tmp_path / "driver.svg").read_text()


def test_a_preset_that_ran_on_one_target_only_is_in_the_legend(tmp_path: Path) -> None:
    write_driver_chart([replace(CLIP, target="self"), CLIP, replace(CLIP, preset="paper")], tmp_path)
    assert ">paper</text>" in (tmp_path / "driver.svg").read_text()


def test_the_page_tells_the_load_that_its_rows_were_measured_under(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.getloadavg", lambda: (0.0, 1.7, 0.0))
    write_driver([{**asdict(CLIP), "load": 3.7}], tmp_path / "page.md", "cltransfer bench driver")
    assert "load average 3.7 while measured;" in (tmp_path / "page.md").read_text()
