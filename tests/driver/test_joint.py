"""Paths refined as a whole: they cost less, move smoothly, and a static one stays static."""

import math
from dataclasses import replace
from functools import cached_property
from typing import Any

import pytest
import torch
from torch import Tensor

from cltransfer.along_clip import along
from cltransfer.config import load_config
from cltransfer.driver.joint import WIDE, Effort, Moves, broyden, faded, refine_path
from cltransfer.driver.jumps import Jumps
from cltransfer.driver.refine import STEP
from cltransfer.driver.spline import Local
from cltransfer.driver.stage import Stage, read_path
from cltransfer.driver.whole_clip import WholeClip, between
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.scenes.load import load_scene
from cltransfer.search.subject_orbit import SCALE, SubjectOrbit
from cltransfer.shots import shot

FRAMES, D = 12, 7


def clip_of(name: str, frames: int = FRAMES, *without: str) -> tuple[WholeClip, Tensor]:
    """A shot in the plaza, ``without`` some losses, and its own path (N, 7)."""
    scene, parts, search = load_scene("builtin:plaza"), Components.build(load_config()), SubjectOrbit()
    losses = {loss: part for loss, part in parts.losses.items() if loss not in without}
    assert scene.subject is not None
    path = shot(name, scene.subject, (96, 54), frames).camera
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(losses), (96, 54))
    return WholeClip(stage, search, read_path(stage, path), path[0]), search.vector(path, path[0], scene.subject)


def refined(clip: WholeClip, x: Tensor, moves: Moves, rounds: int) -> tuple[Tensor, float]:
    """The path refined, and its mean total."""
    x, residuals = refine_path(clip, x, clip.residuals(x), moves, Effort(rounds, 4))
    return x, clip.mean_total(residuals)


class Watched(WholeClip):
    """A clip that remembers how wide its differences were."""

    @cached_property
    def widths(self) -> list[float]:
        return []

    def local(self, x: Tensor, residuals: Tensor, step: float = STEP, *rest: Any, **named: Any) -> Local:
        self.widths.append(step)
        return super().local(x, residuals, step, *rest, **named)


def shake(x: Tensor) -> float:
    """Mean third difference of a path (N, D)."""
    return float(x.diff(n=3, dim=0).abs().mean())


def test_a_path_beside_the_true_one_comes_back_without_shaking() -> None:
    clip, true = clip_of("push_in")
    bent = true + 0.1 * torch.sin(torch.linspace(0, 3, FRAMES, dtype=torch.float64))[:, None]
    x, total = refined(clip, bent, Moves(6, None, fade=True), rounds=2)
    assert total < 0.3 * clip.total(bent)
    assert total == pytest.approx(clip.total(x), abs=1e-9)
    assert shake(x) < shake(bent) + 0.01


@pytest.mark.parametrize(
    ("off", "enough", "rounds", "widths"),
    [
        (0.0, math.inf, 4, [0.1]),
        (0.0, -1.0, 4, [0.1, 0.025]),
        (0.0, -1.0, 1, [0.02]),
        (0.1, math.inf, 2, [0.1, 0.05]),
    ],
    ids=["nothing to gain, and good enough", "nothing to gain, and not good enough", "one round", "a gain"],
)
def test_differences_get_narrower_until_the_path_is_good_enough(
    off: float, enough: float, rounds: int, widths: list[float]
) -> None:
    found, true = clip_of("static", 4)
    clip = Watched(found.stage, found.search, found.reference, found.home)
    refined(clip, true + off, Moves(4, None, fade=True, enough=enough), rounds)
    assert clip.widths == widths


@pytest.mark.parametrize("knots", [1, 2])
def test_a_static_or_linear_path_stays_one(knots: int) -> None:
    clip, true = clip_of("static")
    x, total = refined(clip, true + 0.05, Moves(knots, None, fade=False), rounds=1)
    assert total < clip.total(true + 0.05)
    assert float(x.diff(n=knots, dim=0).abs().max()) < 1e-9


def test_a_round_goes_on_while_its_steps_save_much_and_no_longer() -> None:
    clip, true = clip_of("push_in", FRAMES, "filmic_space")  # which jumps
    x = true + 0.1 * torch.sin(torch.linspace(0, 3, FRAMES, dtype=torch.float64))[:, None]
    residuals, moves = clip.residuals(x), Moves(6, None, fade=False)
    paths = []
    for _ in range(2):
        before = clip.stage.spent.evaluations
        x, residuals = refine_path(clip, x, residuals, moves, Effort(1, 1))
        paths.append((clip.stage.spent.evaluations - before) / FRAMES - 1)  # one is what differences take
    assert paths == [3, 0]
    assert clip.mean_total(residuals) < 0.02


