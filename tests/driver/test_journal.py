"""Killed at any byte, a journal answers what it can, and only what was asked."""

from __future__ import annotations

import os
import struct
import time
import tracemalloc
import zlib
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.computer import memory
from cltransfer.driver.journal import SYNC, Journal, small_print
from cltransfer.errors import InputError, ResourceError
from cltransfer.storage.files import JSON_LIMIT
from cltransfer.testing.samples import sample_cameras, sample_features

HEADER = {"config.seed": 0, "scene": "abc"}
RECORD = 8 + 12 + 3 * 3 * 8  # bytes: frame, shape and question, the answers to three cameras


def questions() -> list[Camera]:
    return [sample_cameras(seed, 3) for seed in range(5)]


def values(cameras: Camera) -> Tensor:
    answers = cameras.center.clone()
    answers[0, 0] = torch.nan
    return answers


def ask_all(path: Path, resume: bool) -> tuple[list[Tensor], int]:
    """Answers to all questions, and how many had to be computed."""
    journal, computed = Journal(path, HEADER, resume), 0
    answers = []
    for cameras in questions():

        def compute(cameras: Camera = cameras) -> Tensor:
            nonlocal computed
            computed += 1
            return values(cameras)

        answers.append(journal.answer(cameras, compute))
    return answers, computed


def same(a: list[Tensor], b: list[Tensor]) -> bool:
    return all(torch.equal(x.view(torch.int64), y.view(torch.int64)) for x, y in zip(a, b))


def test_an_answer_larger_than_what_would_be_read_back_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cltransfer.driver.journal.RECORD_LIMIT", 2**20)
    journal, cameras = Journal(tmp_path / "j", HEADER, False), questions()[0]
    journal.answer(cameras, lambda: torch.zeros(3, 2**15, dtype=torch.float64))
    with pytest.raises(ResourceError, match="j: an answer of 1 MiB, expected at most 1"):
        journal.answer(cameras, lambda: torch.zeros(3, 2**16, dtype=torch.float64))
    again = Journal(tmp_path / "j", HEADER, True).answer(cameras, lambda: torch.ones(1))
    assert again.shape == (3, 2**15)


def test_a_finished_journal_answers_everything_bit_for_bit(tmp_path: Path) -> None:
    first, computed = ask_all(tmp_path / "j", False)
    again, none = ask_all(tmp_path / "j", True)
    assert (computed, none) == (5, 0)
    assert same(first, again)


@pytest.mark.parametrize("content", [b"Dear diary, today", b"\x04\x00\x00\x00\x00\x00\x00\x00{}{}"])
def test_what_is_no_journal_is_refused_and_left_as_it_is(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "j").write_bytes(content)
    with pytest.raises(InputError, match="not a journal"):
        Journal(tmp_path / "j", HEADER, True)
    assert (tmp_path / "j").read_bytes() == content


def test_what_was_asked_against_another_target_or_by_residuals_is_refused(tmp_path: Path) -> None:
    target = sample_features(1, 1)
    assert target.keypoints is not None
    moved = replace(target, keypoints=target.keypoints + 1e-6)
    prints = [small_print(target, "terms"), small_print(target, "residuals"), small_print(moved, "terms")]
    assert len(set(prints)) == 3
    cameras = sample_cameras(2, 3)
    Journal(tmp_path / "j", HEADER, False).answer(cameras, lambda: values(cameras), prints[0])
    assert Journal(tmp_path / "j", HEADER, True).answer(cameras, lambda: values(cameras), prints[0]).shape[0] > 0
    for other in prints[1:]:
        with pytest.raises(InputError, match="record 1: answers another question"):
            Journal(tmp_path / "j", HEADER, True).answer(cameras, lambda: values(cameras), other)


def test_without_resume_the_answers_are_discarded(tmp_path: Path) -> None:
    ask_all(tmp_path / "j", False)
    assert ask_all(tmp_path / "j", False)[1] == 5


def test_a_patient_journal_leaves_what_lies_there_until_it_settles_and_is_the_same_then(tmp_path: Path) -> None:
    first, cameras = questions()[:2]
    (tmp_path / "j").write_bytes(b"another run")
    journal = Journal(tmp_path / "j", HEADER, False, patient=True)
    journal.answer(first, lambda: values(first))
    assert not journal.settled
    assert (tmp_path / "j").read_bytes() == b"another run"
    journal.settle()
    journal.answer(cameras, lambda: values(cameras))
    plain = Journal(tmp_path / "plain", HEADER, False, patient=True)
    assert plain.settled  # there was nothing
    for asked in (first, cameras):
        plain.answer(asked, lambda asked=asked: values(asked))
    assert (tmp_path / "j").read_bytes() == (tmp_path / "plain").read_bytes()


