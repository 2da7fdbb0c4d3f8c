"""What the name of a reference says it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from cltransfer.components import Components
from cltransfer.config import load_config
from cltransfer.errors import InputError
from cltransfer.reference import Reading, read_reference


@pytest.mark.parametrize("scene", ["scene.ply", "scenes/scene.ply"])
@pytest.mark.parametrize("path", ["path.json", "paths/path.json"])
def test_a_scene_with_a_trajectory_may_lie_in_other_folders(scene: str, path: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_reference(f"{tmp_path / scene}@{tmp_path / path}", Components.build(load_config()), Reading())
    assert str(caught.value) == f"{tmp_path / path}: no such file"  # and not a clip of that long name
