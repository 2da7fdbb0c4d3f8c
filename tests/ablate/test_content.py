"""What is named is told apart by its content, and by that of what goes with it."""

from __future__ import annotations

from pathlib import Path

from cltransfer.ablate.content import digest
from cltransfer.scenes.person.lifted import LABELS, SUBJECT


def test_other_labels_are_another_person(tmp_path: Path) -> None:
    (tmp_path / SUBJECT).write_text("{}")
    seen = []
    for labels in (None, b"a", b"b"):
        if labels is not None:
            (tmp_path / LABELS).write_bytes(labels)
        seen.append(digest(str(tmp_path / SUBJECT)))
    assert len(set(seen)) == 3