def test_what_was_led_across_a_jump_is_not_led_again(monkeypatch: pytest.MonkeyPatch) -> None:
    clip, true = clip_of("push_in")
    x = true + 0.1 * torch.sin(torch.linspace(0, 3, FRAMES, dtype=torch.float64))[:, None]
    before, led, lead = clip.residuals(x), [], Jumps.local

    def watched(jumps: Jumps, measured: Local) -> Local:
        led.append(int(jumps.led.sum()))
        return lead(jumps, measured)

    monkeypatch.setattr(Jumps, "local", watched)
    x, after = refine_path(clip, x, before, Moves(6, None, fade=False), Effort(2, 1))
    assert led == [2, 2]  # where the round begins and after its step; none in the second one
    torch.testing.assert_close(clip.residuals(x), after)
    assert clip.mean_total(after) < clip.mean_total(before)


def test_a_lens_that_is_kept_stays_still_while_the_camera_moves() -> None:
    clip, true = clip_of("push_in")
    way = clip.lens(D)
    assert way is not None
    bent = true + 0.1 * torch.sin(torch.linspace(0, 3, FRAMES, dtype=torch.float64))[:, None]
    x, _ = refined(clip, bent, Moves(4, way, fade=True), rounds=1)
    focal, before = (clip.cameras(path).focal.log() for path in (x, bent))
    assert float((focal - before).std()) < 1e-9
    assert float((x - bent).std(0).max()) > 1e-2


def test_frames_that_lose_by_a_move_keep_out_of_it() -> None:
    clip, true = clip_of("push_in")
    half = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None] > 0.5
    bent = true + 0.2 * along(half.double(), 2.0)  # the first half is right already
    x, total = refined(clip, bent, Moves(2, None, fade=True), rounds=1)
    _, stiff = refined(clip, bent, Moves(2, None, fade=False), rounds=1)
    assert total < stiff
    assert float((x - true)[:3].abs().max()) < 0.05


def test_corrected_jacobians_explain_what_was_seen_and_change_nothing_across() -> None:
    torch.manual_seed(0)
    paired = torch.tensor([False, True, True])
    local = Local(torch.rand(4, 3).double(), torch.rand(4, 3, 2).double(), torch.tensor([0, 1, 1]), paired)
    move, seen = torch.rand(4, 2).double() + 0.1, torch.rand(4, 3).double()
    corrected = replace(local, jacobian=broyden(local, move, seen))
    predicted = local.residuals.ravel() + torch.from_numpy(corrected.slope @ move.numpy().ravel())
    torch.testing.assert_close(predicted.reshape(4, 3), seen)
    across = torch.stack([-move[0, 1], move[0, 0]])
    torch.testing.assert_close(corrected.jacobian[0] @ across, local.jacobian[0] @ across)


def test_frames_share_what_they_measure() -> None:
    clip, x = clip_of("static")  # all frames alike, so what one measures holds for all
    x = x + 1e-13 * torch.arange(FRAMES)[:, None]  # but none stands
    spent, measured = [], []
    for shared in (1, 3):
        seen = clip.residuals(x + 0.02)
        before = clip.stage.spent.evaluations
        measured.append(clip.local(x + 0.02, seen, 0.05, shared))
        spent.append(clip.stage.spent.evaluations - before)
    assert spent == [FRAMES * D, FRAMES * D / 3]
    still = ~measured[0].paired
    torch.testing.assert_close(measured[1].jacobian[:, still], measured[0].jacobian[:, still])


def test_of_a_camera_that_stands_one_view_measures_what_others_are_like() -> None:
    clip, x = clip_of("static")
    aside, moves = x + 0.02, 1e-13 * torch.arange(FRAMES)[:, None]
    spent, measured = [], []
    for path in (aside, aside + moves):
        before = clip.stage.spent.evaluations
        residuals = clip.residuals(path)
        measured.append(clip.local(path, residuals, 0.05))
        spent.append(clip.stage.spent.evaluations - before)
    assert spent == [2 + 2 * D, FRAMES + FRAMES * D]
    assert clip.stage.spent.renders <= 3 + 2 * D + FRAMES + FRAMES * D + FRAMES  # the last for the reference
    torch.testing.assert_close(measured[0].residuals, measured[1].residuals)
    torch.testing.assert_close(measured[0].jacobian, measured[1].jacobian)


def test_no_frame_goes_beyond_a_move_or_back_from_it() -> None:
    gains = torch.tensor([True] * 5 + [False] * 4)
    moved = faded(torch.zeros(9, 1).double(), torch.ones(9, 1).double(), gains)[:, 0]
    assert (float(moved.min()), float(moved.max())) == (0, 1)
    assert bool((moved.diff() <= 0).all())


