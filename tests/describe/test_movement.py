"""Movement: the canonical shots get their names, from pixels' motion and from the cameras themselves."""

from dataclasses import replace

import pytest
import torch

from cltransfer.bench.describe import NAMES
from cltransfer.config import load_config
from cltransfer.describe.flow_motion import _windows, background_cells, flow_motion, robust_fit
from cltransfer.describe.motion import PRIMITIVES, Motion
from cltransfer.describe.movement import movement
from cltransfer.describe.path_motion import path_motion
from cltransfer.features import Features
from cltransfer.pipeline.components import SCENE_SOURCE, Components
from cltransfer.pipeline.graph import run_clip
from cltransfer.shots import SHOTS, builtin_reference, shot
from cltransfer.testing import sample_features, sample_subject

SIZE = (96, 54)


def flowing(right: float = 0.0, down: float = 0.0, growth: float = 0.0, frames: int = 8) -> Features:
    """Frames with a person in the middle whose background moves by so much a frame [frame widths, log size]."""
    width, height = SIZE
    y, x = torch.meshgrid(torch.arange(height) + 0.5 - height / 2, torch.arange(width) + 0.5 - width / 2, indexing="ij")
    flow = torch.stack([right * width + growth * x, down * width + growth * y]).expand(frames, 2, height, width).clone()
    flow[0] = float("nan")
    person = ((x.abs() < 8) & (y.abs() < 20)).expand(frames, height, width)
    layers = torch.stack([torch.zeros_like(person), person, ~person], dim=1)
    return Features(SIZE, flow=-flow, layers=layers, subject=person)


def named(features: Features, fps: float = 12.0) -> str | None:
    times = torch.arange(len(features)).double() / fps
    return movement(flow_motion(features, times)).name


@pytest.mark.parametrize(
    "name", ["push_in", "pan", "orbit", "zoom", "dolly_zoom", "dutch", "boom", "truck", "handheld"]
)
def test_a_canonical_shot_is_named_from_what_its_frames_show(name: str) -> None:
    scene, path = builtin_reference(name, SIZE, 16)
    parts = Components.build(load_config())
    plan = parts.plan("scene")
    buffers = plan.buffers - SCENE_SOURCE
    features = run_clip(plan, lambda a, b: parts.renderer.render(scene, path.camera[a:b], buffers), len(path))
    assert movement(flow_motion(features, path.times)).name == NAMES[name]


@pytest.mark.parametrize("name", SHOTS)
def test_a_canonical_shot_is_named_from_its_cameras(name: str) -> None:
    path = shot(name, sample_subject(), (160, 90), 24)
    assert movement(path_motion(path, sample_subject())).name == NAMES[name]


@pytest.mark.parametrize(
    ("motion", "name"),
    [({}, "static"), ({"right": -0.01}, "pan right"), ({"right": 0.01}, "pan left"), ({"down": 0.01}, "tilt up"),
     ({"down": -0.01}, "tilt down"), ({"growth": 0.03}, "zoom in"), ({"growth": -0.03}, "zoom out")],
)  # fmt: skip
def test_a_background_that_moves_as_one_is_a_turn_or_a_zoom(motion: dict[str, float], name: str) -> None:
    assert named(flowing(**motion)) == name


def test_a_person_who_walks_before_a_still_camera_does_not_move_it() -> None:
    features = flowing()
    flow = features.flow.clone()
    walking = features.layers[:, 1:2].expand(-1, 2, -1, -1).clone()
    walking[0] = False
    flow[walking] = 3.0
    assert named(replace(features, flow=flow)) == "static"


@pytest.mark.parametrize(("motion", "name"), [({"right": -0.02}, "truck right"), ({"growth": 0.04}, "push in")])
@pytest.mark.parametrize("seen", [8, 4, 2])
def test_a_person_seen_in_some_frames_alone_is_not_held_in_place(
    motion: dict[str, float], name: str, seen: int
) -> None:
    far, near = flowing(**motion), flowing(**{key: 2 * value for key, value in motion.items()})
    flow, width = far.flow.clone(), SIZE[0]
    below = torch.arange(width)[None, None, None] % 32 < 16  # of the background half is nearer: parallax
    flow = torch.where(below | far.layers[:, 1:2], near.flow, flow)
    layers = far.layers.clone()
    layers[seen:, 2] |= layers[seen:, 1]
    layers[seen:, 1] = False
    assert named(replace(far, flow=flow, layers=layers)) == name


