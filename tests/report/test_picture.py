"""Pictures are written by whatever name, in the right colours."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from cltransfer.report.picture import write_picture


@pytest.mark.parametrize(("suffix", "off"), [(".png", 0), (".jpg", 3)])
def test_a_picture_comes_back_under_a_name_that_is_no_utf_8(tmp_path: Path, suffix: str, off: int) -> None:
    picture = np.full((16, 24, 3), (200, 100, 20), np.uint8)
    path = tmp_path / os.fsdecode(b"wom\xe9n") / f"a{suffix}"
    path.parent.mkdir()
    write_picture(path, picture)
    back = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_COLOR_RGB)
    assert int(np.abs(back.astype(int) - picture).max()) <= off
