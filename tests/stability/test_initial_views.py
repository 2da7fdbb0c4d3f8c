"""A given first view is one start among others: whatever it is, the search ends in the same cameras."""

import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.scenes import Scene
from cltransfer.shots import Setup, shot
from cltransfer.trajectory import Trajectory
from cltransfer.transfer import Inputs, transfer

SMALL = ("search_side=96", "output_side=160", "threads=1")
VIEWS = {"right behind": (180.0, 2.0), "aside": (95.0, 6.0), "near": (-40.0, 1.1)}


@pytest.fixture(scope="module")
def found(courtyard: Scene, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Camera]:
    """Where a search ends that was given each of the views."""
    folder = tmp_path_factory.mktemp("views")
    subject = courtyard.subject
    assert subject is not None
    shot("push_in", subject, (160, 90), 4).save(folder / "shot.json")
    ends = {}
    for name, (azimuth, distance) in VIEWS.items():
        view = shot("static", subject, (160, 90), 1, setup=Setup(math.radians(azimuth), distance=distance))
        view.save(folder / "view.json")
        inputs = Inputs("builtin:courtyard", f"builtin:courtyard@{folder / 'shot.json'}", str(folder / "view.json"))
        ends[name] = transfer(inputs, load_config(overrides=SMALL)).trajectory.camera
    ends["true"] = Trajectory.load(folder / "shot.json").camera
    return ends


@pytest.mark.parametrize("view", VIEWS)
def test_the_true_camera_is_found_from_any_view(found: dict[str, Camera], courtyard: Scene, view: str) -> None:
    assert courtyard.subject is not None
    off = (found[view].center - found["true"].center).norm(dim=1) / courtyard.subject.height
    assert float(off.max()) < 0.05


def test_all_views_end_in_the_same_camera(found: dict[str, Camera], courtyard: Scene) -> None:
    assert courtyard.subject is not None
    ends = torch.stack([found[view].center for view in VIEWS])  # (V, N, 3)
    apart = (ends - ends[:1]).norm(dim=-1) / courtyard.subject.height
    assert float(apart.max()) < 0.03
