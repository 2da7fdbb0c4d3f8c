"""Answers of participants, unblinded by the key and checked: nothing foreign, nothing twice."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..storage.files import read_text
from .design import QUESTIONS, Item, Study

COLUMNS = ("study", "participant", "item", "question", "left", "right", "chosen", "seconds")
LIMIT = 2**24  # bytes
CODE = re.compile(r"[A-Za-z0-9_-]{1,32}")  # of a participant, as the page takes it


@dataclass(frozen=True)
class Choice:
    """One answer: who preferred which method to which."""

    participant: str
    item: str
    question: str
    winner: str
    loser: str


def read_answers(files: Iterable[Path], study: Study) -> list[Choice]:
    """All answers in ``files``, which the page saved.

    Raises:
        InputError: a file is no such file, or of another study; an answer is to nothing that was asked, or another
            than the same person gave before. One that is the same counts once: who downloads early saves it twice.
    """
    found: dict[tuple[str, str, str], Choice] = {}
    items = {item.name: item for item in study.items}
    for path in files:
        for number, row in _rows(path):
            choice = _choice(row, study, items, path, number)
            asked = (choice.participant, choice.item, choice.question)
            if found.get(asked, choice) != choice:
                reason = f"{choice.participant} answered {choice.item}, {choice.question} in two ways"
                hint = "was a code used by two? of an answer taken back after a download give the later file alone"
                raise InputError(path, f"line {number}", reason, hint)
            found[asked] = choice
    return list(found.values())


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """One at a time: of blank cells each takes forty times the memory of its text."""
    text = read_text(path, LIMIT).removeprefix("\ufeff")  # the mark that Excel puts before UTF-8
    lines = csv.DictReader(io.StringIO(text))
    try:
        if tuple(lines.fieldnames or ()) != COLUMNS:
            raise InputError(path, "line 1", f"expected the columns {', '.join(COLUMNS)}")
        yield from ((lines.line_num, row) for row in lines)
    except csv.Error as error:
        raise InputError(path, "", f"expected CSV, {error}") from None


def _choice(row: dict[str, str], study: Study, items: dict[str, Item], path: Path, number: int) -> Choice:
    where = f"line {number}"
    if None in row or None in row.values():
        raise InputError(path, where, f"expected {len(COLUMNS)} values")
    if row["study"] != study.name:
        raise InputError(path, where, f"is of study {row['study']!r}, the key of {study.name}")
    item = items.get(row["item"])
    if item is None or row["question"] not in QUESTIONS or not row["participant"]:
        raise InputError(path, where, "is an answer to nothing that was asked")
    if not CODE.fullmatch(row["participant"]):
        reason = f"{row['participant']!r} is no code of a participant"
        raise InputError(path, where, reason, "letters, digits, - and _, as the page takes them")
    pair = {item.first, item.second}
    if {row["left"], row["right"]} != pair or row["chosen"] not in pair:
        raise InputError(path, where, f"{row['item']} compares other videos")
    other = (pair - {row["chosen"]}).pop()
    winner, loser = study.clips[row["chosen"]].method, study.clips[other].method
    return Choice(row["participant"], item.name, row["question"], winner, loser)