def test_whether_a_run_was_begun_is_told_without_reading_all_of_its_journal(tmp_path: Path) -> None:
    assert not Journal.begun(tmp_path / "j", HEADER)
    journal, large = Journal(tmp_path / "j", HEADER, False), torch.zeros(1000, 1000, dtype=torch.float64)
    assert not Journal.begun(tmp_path / "j", HEADER)
    for cameras in questions():
        journal.answer(cameras, lambda: large)
    tracemalloc.start()
    try:
        assert Journal.begun(tmp_path / "j", HEADER)
        assert not Journal.begun(tmp_path / "j", {**HEADER, "config.seed": 1})
        assert tracemalloc.get_traced_memory()[1] < 2 * large.nbytes
    finally:
        tracemalloc.stop()


def test_cut_at_every_byte_of_the_last_records_at_most_one_batch_is_computed_again(tmp_path: Path) -> None:
    whole, _ = ask_all(tmp_path / "j", False)
    data = (tmp_path / "j").read_bytes()
    head = len(data) - 5 * RECORD
    sizes = {*range(0, head + 2 * RECORD, 7), *range(head + 2 * RECORD, len(data) + 1)}
    for size in sorted(sizes):
        (tmp_path / "cut").write_bytes(data[:size])
        answers, computed = ask_all(tmp_path / "cut", True)
        assert same(whole, answers)
        assert computed == 5 - max(0, size - head) // RECORD
        assert (tmp_path / "cut").read_bytes() == data


@pytest.mark.parametrize("from_end", [1, 3, RECORD, RECORD + 1, 2 * RECORD - 7, 3 * RECORD - 20, 5 * RECORD])
def test_a_flipped_bit_costs_its_record_and_what_follows_and_nothing_else(tmp_path: Path, from_end: int) -> None:
    whole, _ = ask_all(tmp_path / "j", False)
    data = (tmp_path / "j").read_bytes()
    flipped = bytearray(data)
    flipped[-from_end] ^= 4
    (tmp_path / "j").write_bytes(flipped)
    answers, computed = ask_all(tmp_path / "j", True)
    assert same(whole, answers)
    assert computed == (from_end + RECORD - 1) // RECORD
    assert (tmp_path / "j").read_bytes() == data


def test_a_flipped_bit_in_the_header_is_no_journal(tmp_path: Path) -> None:
    ask_all(tmp_path / "j", False)
    data = bytearray((tmp_path / "j").read_bytes())
    data[20] ^= 4
    (tmp_path / "j").write_bytes(data)
    with pytest.raises(InputError, match="not a journal"):
        ask_all(tmp_path / "j", True)
    assert (tmp_path / "j").read_bytes() == data


def test_every_answer_is_in_the_file_before_it_is_given_and_on_the_disk_soon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced, sync, now = list[int](), os.fsync, [100.0]

    def measured(descriptor: int) -> None:
        sync(descriptor)
        synced.append(os.fstat(descriptor).st_size)

    monkeypatch.setattr(os, "fsync", measured)
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    journal = Journal(tmp_path / "j", HEADER, False)
    head = (tmp_path / "j").stat().st_size
    assert synced == [head] != [0]
    for given, cameras in enumerate(questions(), 1):
        now[0] += 0.6 * SYNC
        answer = journal.answer(cameras, lambda cameras=cameras: values(cameras))
        assert synced == [head, *(head + i * RECORD for i in range(2, given + 1, 2))]
        stored = (tmp_path / "j").read_bytes()
        assert len(stored) == head + given * RECORD
        assert stored.endswith(answer.numpy().tobytes())
    ask_all(tmp_path / "j", True)
    assert len(synced) == 3  # what is answered from the disk is not written again


def test_a_tail_of_zeros_is_cut_off(tmp_path: Path) -> None:
    ask_all(tmp_path / "j", False)
    with (tmp_path / "j").open("ab") as stream:
        stream.write(bytes(1000))
    assert ask_all(tmp_path / "j", True)[1] == 0
    ask_all(tmp_path / "whole", False)
    for name in ("j", "whole"):
        journal = Journal(tmp_path / name, HEADER, True)
        for cameras in (*questions(), questions()[0]):  # one more than there are answers
            journal.answer(cameras, lambda cameras=cameras: values(cameras))
        del journal
    assert (tmp_path / "j").read_bytes() == (tmp_path / "whole").read_bytes()


