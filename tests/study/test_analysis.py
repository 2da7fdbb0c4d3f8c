"""The analysis: exact intervals, intervals over participants, strengths; files that cannot be meant are named."""

from __future__ import annotations

import json
import re
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta

from cltransfer.errors import InputError
from cltransfer.study.analysis import bradley_terry, preferences, strengths
from cltransfer.study.answers import COLUMNS, Choice, read_answers
from cltransfer.study.design import NO_STUDY, QUESTIONS, Study, design
from cltransfer.study.report import Analysis, markdown, preferences_csv

TWO = design(["s", "t"], ["ours", "jaws"], [], 0)
THREE = design(["s"], ["a", "b", "c"], [], 0)


def written(path: Path, participant: str, chosen: Callable[[int], str], study: Study = TWO) -> Path:
    """Answers of one participant, as the page saves them; ``chosen`` says the method by the item's number."""
    lines = [",".join(COLUMNS)]
    for number, item in enumerate(study.items):
        token = next(t for t in (item.first, item.second) if study.clips[t].method == chosen(number))
        lines += [
            f"{study.name},{participant},{item.name},{question},{item.first},{item.second},{token},2.5"
            for question in QUESTIONS
        ]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_exact_interval_is_that_of_clopper_and_pearson() -> None:
    choices = [
        Choice(f"p{i}", "item1", "smoothness", *(("ours", "jaws") if i < 9 else ("jaws", "ours"))) for i in range(11)
    ]
    found = next(p for p in preferences(choices, TWO) if p.question == "smoothness")
    assert (found.wins, found.count, found.share) == (9, 11, 9 / 11)
    assert found.exact == pytest.approx((beta.ppf(0.025, 9, 3), beta.ppf(0.975, 10, 2)))


def test_the_interval_over_participants_knows_that_one_persons_answers_belong_together() -> None:
    """Six people of 25 answers each, three all for one, three all for the other: the exact interval is too narrow."""
    choices = [
        Choice(f"p{i}", f"item{k}", "smoothness", *(("ours", "jaws") if i < 3 else ("jaws", "ours")))
        for i in range(6)
        for k in range(25)
    ]
    found = next(p for p in preferences(choices, TWO) if p.question == "smoothness")
    assert found.exact is not None
    assert found.by_participant is not None
    assert found.exact[1] - found.exact[0] < 0.21
    low, high = found.by_participant
    assert high - low > 0.6


@pytest.mark.parametrize(("people", "interval"), [(5, None), (6, (0.025 ** (1 / 6), 1.0))])
def test_people_who_all_agree_do_not_make_certain(people: int, interval: tuple[float, float] | None) -> None:
    choices = [Choice(f"p{i}", f"item{k}", "smoothness", "ours", "jaws") for i in range(people) for k in range(9)]
    found = next(p for p in preferences(choices, TWO) if p.question == "smoothness")
    assert found.by_participant == (None if interval is None else pytest.approx(interval))


def test_who_was_asked_of_another_pair_alone_is_no_participant_of_this_one() -> None:
    choices = [Choice(f"p{i}", "item1", "smoothness", "a", "b" if i else "c") for i in range(6)]
    found = {(p.first, p.second): p for p in preferences(choices, THREE) if p.question == "smoothness"}
    assert found["a", "b"].by_participant is None
    assert found["a", "b"].reason == "too few participants for an interval: 5, expected 6 or more"


@pytest.mark.parametrize(("of_two", "low", "high"), [(1, 0.118, 0.882), (0, 0.0, 0.459)])
def test_people_who_are_all_as_undecided_do_not_make_certain(of_two: int, low: float, high: float) -> None:
    """Six people, each with ``of_two`` of two answers for ours: resampling them comes to the same share every time."""
    pairs = [("ours", "jaws") if k < of_two else ("jaws", "ours") for k in range(2)]
    choices = [Choice(f"p{i}", f"item{k}", "smoothness", *pair) for i in range(6) for k, pair in enumerate(pairs)]
    found = next(p for p in preferences(choices, TWO) if p.question == "smoothness")
    assert found.by_participant == pytest.approx((low, high), abs=1e-3)


def test_nothing_answered_is_null_and_not_half(tmp_path: Path) -> None:
    found = preferences([], TWO)
    assert {p.reason for p in found} == {"no answers"}
    assert {(p.count, p.share, p.exact, p.by_participant) for p in found} == {(0, None, None, None)}


def test_strengths_are_the_ones_that_made_the_answers() -> None:
    truth = np.array([0.6, 0.3, 0.1])
    games = 30_000
    wins = games * truth[:, None] / (truth[:, None] + truth)
    np.fill_diagonal(wins, 0)
    np.testing.assert_allclose(bradley_terry(wins), truth, atol=1e-9)


@pytest.mark.parametrize("odds", [3.0, 1e3, 1e6])
def test_strengths_of_lopsided_answers_are_found_to_the_end(odds: float) -> None:
    """Each is preferred to the next by the same odds, and compared with no other: the odds are their ratios."""
    wins = np.diag(np.full(3, odds), 1) + np.diag(np.ones(3), -1)
    truth = odds ** -np.arange(4.0)
    np.testing.assert_allclose(bradley_terry(wins), truth / truth.sum(), rtol=1e-6)


