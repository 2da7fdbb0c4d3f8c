"""Two methods on two samples, as clips of a second."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cltransfer.clips.clip import write_video
from cltransfer.study.build import Wanted, build_study

METHODS = ("quetzal", "ibex")  # names that occur nowhere else


@pytest.fixture
def clips(tmp_path: Path) -> Wanted:
    """Clips of noise: quetzal/1, ibex/1, quetzal/2, ibex/2 and the references of both."""
    generator = torch.Generator().manual_seed(0)
    paths = [tmp_path / f"{name}{i}.mp4" for i in (1, 2) for name in (*METHODS, "reference")]
    for path in paths:
        image = torch.randint(0, 255, (6, 3, 36, 64), dtype=torch.uint8, generator=generator)
        write_video(path, image, torch.arange(6) / 12)
    runs, references = [p for p in paths if "reference" not in p.name], [p for p in paths if "reference" in p.name]
    return Wanted(tuple(runs), METHODS, tuple(references), seed=5)


@pytest.fixture
def page(clips: Wanted, tmp_path: Path) -> tuple[Path, Path]:
    """The page's folder and the key."""
    _, key = build_study(clips, tmp_path / "page")
    return tmp_path / "page", key
