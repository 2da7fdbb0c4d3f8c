"""Small transfers on built-in scenes: seconds each, on one thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from cltransfer.config import load_config
from cltransfer.config.options import RunConfig
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.reading.reference import Reading, read_reference
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import Setup, shot
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, Result, transfer

SMALL = ("search_side=96", "output_side=160", "path=exact", "threads=1", "extract.verify=false")


def config_of(*overrides: str) -> RunConfig:
    return load_config(overrides=[*SMALL, *overrides])


@pytest.fixture(scope="session")
def courtyard() -> Scene:
    return builtin_scene("courtyard")


@pytest.fixture
def filmed(courtyard: Scene, tmp_path: Path) -> Callable[..., tuple[str, Trajectory]]:
    """A shot in the courtyard: as a reference, and its true cameras."""

    def film(name: str, frames: int = 5, size: tuple[int, int] = (160, 90), **setup: object) -> tuple[str, Trajectory]:
        assert courtyard.subject is not None
        cameras = shot(name, courtyard.subject, size, frames, setup=Setup(**setup))  # type: ignore[arg-type]
        path = tmp_path / f"{name}.json"
        cameras.save(path)
        return f"builtin:courtyard@{path}", cameras

    return film


@pytest.fixture(scope="session")
def solve() -> Callable[..., Result]:
    """Transfer a reference into a scene, the courtyard by default."""

    def run(reference: str, *overrides: str, scene: str = "builtin:courtyard") -> Result:
        return transfer(Inputs(scene, reference), config_of(*overrides))

    return run


@pytest.fixture
def edited(tmp_path: Path) -> Callable[..., str]:
    """A reference as a feature file, after ``change``."""

    def edit(source: str, change: Callable[[Features], Features], frames: int | None = None) -> str:
        parts = Components.build(config_of())
        read = read_reference(source, parts, Reading(frames, 160))
        path = tmp_path / "edited.safetensors"
        FeatureFile(change(read.features), read.times, "edited").save(path)
        return str(path)

    return edit


@pytest.fixture
def blanked() -> Callable[..., Callable[[Features], Features]]:
    """A change that takes the person out of some frames."""

    def blank(frames: list[int]) -> Callable[[Features], Features]:
        def change(features: Features) -> Features:
            new = {n: features.require(n).clone() for n in ("keypoints", "orientation", "subject", "layers")}
            for name in ("keypoints", "orientation"):
                new[name][frames] = float("nan")
            new["subject"][frames] = False
            new["layers"][frames, 1] = False
            return replace(features, **new)

        return change

    return blank


def errors(found: Result, truth: Trajectory) -> tuple[float, float, float]:
    """Largest error of position [subject heights], rotation [degrees] and focal length [%]."""
    assert found.scene.subject is not None
    ours, true = found.trajectory.camera, truth.camera.at_size(found.trajectory.camera.size)
    position = (ours.center - true.center).norm(dim=1) / found.scene.subject.height
    turn = ours.w2c[:, :3, :3] @ true.w2c[:, :3, :3].transpose(1, 2)
    cosine = (turn.diagonal(dim1=1, dim2=2).sum(1) - 1) / 2
    rotation = torch.rad2deg(torch.acos(cosine.clamp(-1, 1)))
    focal = 100 * (ours.focal / true.focal - 1).abs()
    return float(position.max()), float(rotation.max()), float(focal.max())


@pytest.fixture
def errors_of() -> Callable[[Result, Trajectory], tuple[float, float, float]]:
    return errors


@pytest.fixture
def sound() -> Callable[[Result], None]:
    """Whatever the reference was: finite rigid cameras, every frame there, finite totals where anything is measured,
    and that somewhere."""

    def check(found: Result) -> None:
        camera = found.trajectory.camera
        assert len(camera) == len(found.reference)
        assert bool(torch.isfinite(camera.w2c).all() and torch.isfinite(camera.K).all())
        R: Tensor = camera.w2c[:, :3, :3]
        torch.testing.assert_close(R @ R.transpose(1, 2), torch.eye(3, dtype=R.dtype).expand_as(R), atol=1e-6, rtol=0)
        assert bool((camera.focal > 0).all())
        for scores in (found.searched, found.verified, found.held):
            measured = torch.stack([term.values.isfinite() for term in scores.terms]).any(0)
            assert bool(measured.any())
            assert bool(scores.totals[measured].isfinite().all())

    return check