def test_strengths_are_found_where_the_nearest_parabola_lies_far_off() -> None:
    """At the greatest likelihood each is preferred as often as it was."""
    wins = np.array([[0.0, 0, 0, 1], [1e4, 0, 0, 1e4], [1e4, 1, 0, 0], [0, 0, 10, 0]])
    found = bradley_terry(wins)
    chance = found[:, None] / (found[:, None] + found)
    np.testing.assert_allclose(((wins + wins.T) * chance).sum(1) - np.diag(wins), wins.sum(1), rtol=1e-6)


def test_a_method_that_never_lost_has_no_finite_strength_and_says_so() -> None:
    choices = [Choice("p", "item1", "smoothness", *pair) for pair in (("a", "b"), ("a", "c"), ("b", "c"), ("c", "b"))]
    found = [s for s in strengths(choices, THREE) if s.question == "smoothness"]
    assert [s.value for s in found] == [None] * 3
    assert "never lost" in found[0].reason


def test_strengths_have_intervals_over_participants() -> None:
    rng = np.random.default_rng(0)
    truth = {"a": 0.6, "b": 0.3, "c": 0.1}
    choices = []
    for person in range(20):
        for number in range(6):
            for x, y in (("a", "b"), ("a", "c"), ("b", "c")):
                pair = (x, y) if rng.random() < truth[x] / (truth[x] + truth[y]) else (y, x)
                choices.append(Choice(f"p{person}", f"item{number}", "smoothness", *pair))
    found = {s.method: s for s in strengths(choices, THREE) if s.question == "smoothness"}
    for method, value in truth.items():
        low, high = found[method].by_participant or (1.0, 0.0)
        assert low < (found[method].value or 0) < high
        assert high - low < 0.25
        assert low - 0.1 < value < high + 0.1
    assert sum(s.value or 0 for s in found.values()) == pytest.approx(1)


@pytest.mark.parametrize(("people", "reason"), [(5, "too few participants for an interval: 5, expected 6"), (8, "")])
def test_why_a_strength_has_no_interval_is_told(people: int, reason: str) -> None:
    """All but one agree."""
    pairs = (("a", "b"), ("a", "c"), ("b", "c"))
    choices = [
        Choice(f"p{i}", "item1", "smoothness", *(pair if i else pair[::-1])) for i in range(people) for pair in pairs
    ]
    found = [s for s in strengths(choices, THREE) if s.question == "smoothness"]
    assert len(found) == 3
    assert all(s.value is not None and reason in s.reason for s in found)
    assert all((s.by_participant is None) == bool(reason) == bool(s.reason) for s in found)


def test_answers_that_excel_has_saved_are_read(tmp_path: Path) -> None:
    path = written(tmp_path / "p.csv", "p", lambda number: "ours")
    plain = read_answers([path], TWO)
    path.write_text(path.read_text(), encoding="utf-8-sig", newline="\r\n")
    assert read_answers([path], TWO) == plain


def test_no_more_of_a_table_is_held_than_the_line_that_is_looked_at(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text(",".join(COLUMNS) + "\n" + ",,,,,,,\n" * 2**16)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="line 2: is of study ''"):
            read_answers([path], TWO)
        assert tracemalloc.get_traced_memory()[1] < 12 * path.stat().st_size
    finally:
        tracemalloc.stop()


def test_the_verb_unblinds_and_says_who_stopped_early(command: Callable[..., Any], tmp_path: Path) -> None:
    key = tmp_path / "page.key.json"
    key.write_text(json.dumps(TWO.to_json()))
    files = [
        written(tmp_path / f"{i}.csv", f"p{i}", lambda n, i=i: "jaws" if i == n == 0 else "ours") for i in range(3)
    ]
    files[2].write_text("\n".join(files[2].read_text().splitlines()[:-2]) + "\n")
    answer = command("study", "--analyse", *files, "--key", key, "--out", tmp_path / "analysis")
    assert answer.code == 0, answer.err
    assert "3 participants, 16 answers" in answer.out
    assert [line for line in answer.out.splitlines() if " answered " in line] == ["- p2 answered 4 of 6"]
    assert "| visual_style | ours | jaws | 83.3 % | [35.9, 99.6] |" in answer.out
    assert NO_STUDY in answer.out
    assert "Bradley" not in answer.out
    said = json.loads((tmp_path / "analysis" / "analysis.json").read_text(), parse_constant=pytest.fail)
    assert said["preferences"][0]["wins"] == 5
    assert said["preferences"][0]["by_participant"] is None
    assert said["preferences"][0]["reason"] == "too few participants for an interval: 3, expected 6 or more"
    assert "| – | 5/6 | too few participants for an interval: 3, expected 6 or more |" in answer.out
    table = (tmp_path / "analysis" / "preferences.csv").read_text().splitlines()
    assert table[1].startswith("visual_style,ours,jaws,5,6,")
    assert table[1].endswith(',"too few participants for an interval: 3, expected 6 or more"')


