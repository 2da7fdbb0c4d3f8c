"""Descriptions of what networks read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cltransfer.clips.clip import read_clip, write_video
from cltransfer.config import load_config
from cltransfer.describe.sources import describe
from cltransfer.storage.run_files import DONE, FRAMES, MANIFEST


def test_a_run_that_has_lost_its_path_is_told_to_be_read_as_a_clip(
    networks: tuple[str, ...], film: Callable[..., Path], tmp_path: Path
) -> None:
    clip, run, config = read_clip(film("static", 3)), tmp_path / "run", load_config(overrides=networks)
    (run / FRAMES).parent.mkdir(parents=True)
    write_video(run / FRAMES, clip.image, clip.times, lossless=True)
    (run / MANIFEST).write_text('{"format": "cltransfer.run"}')
    (run / DONE).write_text("")
    note = "the run has no trajectory.json: read from its frames, as a clip is"
    assert note in describe(str(run), config)[0].flags
    assert note not in describe(str(run / FRAMES), config)[0].flags
