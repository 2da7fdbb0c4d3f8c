from __future__ import annotations

import struct
from pathlib import Path

import pytest
import torch

from cltransfer.errors import InputError
from cltransfer.storage.tensor_file import HEADER_LIMIT, check_tensor_file, save_tensors

LIMIT = 2 * HEADER_LIMIT


def test_what_is_written_is_taken_for_one(tmp_path: Path) -> None:
    save_tensors(tmp_path / "a.safetensors", {"a": torch.zeros(3)})
    check_tensor_file(tmp_path / "a.safetensors", LIMIT, "grid")


def test_a_missing_file_and_a_folder_are_told_apart(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "gone.safetensors", "no such file"), (tmp_path, "expected a file, got a folder")):
        with pytest.raises(InputError) as caught:
            check_tensor_file(path, LIMIT, "grid")
        assert str(caught.value) == f"{path}: {reason}"


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "header: not a grid"),
        (struct.pack("<Q", 9), "header: not a grid"),
        (struct.pack("<Q", HEADER_LIMIT + 1) + b" " * (HEADER_LIMIT + 1), "header: not a grid"),
        (b" " * (LIMIT + 1), f"expected at most {LIMIT} bytes, got {LIMIT + 1}"),
    ],
    ids=["empty", "cut off", "a long header", "large"],
)
def test_what_cannot_be_one_is_refused_before_it_is_read(tmp_path: Path, data: bytes, reason: str) -> None:
    path = tmp_path / "a.safetensors"
    path.write_bytes(data)
    with pytest.raises(InputError, match=reason):
        check_tensor_file(path, LIMIT, "grid")
