"""A scene that is a person and nothing else: most of what a camera sees of it is empty."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cltransfer.config import load_config
from cltransfer.run.flags import run_flags
from cltransfer.scenes import Scene
from cltransfer.scenes.person.lifted import save_labels
from cltransfer.scenes.ply import write_splats
from cltransfer.scenes.simplify import subset
from cltransfer.scenes.splats import Splats
from cltransfer.shots import Setup, shot
from cltransfer.transfer import Inputs, Result, transfer

SMALL = ("search_side=64", "output_side=64", "threads=1", "extract.verify=false")


@pytest.fixture
def to_itself(courtyard: Scene, tmp_path: Path) -> Callable[..., Result]:
    """A shot of the courtyard's person before nothing, four heights away, taught to them there."""
    person, geometry = courtyard.subject, courtyard.geometry
    assert person is not None
    assert isinstance(geometry, Splats)
    alone = subset(geometry, geometry.label > 0.5)
    write_splats(tmp_path / "scene.ply", alone)
    person.save(tmp_path / "subject.json")
    save_labels(tmp_path, alone.label)

    def film(name: str, *overrides: str) -> Result:
        setup = Setup(distance=4.0, coverage=0.2)
        shot(name, person, (64, 36), 4, setup=setup).save(tmp_path / "shot.json")
        scene, (x, y, z) = str(tmp_path / "scene.ply"), courtyard.up.tolist()
        inputs = Inputs(scene, f"{scene}@{tmp_path / 'shot.json'}", subject=tmp_path / "subject.json", up=(x, y, z))
        return transfer(inputs, load_config("fast", overrides=[*SMALL, *overrides]))

    return film


@pytest.mark.parametrize("name", ["static", "push_in"])
def test_a_long_shot_of_a_person_before_nothing_is_found(to_itself: Callable[..., Result], name: str) -> None:
    """Where they cover less than a twentieth of the frame."""
    found = to_itself(name)
    assert found.searched.total < 0.05  # measured 0.000 and 0.007; 3.4 and 0.7 where such a view is too empty to take


def test_a_push_in_to_a_person_before_nothing_is_no_zoom(to_itself: Callable[..., Result]) -> None:
    """Nothing tells distance and focal length apart there: the lens is kept, and told to be."""
    found = to_itself("push_in")
    away = (found.trajectory.camera.center - found.scene.subject.anchor).norm(dim=1)
    assert float(away[-1] / away[0]) == pytest.approx(0.5, abs=0.02)  # 1 where the lens moved
    (told,) = [flag.reason for flag in run_flags(found) if "focal length kept" in flag.reason]
    assert ": with nothing before or behind the person in the reference it cannot be told apart" in told
    assert not found.schedule.free_lens
    assert to_itself("push_in", "zoom=free").schedule.free_lens
