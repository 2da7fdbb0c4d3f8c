"""The chart: fronts and curves by their definitions, and drawn from trials that were run."""

import shlex
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure

from cltransfer.bench import chart
from cltransfer.bench.chart import CHART_TIERS, SETTINGS, Point, Setting, chart_trials, hits, pareto, points, points_csv
from cltransfer.bench.chart_svg import _draw_points, write_chart
from cltransfer.bench.methods import METHODS
from cltransfer.bench.protocol import Tier
from cltransfer.bench.rows import run_trials
from cltransfer.config import presets


def _row(shot, evaluations, total):
    clip = {"shot": shot, "teacher": "room-0", "pupil": "room-0", "seed": 1, "frames": 8}
    return {**clip, "evaluations": evaluations, "total": total}


def test_a_front_holds_what_no_other_beats_in_both():
    costs, losses = [5.0, 1.0, 2.0, 3.0, 2.0], [0.1, 9.0, 4.0, 5.0, 6.0]
    front = pareto(costs, losses)
    beaten = {i for i in range(5) if any(costs[j] <= costs[i] and losses[j] <= losses[i] and j != i for j in range(5))}
    assert set(front) == set(range(5)) - beaten
    assert front == [1, 2, 0]


def test_a_clip_is_hit_by_the_cheapest_run_that_reaches_the_target():
    rows = [
        _row("pan", 10, 3.0),
        _row("pan", 50, 0.9),
        _row("pan", 90, 0.2),
        _row("zoom", 20, 1.0),
        _row("tilt", 20, 5.0),
    ]
    curve = hits("any", rows, 1.0)
    assert curve.evaluations == (20, 50)
    assert curve.share == pytest.approx((1 / 3, 2 / 3))
    assert (curve.least, curve.most) == (10, 90)


def test_a_point_is_the_mean_of_its_own_clips_and_the_share_that_did_not_fail():
    rows = [
        {**_row(shot, cost, total), "method": "fast", "options": [], "seconds": cost / 10, "failed_clip": failed}
        for shot, cost, total, failed in (("pan", 10, 0.3, False), ("zoom", 20, 0.6, False), ("tilt", 60, 9.0, True))
    ]
    other = {**rows[2], "options": ["lod=1.0"]}
    found = points((Setting("presets", "fast", "fast"),), [*rows, other])
    assert found == [Point("presets", "fast", 3, 30.0, 3.0, pytest.approx(3.3), 0.6, pytest.approx(2 / 3))]


def test_every_preset_and_every_method_has_its_point():
    own = {setting.method for setting in SETTINGS}
    assert own == {*METHODS}
    assert own >= {*presets()}


def test_settings_are_told_apart_by_name_within_their_family():
    names = [(s.family, s.label) for s in SETTINGS]
    assert len(set(names)) == len(names)
    assert {"presets", "baselines", "resolution", "level of detail", "CMA-ES, population", "CMA-ES, generations"} <= {
        s.family for s in SETTINGS
    }


def test_points_beside_one_another_are_all_named_and_no_name_lies_on_a_point():
    at = [(50.0, 1.0), (60.0, 1.0), (55.0, 1.02), (400.0, 3.0), (400.0, 3.0)]
    found = [Point("a ladder", f"setting {i}", 1, cost, cost, loss, loss, 1.0) for i, (cost, loss) in enumerate(at)]
    figure = Figure(figsize=(9.0, 7.4))
    _draw_points(figure, found)
    figure.canvas.draw()
    for ax in figure.axes[:2]:
        names = {text.get_text(): text.get_window_extent() for text in ax.texts}
        assert {"setting 0", "setting 1", "setting 3"} <= set(names)
        assert "setting 4" not in names
        for name, box in names.items():
            assert not any(box.contains(*ax.transData.transform(place)) for place in at)
            assert not any(box.overlaps(other) for label, other in names.items() if label != name)


def test_every_preset_is_named_and_no_name_lies_on_a_point():
    presets = {"fast": (19.8, 0.663), "balanced": (55.2, 0.635), "max": (94.5, 0.63), "paper": (957.0, 1.68)}
    sizes = {"96 px": (58.4, 0.709), "128 px": (50.7, 0.654), "224 px": (61.2, 0.724), "320 px": (61.2, 0.666)}
    rest = {"replay": (4.3, 13.6)}
    families = {"presets": presets, "resolution": sizes, "baselines": rest}
    found = [
        Point(family, label, 1, cost, cost, loss, loss, 1.0)
        for family, own in families.items()
        for label, (cost, loss) in own.items()
    ]
    figure = Figure(figsize=(9.0, 7.4))
    _draw_points(figure, found)
    figure.canvas.draw()
    ax = figure.axes[0]
    names = {text.get_text(): text.get_window_extent() for text in ax.texts}
    assert {*presets, *rest} < set(names) <= {*presets, *rest, *sizes}
    for box in names.values():
        around = box.padded(3)  # a point is as wide
        assert not any(around.contains(*ax.transData.transform((p.evaluations, p.total))) for p in found)


def test_the_chart_is_drawn_from_trials(tmp_path, command, monkeypatch):
    settings = (Setting("presets", "fast", "fast"), Setting("resolution", "48 px", "fast", ("search_side=48",)))
    tier = Tier(("pan",), (("room", "room"),), 1, 1, 2)
    monkeypatch.setattr("os.getloadavg", lambda: (0.0, 3.7, 0.0))
    rows = run_trials(chart_trials(settings, tier, (7,)), tmp_path / "rows")
    monkeypatch.setitem(CHART_TIERS, "smoke", tier)
    monkeypatch.setattr(chart, "SMOKE_SETTINGS", settings)
    words = ("bench", "chart", "--tier", "smoke", "--seed", 7, "--rows", tmp_path / "rows")
    said = command(*words, "--out", tmp_path / "verb" / "page.md")
    assert (said.code, said.err) == (0, "2 trials, 2 of them done before\n")
    assert said.out == points_csv(points(settings, rows))
    assert f"`cltransfer {shlex.join(map(str, words))} --out" in (tmp_path / "verb" / "page.md").read_text()
    settings = (*settings, Setting("a ladder", "its base", "fast"))  # lies where the preset lies
    found = points(settings, rows)
    assert [p.clips for p in found] == [1, 1, 1]
    assert found[0].total == rows[0]["total"]
    page = tmp_path / "docs" / "benchmarks.md"
    monkeypatch.setattr("os.getloadavg", lambda: (0.0, 1.7, 0.0))
    write_chart(rows, settings, tmp_path / "rows", page, "bench chart")
    for name in ("chart.svg", "hits.svg"):
        texts = [t.text for t in ElementTree.parse(page.parent / name).iter("{http://www.w3.org/2000/svg}text")]
        assert "evaluations a frame" in texts
        assert name == "hits.svg" or texts.count("fast") == 2
        assert "its base" not in texts
        assert (tmp_path / "rows" / name).read_bytes() == (page.parent / name).read_bytes()
    lines = points_csv(found).splitlines()
    assert len(lines) == 4
    front = pareto([p.evaluations for p in found], [p.total for p in found])
    assert [i for i, line in enumerate(lines[1:]) if line.split(",")[8] == "1"] == sorted(front)
    assert "](chart.svg)" in page.read_text()
    assert "load average 3.7 while measured;" in page.read_text()
