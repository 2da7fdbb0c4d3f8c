"""The camera's motion read from a clip: how the background moves, against how the person does.

Turning and zooming move everything alike, whatever its distance; a camera that travels moves near things more. So the
background's flow is fitted by what turning and zooming can do; what is left over is parallax, and tells a dolly from a
zoom and a truck from a pan. Then the person, who stands still and not far behind most of the scenery, tells which way
the camera travels.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d

from ..feature_shapes import layers_on
from ..features import Features
from ..losses._affine_flow import fit_affine_flow
from .motion import PRIMITIVES, Motion, frame_side

GRID = (18, 32)  # cells (rows, columns) that the background's flow is averaged over
FILLED = 0.5  # part of a cell that must be background
LEAST_CELLS = 24  # of a frame whose motion can be read
LENS = 1.6  # focal length that the curvature of a turn is worked out for [frame sides]
ROUNDS = 6  # of reweighting
PARALLAX = 0.18  # above which the camera travels; pans, tilts, rolls and zooms stay below 0.15, travels above 0.22
TRIMMED = 0.02  # of the cells, those that fit worst: flow has outliers
WINDOW = 0.9 / 12  # [s] of motion in which parallax is looked for, at least: shorter steps are read with as much noise
HELD = (-0.6, 0.35)  # parts of the background's motion between which a person is held in place; travel makes it > 0
FLOOR = (0.009, 0.009, 0.025)  # right, down [frame sides], growth [log size]: less is no motion of the background


def flow_motion(features: Features, times: Tensor) -> Motion:
    """Motion of the camera in N frames with ``flow`` and ``layers``; ``times`` (N,) [s]."""
    velocity, there, place = background_cells(features)
    field, _ = robust_fit(_affine(place), velocity, there)  # (N, 6)
    longer = 1 if features.size[0] >= features.size[1] else 5  # growth is surest along the frame's longer side
    background = field[:, [0, 3, longer]]  # right, down, growth
    still = bool((background.nan_to_num(0).cumsum(0).abs() < torch.tensor(FLOOR)).all())
    parallax = float("nan") if still else _parallax(place, *_summed(velocity, there, times))
    person = person_motion(features)  # (N, 3)
    rates = torch.zeros(len(features), len(PRIMITIVES), dtype=torch.float64)
    if parallax > PARALLAX:
        _travelling(rates, background, person)
    else:
        rates[:, [0, 1, 3]] = background * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    rates[:, 2] = -field[:, 4]  # a clockwise camera turns the picture the other way
    rates[0] = 0
    return Motion(rates, times, parallax)


def _travelling(rates: Tensor, background: Tensor, person: Tensor) -> None:
    """Fill in the rates (N, 8) of a camera that travels, one word for each direction over the whole clip."""
    both = person.isfinite() & background.isfinite()  # where either is unknown neither tells of the other
    moved, beside = (torch.where(both, motion, 0.0).sum(0) for motion in (person, background))
    share = moved / beside
    held = (share > HELD[0]) & (share < HELD[1])
    grows = bool(abs(background[:, 2].nansum()) > FLOOR[2])
    if grows and held[2]:  # a dolly zoom
        rates[:, 3], rates[:, 4] = background[:, 2], person[:, 2].nan_to_num(0) - background[:, 2]
    else:
        # one who grows before a background that does not is walking or waving
        nearer = person[:, 2].where(person[:, 2].isfinite(), background[:, 2])
        rates[:, 4] = nearer if grows and moved[2] * beside[2] > 0 else background[:, 2]
    for axis, aside, aimed in ((0, 5, 7), (1, 6, 6)):
        # a person held in place while the background goes by: the camera travels round, else along
        follows = bool(held[axis])
        sign = 1.0 if follows == (axis == 0) else -1.0
        source = (
            background[:, axis] if follows else person[:, axis].where(person[:, axis].isfinite(), background[:, axis])
        )
        rates[:, aimed if follows else aside] = sign * source


def background_cells(features: Features) -> tuple[Tensor, Tensor, Tensor]:
    """Forward motion of the background on a coarse grid of M cells.

    Returns:
        Motion (N, M, 2) [frame sides], which cells are known (N, M) bool, and their places (M, 2) right and down of
        the frame's middle [frame sides].
    """
    width, height = features.size
    side = frame_side(features.size)
    flow = -features.require("flow").double() / side  # the flow points to where things came from
    known = layers_on(features, "flow")[:, 2] & flow.isfinite().all(1)
    part = adaptive_avg_pool2d(known[:, None].double(), GRID)
    mean = adaptive_avg_pool2d(torch.where(known[:, None], flow, 0.0), GRID) / part.clamp_min(1e-9)
    y, x = (((torch.arange(n, dtype=torch.float64) + 0.5) / n - 0.5) for n in GRID)
    rows, columns = torch.meshgrid(y * height / side, x * width / side, indexing="ij")
    place = torch.stack([columns, rows], dim=-1).flatten(0, 1)
    return mean.flatten(2).transpose(1, 2), (part.flatten(1) > FILLED), place


def person_motion(features: Features) -> Tensor:
    """Forward motion of the person's field in the frame's middle: right, down and growth, (N, 3); NaN where unseen.

    In the middle a person who stands aside does not seem to travel while it grows.
    """
    width, height = features.size
    person = layers_on(features, "flow")[:, 1:2]
    field = -fit_affine_flow(features.require("flow"), person, features.size).coefficients[:, 0]
    growth = (field[:, 0, 1] + field[:, 1, 2] * width / height) / 2
    return torch.cat([field[:, :, 0] * width / frame_side(features.size), growth[:, None]], dim=1)


def robust_fit(design: Tensor, velocity: Tensor, there: Tensor) -> tuple[Tensor, Tensor]:
    """Fit motion (N, M, 2) by ``design`` (M, 2, P), cells far from the fit counting less (Huber's weights).

    Returns:
        Coefficients (N, P), NaN in frames with too few cells, and what is left of the motion (N, M, 2).
    """
    weight = there.to(velocity)
    ridge = 1e-9 * torch.eye(design.shape[-1], dtype=design.dtype)
    for _ in range(ROUNDS):
        normal = torch.einsum("nm,mcp,mcq->npq", weight, design, design) + ridge
        right = torch.einsum("nm,mcp,nmc->np", weight, design, velocity)
        found = torch.linalg.solve(normal, right)
        left = velocity - torch.einsum("mcp,np->nmc", design, found)
        size = left.norm(dim=-1)
        scale = size.masked_fill(~there, float("nan")).nanmedian(dim=1, keepdim=True).values.nan_to_num(0)
        weight = there * ((1.5 * scale + 1e-5) / size.clamp_min(1e-12)).clamp_max(1.0)
    return found.masked_fill(there.sum(1, keepdim=True) < LEAST_CELLS, float("nan")), left


def _parallax(place: Tensor, moved: Tensor, there: Tensor) -> float:
    """Part of the motion (N, M, 2) of cells at ``place`` (M, 2) that no turning and no zooming explains."""
    _, left = robust_fit(_turn_and_zoom(place), moved, there)
    return _share(left, moved, there)


def _summed(velocity: Tensor, there: Tensor, times: Tensor) -> tuple[Tensor, Tensor]:
    """Motion (W, M, 2) and known cells (W, M) of W windows, of those of N frames at ``times`` (N,) [s].

    A cell is known where every frame of the window knows it: one that lacks a part would be taken for a slower one.
    """
    window = _windows(times)
    count = window.bincount()
    moved = velocity.new_zeros(len(count), *velocity.shape[1:]).index_add_(0, window, velocity)
    known = torch.zeros(len(count), there.shape[1], dtype=torch.int64).index_add_(0, window, there.long())
    return moved, known == count[:, None]


def _windows(times: Tensor) -> Tensor:
    """Number (N,) of the window that the motion of each frame belongs to; the first frame, which has none, is alone."""
    numbers, passed = [0], WINDOW
    for step in times.diff().tolist():
        full = passed >= WINDOW
        numbers.append(numbers[-1] + full)
        passed = step if full else passed + step
    last = numbers[-1] - (passed < WINDOW and numbers[-1] > 1)  # what is over at the end goes with the window before
    return torch.tensor(numbers).clamp_max(last)


def _share(left: Tensor, velocity: Tensor, there: Tensor) -> float:
    """Root mean square of what is left over that of the motion, but for the cells that fit worst."""
    size = left.norm(dim=-1)[there]
    if len(size) == 0 or float(velocity[there].norm()) < 1e-6:
        return float("nan")
    kept = size <= torch.quantile(size[:: max(1, len(size) // 100_000)], 1 - TRIMMED)
    return float(
        (size[kept].square().sum() / velocity[there][kept].square().sum().clamp_min(1e-30)).sqrt().clamp_max(1)
    )


def _affine(place: Tensor) -> Tensor:
    """An affine field's design, (M, 2, 6)."""
    one, zero = torch.ones_like(place[:, :1]), torch.zeros_like(place)
    row = torch.cat([one, place], dim=1)
    none = torch.cat([zero, zero[:, :1]], dim=1)
    return torch.stack([torch.cat([row, none], 1), torch.cat([none, row], 1)], dim=1)


def _turn_and_zoom(place: Tensor) -> Tensor:
    """Design of a camera that pans, tilts, rolls and zooms on the spot, (M, 2, 4)."""
    x, y = place.unbind(-1)
    right = torch.stack([1 + (x / LENS) ** 2, x * y / LENS**2, -y, x], dim=-1)
    down = torch.stack([x * y / LENS**2, 1 + (y / LENS) ** 2, x, y], dim=-1)
    return torch.stack([right, down], dim=1)
