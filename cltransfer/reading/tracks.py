"""Cleaning what was read along a clip, before it is aimed at: front and back sorted out, jitter filtered gently.

A clip's own scores always use what was read; only the search looks at the cleaned tracks.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from ..along_clip import along, counted, running_median, runs
from ..features import Features
from ..orientation import wrap
from ..placement import frame_joints, visible_joints
from ..skeleton import JOINTS

FLIP_COST = 0.35  # [rad] a frame pays for being read the other way round: a clip is right more often than not
TURNS = 4.0  # [1/s] a body that is seen so often turns little in between
CONTRADICTED = 0.3  # [rad] a frame pays for showing front where its left shoulder is on the left; less than a flip
LED, SOON = 3, 1.0  # frames by which the one before or behind them is told; [s] that it is away at most
LEAP, STEPPED = 0.5, 2.0  # [rad], and times the largest of their steps, beyond which one that is elsewhere is misread
ELSEWHERE = 0.03  # of the frame's longer side, and times that step, from where joints of such a frame are misread too
SURELY_WIDE = 0.5  # of the way from neck to head top, between the shoulders, from which on their order is sure


def cleaned(features: Features, frames: float, at: Tensor | None = None, times: Tensor | None = None) -> Features:
    """The features of a clip with yaw flips repaired, ends that leap away led to, and joints and angles filtered.

    Joints are filtered within stretches in which the same key joints are visible, because a joint that enters the
    frame moves the centroid by right.

    Args:
        features: N frames in order.
        frames: standard deviation of the Gaussian along the clip [frames]; 0 leaves everything as it was read.
        at: places of the frames, see :func:`~cltransfer.along_clip.places`; None are evenly spaced.
        times: of the frames, (N,) [s]; None has a body turn as little between any two.
    """
    at = counted(len(features), at)
    if frames <= 0 or len(features) < 3:
        return features
    features, new = righted(features, times, at), dict[str, Any]()
    if features.has("orientation"):
        new["orientation"] = _steady_angles(features.require("orientation"), frames, at)
    if features.has("keypoints"):
        stretches = _stretches(visible_joints(frame_joints(features)))
        joints = features.require("keypoints").clone()
        for first, last in stretches:
            flat = joints[first:last, :, :2].flatten(1)
            joints[first:last, :, :2] = along(flat, frames, at[first:last]).unflatten(1, (14, 2))
        new["keypoints"] = joints
    return replace(features, **new)


def turned_back(features: Features, times: Tensor | None = None) -> Features:
    """The features of N frames in order, with those turned by pi in which the person's back was taken for the front.

    ``times`` of the frames, (N,) [s], tell in which time a body may have turned by itself.
    """
    if not features.has("orientation"):
        return features
    angles = features.require("orientation")
    yaw = repair_flips(angles[:, 0], facing(features), times)
    return replace(features, orientation=torch.cat([yaw[:, None], angles[:, 1:]], dim=1))


def facing(features: Features) -> Tensor:
    """Whether the shoulders' order says front (1) or back (-1), or in between how surely, (N,); 0 where it is unknown.

    The body's left shoulder is on the right of who sees its front. What is right and left in the image is counted along
    the body's roll.
    """
    if not features.has("keypoints"):
        return torch.zeros(len(features), dtype=torch.float64)
    parts = [JOINTS.index(name) for name in ("left_shoulder", "right_shoulder", "head_top")]
    joints, roll = features.require("keypoints").double()[:, parts], features.require("orientation").double()[:, 2]
    left, right, top = joints[..., :2].unbind(1)
    across = torch.stack([torch.cos(roll), torch.sin(roll)], dim=1)
    apart = ((left - right) * across).sum(1) / (top - (left + right) / 2).norm(dim=1)
    known = visible_joints(joints).all(1) & apart.isfinite()
    return torch.where(known, (apart / SURELY_WIDE).clamp(-1, 1), 0.0)


def repair_flips(yaw: Tensor, facing: Tensor | None = None, times: Tensor | None = None) -> Tensor:
    """Yaw with frames that were read back to front turned by pi, by a two-state Viterbi.

    Between two frames the body turns little, so a jump by pi is the reader's; which side is right is decided by the
    majority, and by what another reader says of it. NaN frames are passed over: within them it has the time to turn.

    Args:
        yaw: (N,) [rad], 0 in front of the body.
        facing: whether it shows its front (1) or back (-1), (N,), 0 where unknown; see :func:`facing`.
        times: of the frames, (N,) [s]; None takes them for close together.
    """
    known = torch.isfinite(yaw).nonzero()[:, 0]
    if len(known) < 2:
        return yaw
    both = torch.stack([yaw[known], yaw[known] + math.pi], dim=1)  # (M, 2)
    costs = torch.tensor([0.0, FLIP_COST], dtype=yaw.dtype).repeat(len(known), 1)
    if facing is not None:
        costs = costs + CONTRADICTED * (-facing[known, None].to(yaw) * both.cos().sign()).clamp_min(0)
    pay, back = costs[0], []
    gaps = known.diff().double()
    if times is not None:
        gaps = torch.maximum(gaps, TURNS * times[known].double().diff().cpu())
    for (before, now), apart, cost in zip(pairwise(both), gaps.tolist(), costs[1:]):
        turn = wrap(now[:, None] - before[None]).abs() / apart  # (now, before)
        best = (pay[None] + turn).min(1)
        back.append(best.indices)
        pay = best.values + cost
    state = int(pay.argmin())
    states = [state]
    for step in reversed(back):
        state = int(step[state])
        states.append(state)
    repaired = yaw.clone()
    repaired[known] = wrap(both[torch.arange(len(known)), torch.tensor(states[::-1])])
    return repaired


def righted(features: Features, times: Tensor | None = None, at: Tensor | None = None) -> Features:
    """The features of a clip without its errors: yaw flips repaired, ends that leap away led to; see :func:`leaps`.

    Joints of such an end are led to as well, where they leap away too.
    """
    turned, placed = turned_back(features, times), counted(len(features), at)
    found = leaps(turned, at, times)
    if not found:
        return turned
    new = {name: turned.require(name).clone() for name in ("orientation", "keypoints") if turned.has(name)}
    for i, beside in found.items():
        away = placed[beside] - placed[i]
        new["orientation"][i] = _led(_unwrap(turned.require("orientation")[beside]), away)[0]
        if "keypoints" in new:
            joints = turned.require("keypoints")[beside]
            led, step = _led(joints[:, :, :2].flatten(1), away)
            far = (turned.require("keypoints")[i, :, :2].flatten() - led).abs() - STEPPED * step
            if float(far.nanmedian()) > ELSEWHERE * max(features.size):
                new["keypoints"][i] = torch.cat([led.reshape(-1, 2), joints[0, :, 2:]], dim=1)
    return replace(turned, **new)


def leaps(features: Features, at: Tensor | None = None, times: Tensor | None = None) -> dict[int, list[int]]:
    """First and last frames of those that follow one another whose angles leap away from the next ones', as misread.

    No median tells them. They are held against the line of the frames beside them, to which a move that begins or ends
    there keeps, and which has to be as steady as they are far from it.

    Args:
        features: N frames in order.
        at: places of the frames, see :func:`~cltransfer.along_clip.places`; None are evenly spaced.
        times: of the frames, (N,) [s]; None takes them for close together.

    Returns:
        By frame the next ones, the nearest first, through which the line goes.
    """
    found: dict[int, list[int]] = {}
    if not features.has("orientation"):
        return found
    angles, placed = features.require("orientation"), counted(len(features), at)
    for first, last in runs(torch.isfinite(angles).all(1)):
        for end, onward in ((first, 1), (last - 1, -1)) if last - first > LED else ():
            beside = [end + onward * k for k in range(1, LED + 1)]
            if times is not None and abs(float(times[beside[0]] - times[end])) > SOON:
                continue  # whoever is seen has the time to turn
            led, step = _led(_unwrap(angles[beside]), placed[beside] - placed[end])
            if bool((wrap(angles[end] - led).abs() > LEAP + STEPPED * step).any()):
                found[end] = beside
    return found


def _led(values: Tensor, away: Tensor) -> tuple[Tensor, Tensor]:
    """Where a line through values (N, D) that are ``away`` (N,) leads to at 0, and the largest step to there, (D,)."""
    away = away.to(values)
    offset = away - away.mean()
    slope = (offset[:, None] * values).sum(0) / offset.square().sum()
    fastest = (values.diff(dim=0) / away.diff()[:, None]).abs().amax(0)
    return values.mean(0) - slope * away.mean(), fastest * away[0].abs()


def _steady_angles(angles: Tensor, frames: float, at: Tensor) -> Tensor:
    """Angles (N, 3) [rad] filtered, never across frames that were not read: who comes back may stand elsewhere."""
    known = torch.isfinite(angles).all(1)
    if int(known.sum()) < 3:
        return angles
    steady = torch.full_like(angles, torch.nan)
    steady[known] = _unwrap(angles[known])
    for first, last in runs(known):
        steady[first:last] = along(running_median(steady[first:last]), frames, at[first:last])
    return wrap(steady)


def _unwrap(angles: Tensor) -> Tensor:
    steps = wrap(angles[1:] - angles[:-1])
    return torch.cat([angles[:1], angles[:1] + steps.cumsum(0)])


def _stretches(visible: Tensor) -> list[tuple[int, int]]:
    """First and last + 1 of the runs in which the visible set (N, 5) stays the same."""
    changes = (visible[1:] != visible[:-1]).any(1).nonzero()[:, 0] + 1
    edges = [0, *changes.tolist(), len(visible)]
    return list(pairwise(edges))