def test_no_method_is_a_formula() -> None:
    study = design(["s"], ["=1+1", "@b"], [], 0)
    analysis = Analysis(study, {}, tuple(preferences([], study)), ())
    assert preferences_csv(analysis).splitlines()[1] == "visual_style,'=1+1,'@b,0,0,,,,,,no answers"


def _turned(line: str) -> str:
    """The other of the two that were shown was chosen."""
    cells = line.split(",")
    chosen, left, right = (COLUMNS.index(name) for name in ("chosen", "left", "right"))
    cells[chosen] = cells[right] if cells[chosen] == cells[left] else cells[left]
    return ",".join(cells)


def test_answers_that_were_downloaded_before_all_were_given_count_once(tmp_path: Path) -> None:
    whole = written(tmp_path / "whole.csv", "p", lambda number: "ours")
    (tmp_path / "part.csv").write_text("".join(whole.read_text().splitlines(keepends=True)[:4]))
    assert read_answers([tmp_path / "part.csv", whole], TWO) == read_answers([whole], TWO)


DAMAGE: dict[str, tuple[Callable[[str], str], str]] = {
    "another study": (lambda text: text.replace(TWO.name, "0" * 12), "line 2: is of study '000000000000'"),
    "another file": (lambda text: "name,value\n1,2\n", "line 1: expected the columns study"),
    "an unknown item": (lambda text: text.replace("item1", "item9"), "line 2: is an answer to nothing that was asked"),
    "an unknown question": (
        lambda text: text.replace("visual_style", "taste"),
        "line 2: is an answer to nothing that was asked",
    ),
    "an unknown video": (
        lambda text: text.replace(TWO.items[0].first, "ffffff"),
        "line 2: item1 compares other videos",
    ),
    "another answer of the same person": (
        lambda text: text + _turned(text.splitlines()[1]) + "\n",
        "line 8: p answered item1, visual_style in two ways",
    ),
    "a cut line": (lambda text: text[:-12], "line 7: expected 8 values"),
    "a longer line": (lambda text: text.rstrip() + ",x\n", "line 7: expected 8 values"),
    "blank lines": (lambda text: text.replace("\n", "\n\n\n", 1).replace("item1", "item9"), "line 4: is an answer"),
    "a code with a blank": (lambda text: text.replace(",p,", ",p ,"), "line 2: 'p ' is no code of a participant"),
    "nothing": (lambda text: "", "line 1: expected the columns"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_answers_that_cannot_be_meant_are_named(tmp_path: Path, kind: str) -> None:
    damage, reason = DAMAGE[kind]
    path = written(tmp_path / "p.csv", "p", lambda number: "ours")
    path.write_text(damage(path.read_text()))
    with pytest.raises(InputError) as caught:
        read_answers([path], TWO)
    assert reason in str(caught.value)
    assert "p.csv" in str(caught.value)


@pytest.mark.parametrize("text", ["{}", "[]", '{"format": "cltransfer.study"}', "no json"])
def test_a_key_that_is_none_is_named(tmp_path: Path, text: str, command: Callable[..., Any]) -> None:
    path = written(tmp_path / "p.csv", "p", lambda number: "ours")
    (tmp_path / "key.json").write_text(text)
    answer = command("study", "--analyse", path, "--key", tmp_path / "key.json")
    assert answer.code == 3
    assert "key.json" in answer.err
    without = command("study", "--analyse", path)
    assert without.code == 2
    assert "--key" in without.err


def test_a_method_of_any_name_stays_one_cell() -> None:
    study = design(["s", "t"], ["a|b", "[c](d)\r*e*", "f"], [], 0)
    choices = [Choice("p", item.name, "smoothness", *pair) for item, pair in zip(study.items, _pairs(study))]
    found = Analysis(study, {"p": 6}, tuple(preferences(choices, study)), tuple(strengths(choices, study)))
    rows = [line for line in markdown(found) if line.startswith("| smoothness")]
    assert len(rows) == 6
    assert {len(re.split(r"(?<!\\)\|", row)) for row in rows} == {10, 7}
    assert r"[c\](d) \*e\*" in rows[0]
    assert not any("\r" in line for line in markdown(found))


def _pairs(study: Study) -> list[tuple[str, str]]:
    return [(study.clips[item.first].method, study.clips[item.second].method) for item in study.items]


@pytest.mark.parametrize("damage", ["a video against itself", "another sample's", "numbers for methods", "twice"])
def test_a_key_that_cannot_be_is_refused(tmp_path: Path, damage: str) -> None:
    raw = json.loads(json.dumps(TWO.to_json()))
    if damage == "a video against itself":
        raw["items"][0]["second"] = raw["items"][0]["first"]
    elif damage == "another sample's":
        raw["items"][0]["second"] = raw["items"][1]["second"]
    elif damage == "twice":
        raw["items"][1] = raw["items"][0]
    else:
        raw["methods"] = [1, 2]
        for number, clip in enumerate(raw["clips"].values()):
            clip["method"] = 1 + number % 2
    (tmp_path / "page.key.json").write_text(json.dumps(raw))
    with pytest.raises(InputError, match="key of a study"):
        Study.load(tmp_path / "page.key.json")
