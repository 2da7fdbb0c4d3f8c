"""Rows survive a kill, and what is there is not run again."""

import json

import pytest

from cltransfer.bench.protocol import Trial
from cltransfer.bench.rows import FILE, kept_rows, read_rows, run_trials
from cltransfer.computer import memory
from cltransfer.errors import InputError, ModelError, ResourceError
from cltransfer.storage.alone import alone
from cltransfer.storage.kept_lines import keep

TRIALS = [Trial("fast", shot, "plaza-2000", "plaza-2000", 1000, 4, ("search_side=64",)) for shot in ("pan", "zoom")]


def test_a_damaged_line_is_one_error_that_says_where(tmp_path):
    keep(tmp_path / FILE, {"key": "a"})
    keep(tmp_path / FILE, {"nokey": 1})
    with pytest.raises(InputError, match="line 2: is no row"):
        read_rows(tmp_path)


@pytest.mark.parametrize("line", [[{"key": "a"}], {"key": 1}, {"key": ["a"]}, "key"])
def test_a_line_that_is_no_row_is_named(tmp_path, line):
    keep(tmp_path / FILE, line)
    with pytest.raises(InputError, match="line 1: is no row"):
        read_rows(tmp_path)


def test_rows_are_held_against_the_memory(tmp_path, monkeypatch):
    keep(tmp_path / FILE, {"key": "a", "x": [[]] * 30_000})
    assert list(read_rows(tmp_path)) == ["a"]
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**21)
    with pytest.raises(ResourceError, match=r"rows\.jsonl: memory: values of 120020 bytes of JSON need 5 MB"):
        read_rows(tmp_path)


def test_rows_of_many_trials_are_read_in_the_memory_that_they_take(tmp_path, monkeypatch):
    """12 MB, which would take 570 MB if they were the worst that so many bytes of JSON can be."""
    row = {"key": "a", "terms": {"framing": [0.123456789] * 600}}
    lines = [json.dumps({**row, "key": f"{number}"}) for number in range(1500)]
    (tmp_path / FILE).write_text("\n".join(lines) + "\n")
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**26)
    assert len(read_rows(tmp_path)) == 1500


def test_a_bench_goes_on_where_it_was_stopped(tmp_path):
    heard: list[str] = []
    first = run_trials(TRIALS[:1], tmp_path, told=heard.append)
    both = run_trials(TRIALS, tmp_path, told=heard.append)
    assert both[0] == first[0]
    assert heard[0] == "1 trials, 0 of them done before"
    assert heard[2] == "2 trials, 1 of them done before"
    assert len(heard) == 4
    again = run_trials(TRIALS, tmp_path)
    assert again == both
    assert len((tmp_path / FILE).read_text().splitlines()) == 2
    for row, trial in zip(both, TRIALS):
        assert row["shot"] == trial.shot
        assert row["key"] == trial.key()
        assert len(row["terms"]["framing"]) == 4
        assert row["terms"]["camera_movement"][0] is None  # a first frame has no flow
        assert json.loads((tmp_path / "paths" / f"{row['key']}.json").read_text())["format"] == "cltransfer.trajectory"
    assert both[0]["truth"]["position"] < 0.3
    assert both[0]["random_total"] > 5 * both[0]["total"]


def test_a_network_that_is_missing_shows_before_anything_is_run(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path / "none"))
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    heard: list[str] = []
    with pytest.raises(ModelError, match="onnx"):
        run_trials(TRIALS, tmp_path, told=heard.append, networks=True)
    assert not heard


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_trial_that_cannot_be_measured_keeps_no_other_from_it(tmp_path, jobs):
    def measure(key: str, task: int) -> dict:
        if not task:
            raise InputError("clip.mp4", "frames", "there are none")
        return {"value": task}

    heard: list[str] = []
    with pytest.raises(InputError, match=r"clip.mp4: frames: there are none"):
        kept_rows({"a": 0, "b": 2}, measure, tmp_path, jobs, heard.append)
    assert sorted(read_rows(tmp_path)) == ["b"]
    assert any("clip.mp4: frames: there are none" in line for line in heard)


def test_workers_import_nothing_from_the_folder_that_a_bench_is_started_in(tmp_path, planted):
    rows = kept_rows({"a": 1, "b": 2}, lambda key, task: {"value": task}, tmp_path / "rows", 2)
    assert not planted.exists()
    assert [row["value"] for row in rows] == [1, 2]


def test_a_folder_is_one_bench_s_at_a_time(tmp_path):
    with alone(tmp_path, "runs a bench"), pytest.raises(ResourceError, match="another --rows"):
        kept_rows({"a": 1}, lambda key, task: {}, tmp_path)


def test_rows_tell_the_commit_of_the_code_that_was_loaded(tmp_path, monkeypatch):
    commits = iter(["first", "second", "third"])
    monkeypatch.setattr("cltransfer.bench.rows.commit", lambda: next(commits))
    rows = kept_rows({"a": 1, "b": 2}, lambda key, task: {"value": task}, tmp_path)
    assert [row["commit"] for row in rows] == ["first", "first"]
