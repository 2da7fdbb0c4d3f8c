"""From trials to rows to verdicts to a page."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cltransfer.bench.methods import config_text
from cltransfer.bench.section import table
from cltransfer.bench.stress.bench import TIERS, StressBench, run_bench, write_stress
from cltransfer.bench.stress.case import Film
from cltransfer.bench.stress.filming import faster
from cltransfer.bench.stress.sheet import trials_csv
from cltransfer.bench.stress.trial import STRESSORS, StressTrial, run_stress
from cltransfer.bench.stress.verdicts import HEADER, breakdown_point, stricter, summary, verdicts
from cltransfer.errors import UsageError

CLIP = ("push_in", "plaza-2", "room-3", 1)


def row(level: int, failed: bool, total: float, method: str = "a", **terms: float) -> dict[str, Any]:
    return {
        "method": method,
        "stressor": "turned_view" if level else "",
        "level": level,
        "frames": 6,
        "failed": failed,
        "total": total,
        "totals": [total - 0.5, total, total + 0.5],
        "terms": {"framing": terms.get("framing", total), "shot_size": terms.get("shot_size"), "space": 0.0},
    }


def made_up() -> list[dict[str, Any]]:
    """Two clips a level: from level 3 on one of them fails, from level 4 on both."""
    return [
        row(level, failed=level >= 3 + clip, total=1.0 + level + clip, framing=0.1, shot_size=1.0 * level)
        for level in range(6)
        for clip in range(2)
    ]


def test_a_verdict_says_when_how_badly_how_unevenly_and_why() -> None:
    (verdict,) = verdicts(made_up())
    assert verdict.success == (1.0, 1.0, 1.0, 0.5, 0.0, 0.0)
    assert verdict.breakdown == 3.0
    assert verdict.worst_tenth == 7.0
    assert verdict.spread == pytest.approx(0.5)
    assert verdict.growth == pytest.approx(1.0)
    assert verdict.grown == "shot_size"
    assert verdict.totals == (1.5, 2.5, 3.5, 4.5, 5.5, 6.5)
    assert verdict.area == pytest.approx(0.5)
    told = dict(zip(HEADER, summary([verdict])[0], strict=True))
    assert (told["area"], told["breakdown"]) == ("0.50", "3.0, 90 degrees")


def test_a_stricter_definition_breaks_what_was_poor_all_along() -> None:
    good = [{**row(level, failed=False, total=1.0), "random_total": 10.0} for level in range(6)]
    poor = [
        {**row(level, failed=False, total=2.2 + 0.2 * level, method="b"), "random_total": 10.0} for level in range(6)
    ]
    told = {cells[0]: cells[1:] for cells in stricter([*good, *poor], "a")}
    assert told["50 % of random"] == ["b", "0", "0", "1", "0", "1 of 1"]
    assert told["25 % of random"] == ["b", "1", "0", "0", "0", "1 of 1"]
    assert told["20 % of random"] == ["b", "1", "1", "0", "0", "1 of 1"]


def test_what_has_not_changed_has_not_grown() -> None:
    (verdict,) = verdicts([row(level, failed=False, total=1.0) for level in range(6)])
    assert verdict.grown == ""
    assert summary([verdict])[0][-1] == "none"


def test_a_breakdown_at_a_level_is_explained_by_that_level() -> None:
    rows = [
        row(level, failed=level >= 3, total=1.0, framing=float(level == 2), shot_size=9.0 * (level > 3))
        for level in range(6)
    ]
    assert verdicts(rows)[0].breakdown == 2.5
    rows = [{**r, "failed": r["level"] >= 3 and i % 2 == 0} for i, r in enumerate(r for r in rows for _ in range(2))]
    (verdict,) = verdicts([{**r, "terms": {**r["terms"], "framing": float(r["level"] == 3)}} for r in rows])
    assert (verdict.breakdown, verdict.grown) == (3.0, "framing")


def test_a_stressor_is_held_against_calm_clips_of_its_own_length() -> None:
    longer = {**row(0, failed=False, total=50.0), "frames": 12}
    assert verdicts([*made_up(), longer])[0].totals[0] == 1.5


@pytest.mark.parametrize("name", ["fast_motion", "flipped_yaw"])
def test_the_levels_of_a_count_of_frames_differ_on_the_clips_they_are_run_on(name: str) -> None:
    trials = StressBench(("replay",), (name,), frames=6).trials()
    assert {trial.frames for trial in trials} == {12}
    levels = STRESSORS[name].levels
    counts = [faster(Film(12, (64, 36)), v).frames if name == "fast_motion" else round(12 * v) for v in levels]
    assert len(set(counts)) == 5


def test_a_term_that_the_reference_lacks_breaks_nothing() -> None:
    rows = [{**r, "terms": {**r["terms"], "space": None}} for r in made_up()]
    assert verdicts(rows)[0].grown == "shot_size"


def test_a_method_that_was_not_run_at_every_level_has_no_verdict() -> None:
    assert verdicts([*made_up(), row(0, False, 1.0, method="b")])[0].method == "a"
    assert len(verdicts([*made_up(), row(0, False, 1.0, method="b")])) == 1


def test_never_failing_has_no_breakdown_and_failing_without_stress_has_it_at_none() -> None:
    assert breakdown_point([1.0, 1.0, 0.9, 0.8, 0.7, 0.6]) is None
    assert breakdown_point([0.4, 1.0, 1.0, 1.0, 1.0, 1.0]) == 0.0


def test_an_unstressed_replay_succeeds_and_one_from_behind_never_does() -> None:
    calm = run_stress(StressTrial("replay", "", 0, *CLIP, 3))
    behind, again = (run_stress(StressTrial("replay", "turned_view", 5, *CLIP, 3)) for _ in range(2))
    assert again == behind
    assert not calm["failed"]
    assert behind["failed"]
    assert behind["terms"]["camera_angle"] > calm["terms"]["camera_angle"] + 5
    assert calm["random_total"] == behind["random_total"]


def test_a_search_beside_the_person_s_double_ends_far_below_random_views() -> None:
    found = run_stress(StressTrial("fast", "second_person", 3, *CLIP, 2))
    assert len(found["totals"]) == 2
    assert found["total"] < 0.5 * found["random_total"]


def test_rows_on_disk_are_not_run_again_and_make_a_page(
    tmp_path: Path, command: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.getloadavg", lambda: (0.0, 3.7, 0.0))
    bench = replace(TIERS["smoke"], methods=("replay",), stressors=("nearer_view",), seeds=(1,))
    first = run_bench(bench, tmp_path)
    told: list[str] = []
    again = run_bench(bench, tmp_path, told=told.append)
    assert told == ["6 trials, 6 of them done before"]
    assert again == first
    page = tmp_path / "page.md"
    monkeypatch.setattr("os.getloadavg", lambda: (0.0, 1.7, 0.0))
    write_stress(again, page, "cltransfer bench stress")
    charts = [tmp_path / "stress.svg", tmp_path / "stress_totals.svg"]
    drawn = [chart.read_bytes() for chart in charts]
    assert all(b"nearer view" in chart for chart in drawn)
    assert "| nearer_view | replay |" in page.read_text()
    assert "load average 3.7 while measured;" in page.read_text()
    listed = list(csv.DictReader((tmp_path / "stress.csv").open()))
    assert [(int(line["level"]), line["failed"]) for line in listed] == [
        (r["level"], str(int(r["failed"]))) for r in again
    ]
    assert [float(line["total"]) for line in listed] == pytest.approx([r["total"] for r in again], rel=1e-4)
    assert listed[0]["stressor"] == ""
    write_stress(again, page, "cltransfer bench stress")
    assert [chart.read_bytes() for chart in charts] == drawn
    words = ("bench", "stress", "--tier", "smoke", "--method", "replay", "--stressor", "nearer_view", "--seed", 1)
    said = command(*words, "--rows", tmp_path, "--out", tmp_path / "verb.md")
    assert (said.code, said.err) == (0, told[0] + "\n")
    assert said.out == "\n".join(table(HEADER, summary(verdicts(first)))) + "\n"
    made = (tmp_path / "verb.md").read_text()
    assert "Made by `cltransfer bench stress --tier smoke " in made
    assert made.partition(" --tier")[0] == page.read_text().partition("`.")[0]
    said = command(*words, "--rows", tmp_path, "--out", tmp_path / "verb.md", "floaters=drop")
    assert (said.code, said.err.splitlines()[0]) == (0, "6 trials, 0 of them done before")  # of another config
    assert "Run with floaters=drop over every method's own config." in (tmp_path / "verb.md").read_text()


def test_a_trial_is_a_line_with_why_its_frames_failed() -> None:
    made = {
        **row(2, failed=True, total=12.3456789),
        "shot": "orbit",
        "reasons": {"joints": 3, "subject": 1},
        "value": 45.0,
    }
    (line,) = csv.DictReader(io.StringIO(trials_csv([made])))
    assert (line["total"], line["failed"], line["reasons"], line["value"]) == (
        "12.346",
        "1",
        "joints:3 subject:1",
        "45",
    )


def test_the_config_of_many_trials_is_composed_once_a_clip() -> None:
    config_text.cache_clear()
    bench = replace(TIERS["standard"], methods=("replay",), seeds=(1, 2))
    assert len({trial.key for trial in bench.trials()}) == len(bench.trials()) > 100
    assert config_text.cache_info().misses == 2


def test_tiers_say_what_they_run() -> None:
    standard = TIERS["standard"].trials()
    assert len(standard) == (2 + 5 * len(STRESSORS)) * 4 * 3
    assert len({trial.key for trial in standard[:9]}) == 9


def test_of_an_option_that_is_set_twice_the_last_holds() -> None:
    tier = TIERS["standard"]
    assert tier.options == ("adam.iterations=10", "adam.rate=0.1")
    own = tier.under(("adam.iterations=40", "adam.rate=0.025", "floaters=keep"))
    assert own.options == ("adam.iterations=40", "adam.rate=0.025", "floaters=keep")


def test_a_breakdown_is_told_in_whole_units() -> None:
    rows = [row(level, failed=level > 3 and i > 0, total=1.0) for level in range(6) for i in range(3)]
    (verdict,) = verdicts(rows)
    assert dict(zip(HEADER, summary([verdict])[0]))["breakdown"] == "3.8, 124 degrees"


def test_an_unknown_stressor_is_one_line() -> None:
    with pytest.raises(UsageError, match="no such stressor"):
        StressTrial("replay", "rain", 1, *CLIP, 2)
    with pytest.raises(UsageError, match=r"stressor .rain.: no such stressor .known: turned_view, "):
        StressBench(stressors=("rain",)).trials()
    with pytest.raises(ValueError, match="level must be"):
        StressTrial("replay", "pruned", 0, *CLIP, 2)
