"""What this computer remembers of scenes helps later, and costs nothing that is finished."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cltransfer.errors import InputError
from cltransfer.reading.named_scenes import load_reference_scene, recall, remember
from cltransfer.scenes.load import load_scene
from cltransfer.shots import shot
from cltransfer.trajectory import Trajectory


def test_a_scene_is_recalled_by_its_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    remember("ab12", str(tmp_path / "scene.ply"))
    assert recall("ab12") == str(tmp_path / "scene.ply")
    with pytest.raises(InputError, match="has not seen the scene"):
        recall("ab13")
    for damaged in ("{}", "[]", '{"path": 3}'):
        (tmp_path / "cache" / "scenes" / "ab13.json").write_text(damaged)
        with pytest.raises(InputError, match="has not seen the scene"):
            recall("ab13")


def test_a_cache_that_cannot_be_written_is_told_and_loses_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "cache").write_text("a file where the folder should be")
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    remember("ab12", "builtin:courtyard")
    (line,) = caplog.messages
    assert "ab12.json" in line
    assert "a later render needs --scene builtin:courtyard" in line


@pytest.mark.parametrize(("frames", "count"), [(None, 24), (6, 6)])
def test_a_built_in_shot_is_made_of_so_many_frames_and_is_not_thinned(frames: int | None, count: int) -> None:
    _, path = load_reference_scene("builtin:push_in", frames, 160)
    assert path.times.tolist() == pytest.approx([i / 12 for i in range(count)])


def test_a_path_is_thinned_by_its_times_as_a_clip_is(tmp_path: Path) -> None:
    """Eight frames of a third of a second, then two of a second each: as a run leaves of a clip that was thinned."""
    plaza = load_scene("builtin:plaza")
    cameras = shot("push_in", plaza.subject, (160, 90), 10).camera
    times = torch.tensor([*(0.04 * k for k in range(8)), 1.0, 2.0], dtype=torch.float64)
    Trajectory(cameras, times).save(tmp_path / "trajectory.json")
    _, thinned = load_reference_scene(f"builtin:plaza@{tmp_path / 'trajectory.json'}", 3, 160)
    assert thinned.times.tolist() == pytest.approx([0.0, 1.0, 2.0])
    torch.testing.assert_close(thinned.camera.w2c, cameras[[0, 8, 9]].w2c)
