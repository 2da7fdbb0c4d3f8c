"""Camera paths in words: what comes back, what passes by, what shakes for long, what looks straight down."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from cltransfer.camera import Camera
from cltransfer.describe.description import Description, describe_features
from cltransfer.describe.path_motion import path_motion
from cltransfer.describe.sources import path_features
from cltransfer.testing.samples import sample_subject
from cltransfer.trajectory import Trajectory

PERSON = sample_subject()
RIGHT = torch.linalg.cross(-PERSON.facing, PERSON.up)  # of a camera before the person
Place = Callable[[float], Tensor]


def there_and_back(share: float) -> float:
    return math.sin(math.pi * share) ** 2


def filmed(eye: Place, target: Place, fov: Callable[[float], float] = lambda share: 0.7, seconds: float = 1.0) -> str:
    """In words, cameras at ``eye`` [heights from the person] that look at ``target``, by the share of the clip."""
    return described(eye, target, fov, seconds).text()


def described(
    eye: Place, target: Place, fov: Callable[[float], float] = lambda share: 0.7, seconds: float = 1.0
) -> Description:
    shares = torch.linspace(0, 1, round(24 * seconds), dtype=torch.float64).tolist()
    places, looks = (torch.stack([place(x) for x in shares]) for place in (eye, target))
    views = torch.tensor([fov(x) for x in shares], dtype=torch.float64)
    tall, middle = PERSON.height, PERSON.anchor
    camera = Camera.look_at(middle + tall * places, middle + tall * looks, PERSON.up, views, (640, 360))
    path = Trajectory(camera, torch.tensor(shares, dtype=torch.float64) * seconds)
    features, motion = path_features(path, PERSON), path_motion(path, PERSON)
    return describe_features("path", features, path.times, motion, {})


def middle(share: float) -> Tensor:
    return torch.zeros(3, dtype=torch.float64)


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.01])
@pytest.mark.parametrize("back", [1.0, 0.97])
def test_an_orbit_that_comes_back_is_one(noise: float, back: float) -> None:
    random = torch.Generator().manual_seed(0)

    def angle(share: float) -> float:
        moved = there_and_back(share)
        return 0.8 * (moved if share < 0.5 else 1 - back * (1 - moved))

    def eye(share: float) -> Tensor:
        return 2.8 * (math.cos(angle(share)) * PERSON.facing + math.sin(angle(share)) * RIGHT)

    def aim(share: float) -> Tensor:
        return 2.8 * noise * torch.randn(3, generator=random, dtype=torch.float64)

    assert described(eye, aim).movement.name == "orbit right"
    assert described(eye, aim).movement.returns


def test_a_crane_that_comes_back_is_a_boom() -> None:
    said = filmed(lambda share: 2.8 * PERSON.facing + 0.8 * there_and_back(share) * PERSON.up, middle)
    assert "boom up and back" in said


def test_a_turn_without_travel_is_a_pan_and_one_with_it_beside_the_person_both() -> None:
    def ahead(share: float) -> Tensor:
        return (0.6 * share - 0.3) * RIGHT

    assert "pan right" in filmed(lambda share: 2.8 * PERSON.facing, ahead)
    assert "truck right" in filmed(lambda share: 2.8 * PERSON.facing + ahead(share), ahead)


def test_a_push_past_the_person_goes_one_way() -> None:
    def eye(share: float) -> Tensor:
        return (2 - 4 * share) * PERSON.facing + 0.8 * RIGHT

    found = described(eye, lambda share: eye(share) - PERSON.facing).movement
    assert (found.name, found.returns) == ("push in", False)


def test_a_push_is_as_long_as_the_log_of_the_distances() -> None:
    found = described(lambda share: (4 - 2 * share) * PERSON.facing, middle)
    assert found.motion.track[-1, 4] / 0.4 == pytest.approx(math.log(2), rel=1e-3)


def test_a_dolly_zoom_that_comes_back_is_one() -> None:
    def away(share: float) -> float:
        return 2 + 2 * there_and_back(share)

    said = filmed(lambda share: away(share) * PERSON.facing, middle, lambda share: 2 * math.atan(0.7 / away(share)))
    assert "dolly zoom and back" in said


@pytest.mark.parametrize("seconds", [2, 4, 16, 30])
def test_a_hand_does_not_drown_a_push_however_long_it_holds(seconds: int) -> None:
    random = torch.Generator().manual_seed(1)
    phase = 2 * math.pi * torch.rand(9, generator=random, dtype=torch.float64)

    def sway(share: float, way: int, size: float) -> float:
        waves = enumerate(((0.35, 1.0), (0.8, 0.5), (1.45, 0.25)))
        time = share * seconds
        return size * sum(w * math.sin(2 * math.pi * f * time + float(phase[3 * way + i])) for i, (f, w) in waves)

    def held(share: float) -> Tensor:
        return sway(share, 0, 0.02) * RIGHT + sway(share, 1, 0.015) * PERSON.up

    def aim(share: float) -> Tensor:
        return sway(share, 2, 0.04) * RIGHT

    pushed = filmed(lambda share: (4 - 2 * share) * PERSON.facing + held(share), aim, seconds=seconds)
    assert "push in, handheld" in pushed
    alone = described(lambda share: 3 * PERSON.facing + held(share), aim, seconds=seconds)
    assert alone.movement.handheld
    assert seconds == 2 or alone.movement.name == "handheld"  # in two seconds the slowest wave is a pan


@pytest.mark.parametrize("aside", [(0.0, 0.0), (0.05, 0.0), (0.0, 0.05)])
def test_from_right_above_nobody_has_a_side_and_no_camera_is_canted(aside: tuple[float, float]) -> None:
    over = aside[0] * RIGHT + aside[1] * PERSON.facing
    flat = PERSON.up * 3.5 + over
    said = filmed(lambda share: flat + 1e-6 * PERSON.facing, lambda share: over)
    assert "overhead" in said
    for word in ("Dutch", "from", "None"):
        assert word not in said