@pytest.mark.parametrize(
    ("far", "near", "name"),
    [({"growth": 0.02}, {"growth": 0.08}, "push in"), ({"right": -0.01}, {"right": -0.04}, "truck right")],
)
def test_a_person_who_is_farther_than_most_of_the_scenery_is_not_held_in_place(
    far: dict[str, float], near: dict[str, float], name: str
) -> None:
    features = flowing(**far)
    below = (torch.arange(SIZE[1]) >= SIZE[1] / 2)[:, None] & ~features.layers[:, 1:2]
    assert named(replace(features, flow=torch.where(below, flowing(**near).flow, features.flow))) == name


def noisy(fps: int, near: float) -> Features:
    """1.5 s whose background goes by at 0.05 frame widths a second, its lower half ``near`` times as fast as the rest.

    The person goes by with the lower half. What is read of every step has the same noise, however short it is.
    """
    frames = 1 + 3 * fps // 2
    far, close = (flowing(right=-0.05 * speed / fps, frames=frames) for speed in (1, near))
    below = (torch.arange(SIZE[1]) >= SIZE[1] / 2)[:, None] | far.layers[:, 1:2]
    noise = 0.05 * torch.randn(far.flow.shape, generator=torch.Generator().manual_seed(1))  # [px]
    return replace(far, flow=torch.where(below, close.flow, far.flow) + noise)


@pytest.mark.parametrize("fps", [12, 30, 60])
def test_how_many_frames_a_second_has_tells_no_pan_from_a_truck(fps: int) -> None:
    assert named(noisy(fps, near=1), fps) == "pan right"
    assert named(noisy(fps, near=2.5), fps) == "truck right"


