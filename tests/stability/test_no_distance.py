"""No distance suits: what stands before and behind the person, on the side that the reference is filmed from.

A tilt from behind a post; in the courtyard no column stands there, but a little aside. A handheld shot from whose side
the depth of what is behind the person jumps: a tolerance higher another part of it gets the larger.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.bench.driver import drawn
from cltransfer.config import load_config
from cltransfer.run.inputs import Inputs
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot
from cltransfer.transfer import transfer

SMALL = ("search_side=96", "output_side=96", "threads=1", "extract.verify=false")


@pytest.mark.parametrize("about", ["body", "shown"])
def test_the_clip_is_filmed_from_a_little_aside(tmp_path: Path, about: str) -> None:
    """Followed from where it was read it ends at 10, the lens as wide as there is."""
    path = tmp_path / "shot.json"
    shot("tilt", load_scene("builtin:plaza").person, (160, 90), 4, setup=drawn("tilt", 670)).save(path)
    config = load_config("fast", overrides=[*SMALL, f"extractors.scene_orientation.about={about}"])
    result = transfer(Inputs("builtin:courtyard", f"builtin:plaza@{path}"), config)
    assert result.searched.total < 4
    angle = result.searched.term("camera_angle")
    assert angle is not None
    assert 0.1 < float(angle.values.mean()) < 0.5  # rad: paid for the rest


def test_a_depth_that_jumps_is_seen_from_a_tolerance_aside(tmp_path: Path) -> None:
    """From where it was read one frame costs 0.3 and the next 5, and a path far away ends at 1.3."""
    path = tmp_path / "shot.json"
    shot("handheld", load_scene("builtin:plaza").person, (160, 90), 4, setup=drawn("handheld", 653)).save(path)
    result = transfer(Inputs("builtin:courtyard", f"builtin:plaza@{path}"), load_config("fast", overrides=[*SMALL]))
    assert result.searched.total < 0.6
    angle = result.searched.term("camera_angle")
    assert angle is not None
    assert float(angle.values.max()) < 0.12  # rad
