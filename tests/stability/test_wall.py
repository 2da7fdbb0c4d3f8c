"""A wall right before the person, on the side that a reference was filmed from: what is found is told to be far off."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.pipeline.scores import Scores
from cltransfer.run.flags import run_flags
from cltransfer.scenes import Scene
from cltransfer.scenes.simplify import joined, subset
from cltransfer.scenes.splats import Splats
from cltransfer.transfer import Inputs, Result, transfer

SMALL = ("frames=2", "search_side=64", "output_side=64", "threads=1", "extract.verify=false")


def walled(scene: Scene) -> Scene:
    """The scene with a wall four heights wide and two high, a quarter of a height before the person."""
    person, splats = scene.subject, scene.geometry
    assert person is not None
    assert isinstance(splats, Splats)
    across, upward = (torch.arange(low, high, 0.05, dtype=torch.float64) for low, high in ((-2.0, 2.0), (-0.6, 1.5)))
    x, z = (part.flatten()[:, None] for part in torch.meshgrid(across, upward, indexing="ij"))
    means = person.anchor + person.height * (x * person.left + 0.25 * person.facing + z * person.up)
    n = len(means)
    part = replace(
        subset(splats, torch.zeros(n, dtype=torch.int64)),
        means=means.to(splats.means),
        scales=torch.full((n, 3), 0.05),
        opacity=torch.full((n,), 0.99),
        label=torch.zeros(n),
    )
    digest = hashlib.sha256(f"a wall before {scene.digest}".encode()).hexdigest()
    return Scene(joined(splats, part), person, scene.up, "wall", digest)


def found(scene: Scene) -> Result:
    return transfer(Inputs(scene, "builtin:push_in"), load_config("fast", overrides=SMALL))


@pytest.fixture(scope="module")
def free(courtyard: Scene) -> Result:
    return found(courtyard)


def told(result: Result) -> list[str]:
    return [flag.reason for flag in run_flags(result) if "like the reference" in flag.reason]


def test_that_no_view_is_like_the_references_is_told(courtyard: Scene, free: Result) -> None:
    behind = found(walled(courtyard))
    assert told(free) == []
    assert behind.searched.total > 5
    (reason,) = told(behind)
    angle = behind.searched.term("camera_angle")
    assert angle is not None
    assert reason.startswith("no view that was found is like the reference's, in the search's mean: ")
    assert f"camera_angle {angle.mean:.3g} rad off" in reason
    assert "framing" not in reason


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"camera_angle": 0.49}, []),  # of weight 4
        ({"camera_angle": 0.51}, ["camera_angle 0.51 rad off"]),
        ({"camera_angle": 0.6, "filmic_space": 0.9}, ["filmic_space 0.9 log ratio off, camera_angle 0.6 rad off"]),
        ({"shot_size": torch.nan}, ["shot_size undefined"]),
    ],
)
def test_a_term_of_ten_tolerances_is_far_off(free: Result, values: dict[str, float], said: list[str]) -> None:
    terms = [replace(t, values=torch.full((2,), values.get(t.name, 0.0)).double()) for t in free.searched.terms]
    searched = Scores(tuple(terms), free.searched.totals)
    assert [reason.split(": ")[1] for reason in told(replace(free, searched=searched))] == said
