"""What a run that goes on is told where it is not the one that was begun."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.driver.journal import Journal
from cltransfer.driver.journal_header import PERSON, VIEW, _begun_so, same_command
from cltransfer.errors import InputError


def test_a_journal_is_of_what_the_initial_view_s_file_held(tmp_path: Path) -> None:
    begun = {"init": "view.json", VIEW: 1, "threads": 2}
    Journal(tmp_path / "a", begun, False)
    Journal(tmp_path / "a", begun, True)
    with pytest.raises(
        InputError, match=rf"{VIEW}: the run was begun with 1, this is 2 \(start over with another --out"
    ):
        Journal(tmp_path / "a", {**begun, VIEW: 2}, True)
    with pytest.raises(
        InputError, match=r"init: the run was begun with 'view.json', .* \(go on with --init view.json, or"
    ):
        Journal(tmp_path / "a", {"init": "auto", "threads": 2}, True)


def test_a_key_that_was_not_set_is_told_as_a_config_says_it(tmp_path: Path) -> None:
    Journal(tmp_path / "a", {"config.frames": None}, False)
    told = r"config\.frames: the run was begun with null, this is 24 \(go on with frames=null, or"
    with pytest.raises(InputError, match=told):
        Journal(tmp_path / "a", {"config.frames": 24}, True)


def test_who_was_named_follows_from_subject_and_is_asked_for_again(tmp_path: Path) -> None:
    begun = {"subject": "1", "person": "a" * 64}
    Journal(tmp_path / "a", begun, False)
    with pytest.raises(InputError, match=r"subject: the run was begun with '1', .* \(go on with --subject 1, or"):
        Journal(tmp_path / "a", {"subject": None, "person": "b" * 64}, True)
    assert _begun_so("subject", None).startswith("go on with no --subject, or")


def test_what_one_side_alone_has_is_told(tmp_path: Path) -> None:
    begun = {"threads": 2, "network of pose": "a" * 64}
    Journal(tmp_path / "a", begun, False)
    with pytest.raises(InputError, match=r"network of pose: the run was begun with 'a+', this is null \(start over"):
        Journal(tmp_path / "a", {"threads": 2}, True)
    with pytest.raises(InputError, match=r"network of depth: the run was begun with null, this is 'b+' \(start over"):
        Journal(tmp_path / "a", {**begun, "network of depth": "b" * 64}, True)


def test_how_a_run_is_gone_on_with_can_be_pasted() -> None:
    assert (
        _begun_so("init", "my views/a.json") == "go on with --init 'my views/a.json', or start over with another --out"
    )
    again = "repeat the command as it was with --resume, or start over with another --out"
    assert _begun_so("config.basin", 1000.0, ["a"]) == f"a differs too: {again}"
    assert _begun_so("config.basin", 1000.0, ["a", "b", "c"]) == f"a, b and c differ too: {again}"
    assert _begun_so("config.basin", 1000.0, list("abcde")) == f"a, b, c and 2 more differ too: {again}"
    assert _begun_so("config.losses", {"framing": {}}).startswith("repeat the command as it was with --resume, or")
    assert _begun_so("config.warm_start", True).startswith("go on with warm_start=true, or")
    assert _begun_so("config.preset", "Mine $(date)", 0).startswith("go on with 'preset=Mine $(date)', or")
    assert _begun_so("threads", "1; date").startswith("go on with CLTRANSFER_THREADS='1; date', or")


def test_what_was_said_otherwise_is_named_before_what_cltransfer_is_made_of(tmp_path: Path) -> None:
    names = ("reference", "code of cltransfer", "network of pose")
    begun = {"config.preset": "fast", "config.basin": 1, "config.frames": 5, **dict.fromkeys(names, "a" * 64)}
    Journal(tmp_path / "a", begun, False)
    told = r"config\.frames: .* begun with 5, this is 3 \(reference, code of cltransfer and network of pose differ too"
    with pytest.raises(InputError, match=told):
        Journal(tmp_path / "a", {**begun, "config.frames": 3, **dict.fromkeys(names, "b" * 64)}, True)
    with pytest.raises(InputError, match=r"config\.preset: .* \(config\.basin differs too"):
        Journal(tmp_path / "a", {**begun, "config.preset": "max", "config.basin": 2}, True)
    told = r"reference: is not what the run was begun with \(code of cltransfer differs too: repeat the command"
    with pytest.raises(InputError, match=told):
        Journal(tmp_path / "a", {**begun, "code of cltransfer": "b" * 64, "reference": "b" * 64}, True)
    with pytest.raises(InputError, match=r"code of cltransfer: is not what the run was begun with \(start over"):
        Journal(tmp_path / "a", {**begun, "code of cltransfer": "b" * 64}, True)


def test_a_command_is_the_same_by_what_it_says_and_reads_on_whatever_computer() -> None:
    said = {"config.seed": 0, "config.threads": None, "init": "view.json", "scene": "a" * 64, "reference": "b" * 64}
    read = {VIEW: 1, PERSON: "d" * 64, "code of loss mine": "1" * 64, "network of pose": "2" * 64, "order": ["a", "b"]}
    begun = {**said, **read, "threads": 2, "code of cltransfer": "c" * 64, "versions": {"a": "2"}}
    elsewhere = {"config.threads": 8, "threads": 8, "code of cltransfer": "e" * 64, "versions": {}}
    assert same_command(begun, {**begun, **elsewhere})
    assert same_command(begun, {**begun, **elsewhere, PERSON: "f" * 64})  # whom another version lifts
    assert same_command(begun, {**begun, "config.new": 1})  # which a later version has
    for key in ("config.seed", "init", "scene", "reference", *read):
        assert not same_command(begun, {**begun, key: "another"})
    assert not same_command(["a journal"], begun)


def test_what_networks_run_on_and_what_could_not_be_read_this_time_is_no_other_command() -> None:
    begun = {"scene": "a" * 64, "networks run on": "auto", "unread of the reference": ["flow"]}
    assert same_command(begun, {**begun, "networks run on": "cpu"})
    assert same_command(begun, {**begun, "unread of the reference": []})
