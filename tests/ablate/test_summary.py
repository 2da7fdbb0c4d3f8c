"""What the rows come to: bootstrap intervals, coverage, failures, and differences on shared cases only."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from cltransfer.ablate.outcome import Case, Metric, Outcome
from cltransfer.ablate.summary import alike, summarise
from cltransfer.ablate.tables import differences_table, directions_table, to_csv, values_table
from cltransfer.paired import wilcoxon_p
from cltransfer.report.tables import to_latex, to_markdown


def outcome(row: str, seed: int, size: float | None, defined: int = 4, reference: str = "drawn:orbit") -> Outcome:
    case = Case("courtyard", reference, seed)
    metrics = {"shot_size": Metric(size, "frame", defined, ""), "total": Metric(1.0, "", 4, "")}
    return Outcome(f"{row}{seed}", row, case, "", metrics, frames=4, evaluations=40, seconds=2.0)


def failed(row: str, seed: int) -> Outcome:
    return Outcome(f"{row}{seed}", row, Case("courtyard", "drawn:orbit", seed), failed="a & b: no | person_found")


def test_rows_that_rounding_alone_tells_apart_do_not_differ() -> None:
    found = [outcome("full", seed, 0.3) for seed in range(6)] + [outcome("less", seed, 0.1 + 0.2) for seed in range(6)]
    difference = summarise(["full", "less"], found)[1].metrics["shot_size"].difference
    assert difference is not None
    assert (difference.mean, difference.nonzero, difference.p, difference.certain) == (0.0, 0, 1.0, False)


def test_differences_pair_the_cases_and_leave_out_what_one_side_lacks() -> None:
    found = [outcome("full", 0, 0.1), outcome("full", 1, 0.5), outcome("full", 2, None, 0), outcome("full", 3, 0.7)]
    found += [outcome("less", 0, 0.2), outcome("less", 1, 0.6), outcome("less", 2, 0.9), failed("less", 3)]
    full, less = summarise(["full", "less"], reversed(found))
    assert full.metrics["shot_size"].difference is None
    difference = less.metrics["shot_size"].difference
    assert difference is not None
    assert difference.count == 2
    assert difference.mean == pytest.approx(0.1)
    assert not difference.certain  # of two
    assert full.metrics["shot_size"].value.count == 3
    assert (full.metrics["shot_size"].defined, full.metrics["shot_size"].frames) == (12, 16)
    assert (less.trials, less.failed) == (4, 1)
    assert (less.evaluations, less.seconds) == (10, 2)


def test_evaluations_a_frame_are_the_mean_of_the_trials_however_long_they_are() -> None:
    long = replace(outcome("full", 0, 0.1), frames=12, evaluations=60)
    assert summarise(["full"], [long, replace(outcome("full", 1, 0.1), evaluations=44)])[0].evaluations == 8


def test_seeds_of_a_fixed_reference_are_one_observation_and_those_that_draw_it_many() -> None:
    values = {"drawn:orbit": 0.2, "clip.mp4": 0.4, "builtin:orbit": 0.6}
    for references, count in ((["drawn:orbit"], 6), (["clip.mp4"], 1), (["clip.mp4", "builtin:orbit"], 2)):
        found = [
            outcome(row, seed, values[reference] + more + 0.01 * (seed - 2.5), reference=reference)
            for row, more in (("full", 0.0), ("less", 0.01))
            for reference in references
            for seed in range(6)
        ]
        measure = summarise(["full", "less"], found)[1].metrics["shot_size"]
        assert measure.difference is not None
        assert (measure.value.count, measure.difference.count) == (count, count)
        assert measure.value.mean == pytest.approx(np.mean([values[reference] for reference in references]) + 0.01)
        assert measure.difference.mean == pytest.approx(0.01)
        assert measure.difference.certain == (count == 6)


@pytest.mark.parametrize(("reference", "count"), [("drawn:orbit", 6), ("clip.mp4", 1)])
def test_a_reference_in_several_scenes_is_one_observation(reference: str, count: int) -> None:
    found = [
        replace(o, case=replace(o.case, scene=scene))
        for scene, more in (("a", 0.0), ("b", 0.2))
        for seed in range(6)
        for o in [outcome("full", seed, 0.1 * seed + more, reference=reference)]
    ]
    (full,) = summarise(["full"], found)
    assert (full.trials, full.metrics["shot_size"].value.count) == (12, count)
    assert full.metrics["shot_size"].value.mean == pytest.approx(0.35)


def test_rows_that_came_to_the_same_in_every_value_are_found() -> None:
    found = [outcome(row, seed, 0.1 + seed) for seed in range(2) for row in ("full", "as full", "less", "dear")]
    found[-1] = replace(found[-1], evaluations=41)
    found[-2] = outcome("less", 1, 0.2)
    found[0] = replace(found[0], seconds=7.0, commit="another")
    found += [replace(failed(row, seed), key="") for row in ("bad", "as bad") for seed in range(2)]
    assert alike(found) == [("full", "as full")]


def test_the_csv_tells_all_that_makes_a_difference_bold() -> None:
    found = [
        outcome(row, seed, 0.1 + more * (seed > 0)) for row, more in (("full", 0), ("less", 0.2)) for seed in range(7)
    ]
    rows = summarise(["full", "less"], found)
    first, less = (line for line in csv.DictReader(io.StringIO(to_csv(rows))) if line["metric"] == "shot_size")
    tested = ("difference_count", "difference_nonzero", "difference_p")
    assert (first["count"], [first[name] for name in tested]) == ("7", [""] * 3)
    assert (less["difference_count"], less["difference_nonzero"]) == ("7", "6")
    assert float(less["difference_p"]) == wilcoxon_p([0.2] * 6)
    assert (less["trials"], less["defined_frames"]) == ("7", "28")  # each below its head
    difference = rows[1].metrics["shot_size"].difference
    assert difference is not None
    assert difference.certain


def test_a_row_in_which_all_failed_has_no_number() -> None:
    rows = summarise(["full", "bad"], [outcome("full", 0, 0.1), failed("bad", 0)])
    assert rows[1].metrics["shot_size"].value.mean is None
    assert rows[1].evaluations is None
    lines = list(csv.DictReader(io.StringIO(to_csv(rows))))
    assert {line["mean"] for line in lines if line["row"] == "bad"} == {""}
    assert {line["failed"] for line in lines if line["row"] == "bad"} == {"1"}
    assert "nan" not in to_csv(rows).lower()
    assert "| bad | 1 | 1 | – | – |" in to_markdown(values_table(rows))[3]


def test_a_table_of_nothing_but_failures_has_its_counts_below_their_heads() -> None:
    (line,) = csv.DictReader(io.StringIO(to_csv(summarise(["bad"], [failed("bad", 0), failed("bad", 1)]))))
    told = {name: value for name, value in line.items() if value}
    assert told == {"row": "bad", "trials": "2", "failed": "2"}


def test_which_way_a_row_errs_is_told_with_its_sign() -> None:
    def erring(row: str, seed: int, larger: float) -> Outcome:
        return replace(outcome(row, seed, 0.1), directions={"larger": Metric(larger, "frame", 4, "")})

    found = [erring("full", seed, 0.01 * (-1) ** seed) for seed in range(6)]
    found += [erring("less", seed, -0.3 - 0.01 * seed) for seed in range(6)] + [failed("bad", 0)]
    table = directions_table(summarise(["full", "less", "bad"], found))
    assert table.header == ("which way", "larger [frame]")
    assert table.rows[1][1].startswith("-0.325 [")
    assert table.rows[2][1] == "–"
    assert table.bold == {(1, 1)}
    half = [replace(outcome("full", 0, 0.1), directions={"larger": Metric(0.01, "frame", 2, "")})]
    assert directions_table(summarise(["full"], half)).rows[0][1] == "+0.0100 (2/4)"


def test_no_row_is_a_formula_and_every_number_stays_one() -> None:
    names = ["=1+1", "-framing", "+lod", "@a", "\tb", "\rc"]
    rows = summarise(names, [outcome(name, 0, -float(i)) for i, name in enumerate(names)])
    lines = [line for line in csv.DictReader(io.StringIO(to_csv(rows))) if line["metric"] == "shot_size"]
    assert [line["row"] for line in lines] == ["'=1+1", "'-framing", "'+lod", "'@a", "'\tb", "'\nc"]
    assert [line["mean"] for line in lines[1:]] == ["-1.0", "-2.0", "-3.0", "-4.0", "-5.0"]
    assert lines[1]["difference_mean"] == "-1.0"


def test_tables_say_the_same_in_markdown_and_latex_whatever_a_row_is_called() -> None:
    name = "50 % | a_b & <i> *x*"
    rows = summarise(
        ["full", name], [outcome(r, s, 0.1 + s + i) for i, r in enumerate(("full", name)) for s in range(6)]
    )
    table = differences_table(rows)
    assert table.bold == {(0, 1)}
    assert to_markdown(table)[2].startswith(r"| 50 % \| a_b & &lt;i> \*x\* | **+1.00 [+1.00, +1.00] n=6** |")
    latex = to_latex(table)
    assert (
        r"50 \% \textbar{} a\_b \& \textless{}i\textgreater{} *x* & \textbf{\boldmath $+1.00$ [$+1.00$, $+1.00$] n=6}"
        in latex[4]
    )
    assert latex[0] == r"\begin{tabular}{lrr}"


def test_heads_have_the_unit_of_their_column() -> None:
    rows = summarise(["full", "bad"], [outcome("full", 0, 0.1), failed("bad", 0)])
    assert values_table(rows).header[3:5] == ("shot_size [frame]", "total")
    assert differences_table(rows).header == ("difference to full", "shot_size [frame]", "total")
