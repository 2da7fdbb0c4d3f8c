"""What a bench cannot be asked is refused before it measures."""

from __future__ import annotations

import os

import pytest

from cltransfer.bench.pages import SECTIONS, markers

WRONG = [
    ("driver", "--jobs", "0"),
    ("driver", "--frames", "0"),
    ("driver", "--paper-shots", "-1"),
    ("flow", "--seed", "-1"),
    ("flow", "--seed", "99999999999999999999"),
    ("describe", "--seed", "99999999999999999999"),
    ("speed", "--seed", "-1"),
    ("table1", "--seed", "-1"),
    ("stress", "--seed", "-1"),
    ("lod", "--count", "0"),
    ("lod", "--members", "-1"),
]


@pytest.mark.parametrize("words", WRONG, ids=" ".join)
def test_numbers_out_of_range(command, words):
    answer = command("bench", *words)
    assert (answer.code, answer.err.count("\n")) == (2, 1), answer.err
    assert words[1] in answer.err


@pytest.mark.parametrize("bench", ["driver", "stress", "table1", "mesh", "describe"])
def test_a_page_that_cannot_be_written(command, tmp_path, bench):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "picture.md").write_bytes(b"\x89PNG\xff")
    for name, reason in ((".", "expected a file"), ("pipe", "expected a file"), ("picture.md", "expected UTF-8 text")):
        answer = command("bench", bench, "--out", tmp_path / name)
        assert (answer.code, answer.err.count("\n"), reason in answer.err) == (answer.code, 1, True), answer.err
        assert answer.code in (2, 3)


@pytest.mark.parametrize("bench", sorted({*SECTIONS} - {"lod"}))
def test_a_page_whose_section_has_no_end(command, tmp_path, bench):
    begin = markers(SECTIONS[bench])[0]
    (tmp_path / "page.md").write_text(f"{begin}\nmine\n")
    answer = command("bench", bench, "--out", tmp_path / "page.md")
    assert (answer.code, answer.out, answer.err.count("\n")) == (3, "", 1), answer.err
    assert f"page.md: {SECTIONS[bench]}: expected '{begin}', then" in answer.err


def test_a_page_that_is_written_where_no_other_is_named(command, tmp_path):
    for name, words in (("benchmarks.md", ("lod", "--out")), ("stress.md", ("stress", "--tier", "smoke", "--rows"))):
        (tmp_path / name).write_text(f"{markers(SECTIONS[words[0]])[0]}\nmine\n")
        answer = command("bench", *words, tmp_path)
        assert (answer.code, answer.out, answer.err.count("\n")) == (3, "", 1), answer.err


def test_a_folder_that_is_a_file(command, tmp_path):
    (tmp_path / "here").write_text("mine")
    answer = command("bench", "lod", "--out", tmp_path / "here")
    assert answer.code == 2
    assert "expected a folder" in answer.err


@pytest.mark.parametrize("bench", ["driver", "stress", "table1", "chart"])
def test_rows_that_are_a_file(command, tmp_path, bench):
    (tmp_path / "rows").write_text("mine")
    answer = command("bench", bench, "--rows", tmp_path / "rows")
    assert (answer.code, answer.err.count("\n")) == (2, 1), answer.err
    assert "expected a folder" in answer.err


def test_seeds_of_a_stressed_clip_are_an_option(command):
    answer = command("bench", "stress", "--tier", "smoke", "seed=7")
    assert (answer.code, answer.err.count("\n")) == (2, 1), answer.err
    assert "seed=7: a clip's seed is the method's too (use --seed)" in answer.err


def test_frames_of_a_stressed_clip_are_the_tiers(command):
    answer = command("bench", "stress", "--tier", "smoke", "frames=2")
    assert (answer.code, answer.err.count("\n")) == (2, 1), answer.err
    assert "frames=2: the tier and the stressor say how many frames a clip has" in answer.err