def test_a_lens_that_is_kept_is_kept_by_a_move_that_fades_too() -> None:
    torch.manual_seed(0)
    x, lens = torch.rand(6, 4).double(), torch.tensor([0.0, 1.0, -2.0, 0.0], dtype=torch.float64)
    move = torch.rand(6, 4).double()
    move[:, 1] = 0.3 + 2 * move[:, 2]  # all frames' lenses move by 0.3
    gains = torch.tensor([False, False, False, True, True, True])
    free, kept = faded(x, x + move, gains) - x, faded(x, x + move, gains, fixed=lens) - x
    share = (free / move)[:, :1]
    torch.testing.assert_close(free, share * move)
    assert bool((share.diff(dim=0) >= 0).all())
    torch.testing.assert_close(kept @ lens, torch.full((6,), 0.3).double())
    torch.testing.assert_close(kept[:, [0, 3]], (share * move)[:, [0, 3]])


def test_a_frame_without_a_term_tells_nothing_of_it_and_is_told_nothing() -> None:
    jacobians = torch.zeros(4, 2, 2, dtype=torch.float64)
    measured = torch.tensor([[True, False], [False, True], [True, False], [False, True]])
    jacobians[:, :, 0], jacobians[:, :, 1] = 2.0, 6.0
    jacobians *= measured[:, None]
    rows = torch.tensor([[True, False], [True, True], [True, True], [True, True]])
    jacobians[0, 1] = 0  # as it is measured where there is nothing
    found = between(jacobians, measured, rows)
    assert found[:, 0].tolist() == [[2.0, 6.0]] * 4
    assert found[:, 1].tolist() == [[0.0, 0.0], [2.0, 6.0], [2.0, 6.0], [2.0, 6.0]]


@pytest.mark.parametrize("shown", [[4, 5, 6], [0, 1, 2, 3, 7, 8, 9]], ids=["in the middle", "leaves and returns"])
def test_every_direction_of_what_few_frames_show_is_measured(shown: list[int]) -> None:
    """Taken by turns, three directions of seven would be in three frames; four and three do not add up to seven."""
    clip, x = clip_of("push_in", 10)
    seen, mask = clip.reference.require("keypoints").clone(), clip.reference.require("subject").clone()
    without = [frame for frame in range(10) if frame not in shown]
    seen[without, :, 2], mask[without] = 0, False
    few = replace(clip, reference=replace(clip.reference, keypoints=seen, subject=mask))
    names = list(few.stage.objective.losses)
    assert few.defined[:, names.index("shot_size")].tolist() == [frame in shown for frame in range(10)]
    assert names[0] == "shot_size"  # whose only residual is the first
    now = few.residuals(x + 0.02)
    every = few.local(x + 0.02, now, 0.05).jacobian[shown, 0].abs().amax(0)
    before = clip.stage.spent.evaluations
    shared = few.local(x + 0.02, now, 0.05, shared=7).jacobian[shown, 0].abs().amax(0)
    assert bool(((shared > 0) == (every > 0)).all())
    assert clip.stage.spent.evaluations - before <= 10 + 7


@pytest.mark.parametrize("frames", [2, 3, 5])
def test_in_a_short_clip_too_every_direction_of_flow_is_measured(frames: int) -> None:
    clip, x = clip_of("push_in", frames)
    found = clip.local(x + 0.02, clip.residuals(x + 0.02), 0.05, shared=7)
    flow = found.jacobian[:, found.paired].abs().amax(1)  # (N, D)
    assert float(flow[0].max()) == 0.0
    assert float(flow[1:].amin()) > 0.0


def test_a_path_ends_at_a_bound_and_not_beyond() -> None:
    clip, true = clip_of("orbit")
    low = replace(clip, search=SubjectOrbit(elevation=0.5 * float(true[0, 1] * SCALE[1])))
    highest = low.search.bounds()[1]
    beside = true.clone()
    beside[:, 1] = highest[1] - 0.05
    x, total = refined(low, beside, Moves(6, None, fade=True), rounds=2)
    assert total < low.total(beside)
    assert float((x - highest).amax()) <= 0.0
    assert float((x - highest)[:, 1].amax()) > -0.01


def test_at_a_bound_the_slope_is_that_on_the_inner_side() -> None:
    clip, true = clip_of("orbit")
    x = true.clone()
    x[:, 1] = clip.search.bounds()[1][1]
    found = clip.local(x, clip.residuals(x), WIDE).jacobian
    beside = x.clone()
    beside[:, 1] -= WIDE
    inner = clip.local(beside, clip.residuals(beside), WIDE).jacobian
    assert float(found[:, :, 1].norm(dim=1).amin()) > 1.0
    torch.testing.assert_close(found[:1, :, 1], inner[:1, :, 1])  # the others' flow starts elsewhere