def test_a_part_of_the_background_that_some_frames_lack_is_no_parallax() -> None:
    features = noisy(60, near=1)
    layers = features.layers.clone()
    layers[::5, 2, : SIZE[1] // 2] = False
    layers[1::2, 2, SIZE[1] // 2 :, : SIZE[0] // 4] = False
    assert named(replace(features, layers=layers), 60) == "pan right"


@pytest.mark.parametrize(
    ("steps", "windows"),
    [((), [0]), ((1.0, 1.0), [0, 1, 2]), ((0.083, 0.084, 0.083), [0, 1, 2, 3]), ((0.02, 0.02), [0, 1, 1]),
     ((0.04,) * 5, [0, 1, 1, 2, 2, 2]), ((0.04, 0.2, 0.1, 0.02), [0, 1, 1, 2, 2])],
)  # fmt: skip
def test_short_steps_are_summed_to_a_twelfth_of_a_second_and_longer_ones_stand_alone(
    steps: tuple[float, ...], windows: list[int]
) -> None:
    assert _windows(torch.tensor([0.0, *steps]).cumsum(0)).tolist() == windows


def test_fast_zooms_and_pans_have_names_of_their_own() -> None:
    assert named(flowing(growth=0.15)) == "crash zoom"
    assert named(flowing(right=-0.2)) == "whip pan"


@pytest.mark.parametrize("steps", [(1, 1, 1), (1, 2, 1, 3), (2, 3), (5, 6)])
def test_how_fast_a_steady_pan_is_does_not_depend_on_how_its_frames_are_spaced(steps: tuple[int, ...]) -> None:
    """A whip pan is one of 1.1 frame sides a second."""
    times = torch.tensor([0, *(steps * 12)[:12]]).cumsum(0).double() / 24
    for speed, name in ((1.0, "pan right"), (1.2, "whip pan")):
        rates = torch.zeros(len(times), len(PRIMITIVES), dtype=torch.float64)
        rates[1:, PRIMITIVES.index("pan")] = speed * times.diff()
        assert movement(Motion(rates, times, 0.0)).name == name


def test_upright_and_wide_frames_agree() -> None:
    def turned(value: torch.Tensor) -> torch.Tensor:
        return value.transpose(-1, -2)

    wide = flowing(right=-0.02)
    upright = Features(
        (SIZE[1], SIZE[0]), flow=turned(wide.flow).flip(1), layers=turned(wide.layers), subject=turned(wide.subject)
    )
    times = torch.arange(len(wide)).double()
    ahead, up = flow_motion(wide, times).track[-1], flow_motion(upright, times).track[-1]
    torch.testing.assert_close(ahead[0], -up[1], atol=1e-9, rtol=0)


def test_outliers_of_the_flow_do_not_move_the_fit() -> None:
    features = flowing(right=-0.02)
    velocity, there, place = background_cells(features)
    design = torch.eye(2, dtype=torch.float64).expand(len(place), 2, 2)
    clean, _ = robust_fit(design, velocity, there)
    velocity[:, ::9] += 0.3
    spoilt, _ = robust_fit(design, velocity, there)
    assert (clean - spoilt)[1:].abs().max() < 0.004  # the mean moves by 0.033


def test_frames_without_a_background_are_not_read() -> None:
    features = flowing(right=-0.02)
    layers = features.layers.clone()
    layers[3:5, 2] = False
    motion = flow_motion(replace(features, layers=layers), torch.arange(8).double())
    assert motion.read == 6
    assert torch.isfinite(motion.track).all()


def test_a_still_camera_that_is_read_with_noise_stands_still_however_long() -> None:
    random, times = torch.Generator().manual_seed(2), torch.arange(480).double() / 24
    place = 0.001 * torch.randn(480, len(PRIMITIVES), generator=random, dtype=torch.float64)
    rates = torch.cat([torch.zeros(1, len(PRIMITIVES), dtype=torch.float64), place.diff(dim=0)])
    rates[:, 2:] = 0
    rates[:, 1:] *= 0.1
    assert movement(Motion(rates, times, 0.0)).text == "static"


@pytest.mark.parametrize(("back", "text"), [(1.0, "pan right and back"), (0.6, "pan right and back")])
@pytest.mark.parametrize("seconds", [2.0, 8.0])
def test_a_move_that_comes_back_is_not_handheld(back: float, text: str, seconds: float) -> None:
    times = torch.linspace(0, seconds, 49).double()
    there = torch.sin(torch.pi * torch.linspace(0, 1, 49).double()) ** 2
    there[24:] = 1 - back * (1 - there[24:])
    rates = torch.zeros(49, len(PRIMITIVES), dtype=torch.float64)
    rates[1:, PRIMITIVES.index("pan")] = 0.35 * there.diff()
    found = movement(Motion(rates, times, 0.0))
    assert (found.text, found.handheld) == (text, False)


def test_shaking_is_handheld_and_a_shaking_pan_says_both() -> None:
    random = torch.Generator().manual_seed(0)
    times = torch.arange(24).double() / 12
    rates = torch.zeros(24, len(PRIMITIVES), dtype=torch.float64)
    rates[1:, 0] = 0.05 * torch.randn(23, generator=random, dtype=torch.float64)
    rates[1:, 0] -= rates[1:, 0].mean()
    assert movement(Motion(rates, times, 0.0)).name == "handheld"
    rates[1:, 0] += 0.03
    assert movement(Motion(rates, times, 0.0)).text == "pan right, handheld"


def test_where_no_motion_was_read_none_is_told() -> None:
    one = movement(flow_motion(sample_features(0, 1), torch.zeros(1).double()))
    assert (one.name, one.text) == (None, "not told (one frame does not move)")
    features = flowing(right=-0.02)
    layers = features.layers.clone()
    layers[:, 2] = False
    unread = movement(flow_motion(replace(features, layers=layers), torch.arange(8).double()))
    assert (unread.name, unread.text) == (None, "not told (no frame's motion could be read)")


def test_one_step_that_was_read_is_enough_to_stand_still() -> None:
    features = flowing()
    layers = features.layers.clone()
    layers[2:, 2] = False
    assert named(replace(features, layers=layers)) == "static"


def test_layers_of_fewer_pixels_than_the_flow_tell_the_same_movement() -> None:
    features = flowing(right=-0.02)
    few = replace(features, layers=features.layers[..., ::2, ::2])
    assert named(few) == named(features)