def test_another_run_is_refused_by_the_key_that_differs(tmp_path: Path) -> None:
    ask_all(tmp_path / "j", False)
    with pytest.raises(InputError, match=r"config\.seed: the run was begun with 0, this is 1"):
        Journal(tmp_path / "j", {**HEADER, "config.seed": 1}, True)


def test_another_question_is_refused(tmp_path: Path) -> None:
    ask_all(tmp_path / "j", False)
    journal = Journal(tmp_path / "j", HEADER, True)
    with pytest.raises(InputError, match="record 1: answers another question"):
        journal.answer(sample_cameras(9, 3), lambda: torch.zeros(3, 3))


def test_a_record_that_is_too_short_is_of_another_question(tmp_path: Path) -> None:
    Journal(tmp_path / "j", HEADER, False)
    with (tmp_path / "j").open("ab") as stream:
        stream.write(struct.pack("<II", 2, zlib.crc32(b"ab")) + b"ab")
    with pytest.raises(InputError, match="record 1: answers another question"):
        ask_all(tmp_path / "j", True)


def test_a_length_of_4_gigabytes_is_not_believed(tmp_path: Path) -> None:
    ask_all(tmp_path / "j", False)
    with (tmp_path / "j").open("ab") as stream:
        stream.write(b"\xff" * 64)
    assert ask_all(tmp_path / "j", True)[1] == 0


def test_a_run_is_written_by_one_process_at_a_time(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    context = get_context("fork")
    ours, theirs = context.Pipe()

    def hold() -> None:
        journal = Journal(tmp_path / "j", HEADER, False)
        theirs.send("held")
        theirs.recv()
        del journal

    other = context.Process(target=hold, daemon=True)
    other.start()
    assert ours.poll(60)
    written = (tmp_path / "j").read_bytes()
    for resume in (True, False):
        with pytest.raises(ResourceError, match=r"j: another process writes this run \(wait until it ends"):
            Journal(tmp_path / "j", HEADER, resume)
    assert (tmp_path / "j").read_bytes() == written
    ours.send("end")
    other.join()
    Journal(tmp_path / "j", HEADER, True)


def test_the_header_is_compared_before_the_answers_are_read(tmp_path: Path) -> None:
    path, block = tmp_path / "j", bytes(2**22)
    ask_all(path, False)
    with path.open("ab") as stream:
        for _ in range(8):
            stream.write(struct.pack("<II", len(block), zlib.crc32(block)) + block)
    tracemalloc.start()
    with pytest.raises(InputError, match=r"config\.seed"):
        Journal(path, {**HEADER, "config.seed": 1}, True)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2**21


def test_no_more_is_taken_for_a_header_than_any_file_of_json_may_have(tmp_path: Path) -> None:
    path = tmp_path / "j"
    for size in (JSON_LIMIT + 1, 2 * JSON_LIMIT):
        header = b'"' + b" " * (size - 2) + b'"'
        path.write_bytes(struct.pack("<II", size, zlib.crc32(header)) + header)
        tracemalloc.start()
        with pytest.raises(InputError, match="header: not a journal"):
            Journal(path, HEADER, True)
        assert tracemalloc.get_traced_memory()[1] < 2**20
        tracemalloc.stop()


def test_a_document_is_held_against_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cameras, told = questions()[0], [[]] * 30_000
    Journal(tmp_path / "j", HEADER, False).document(cameras, lambda: told)
    assert Journal(tmp_path / "j", HEADER, True).document(cameras, list) == told
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**21)
    with pytest.raises(ResourceError, match="j: memory: values of 120012 bytes of JSON need 5 MB"):
        Journal(tmp_path / "j", HEADER, True).document(cameras, list)


def test_answers_are_read_one_at_a_time_when_they_are_asked_for(tmp_path: Path) -> None:
    journal, large = Journal(tmp_path / "j", HEADER, False), torch.zeros(3, 333_000, dtype=torch.float64)
    for cameras in questions() * 2:
        journal.answer(cameras, lambda: large)
    tracemalloc.start()
    try:
        again = Journal(tmp_path / "j", HEADER, True)
        assert tracemalloc.get_traced_memory()[1] < large.nbytes
        for cameras in questions() * 2:
            assert torch.equal(again.answer(cameras, lambda: large + 1), large)
        assert tracemalloc.get_traced_memory()[1] < 5 * large.nbytes
    finally:
        tracemalloc.stop()
