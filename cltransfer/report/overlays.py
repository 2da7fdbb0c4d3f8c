"""What was read in a frame, drawn over it, to be judged by eye."""

from __future__ import annotations

import math

import cv2
import numpy as np
import torch
from torch import Tensor

from ..feature_shapes import on_grid
from ..features import Features
from ..skeleton import BONES, JOINTS, VISIBLE
from .picture import DRAWABLE, pixel

LEFT, RIGHT, MIDDLE = (80, 200, 255), (255, 120, 60), (255, 255, 255)  # RGB of the body's sides
UNSURE = (150, 150, 150)
TINTS = np.array([[220, 60, 60], [60, 200, 90], [40, 40, 40]])  # RGB of foreground, character, background
STRENGTH = (0.45, 0.4, 0.0)
AXES = ((255, 90, 90), (90, 255, 90), (90, 160, 255))  # RGB of the body's left, up and front
GIZMO = 0.11  # of the frame's shorter side


def draw_reading(frame: Tensor, features: Features) -> np.ndarray:
    """Layers, person box, joints and the body's axes over one frame.

    Args:
        frame: RGB, (3, H, W) uint8.
        features: of this frame, a batch of one at the frame's size.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    picture = frame.permute(1, 2, 0).numpy().copy()
    if features.has("layers"):
        layers = on_grid(features.require("layers"), frame.shape[1:])
        for mask, tint, part in zip(layers[0].numpy(), TINTS, STRENGTH):
            picture[mask] = ((1 - part) * picture[mask] + part * tint).astype(np.uint8)
    thick = max(1, round(min(picture.shape[:2]) / 250))
    if features.has("box"):
        _box(picture, features.require("box")[0].tolist(), thick)
    if features.has("keypoints"):
        _skeleton(picture, features.require("keypoints")[0].tolist(), thick)
    if features.has("orientation"):
        _gizmo(picture, features.require("orientation")[0].tolist(), thick)
    return picture


def draw_flow(features: Features, fastest: float) -> np.ndarray:
    """Backward flow of one frame as colours: hue its direction, strength its speed; grey where undefined.

    Args:
        features: a batch of one.
        fastest: speed of full strength, > 0 [px].

    Returns:
        (H, W, 3) uint8 RGB, with the wheel of directions in the lower left corner, as far as it fits there.
    """
    flow = features.require("flow")[0].permute(1, 2, 0).numpy()
    picture = _wheel_colors(flow, fastest)
    side = min(picture.shape[:2])
    radius = min(max(6, side // 8), (side - 2) // 2)
    if radius < 1:
        return picture
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1].astype(np.float32)
    inside = x**2 + y**2 <= radius**2
    corner = picture[-2 * radius - 2 : -1, 1 : 2 * radius + 2]
    corner[inside] = _wheel_colors(np.stack([x, y], -1) * fastest / radius, fastest)[inside]
    return picture


def _wheel_colors(flow: np.ndarray, fastest: float) -> np.ndarray:
    known = np.isfinite(flow).all(-1)
    x, y = np.where(known[..., None], flow, 0.0).astype(np.float32).transpose(2, 0, 1)
    hue = (np.arctan2(y, x) / (2 * math.pi) % 1.0) * 180
    strength = np.clip(np.hypot(x, y) / fastest, 0, 1) * 255
    hsv = np.stack([hue, strength, np.full_like(hue, 255)], -1).astype(np.uint8)
    colors = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)
    colors[~known] = 128
    return colors


def _box(picture: np.ndarray, box: list[float], thick: int) -> None:
    if all(map(math.isfinite, box)):
        x, y, width, height = box[:4]
        first, last = pixel(x, y), (math.ceil(x + width) - 1, math.ceil(y + height) - 1)
        cv2.rectangle(picture, first, last, (255, 230, 0), thick)


def _skeleton(picture: np.ndarray, joints: list[list[float]], thick: int) -> None:
    for a, b in BONES:
        if _placed(joints[a]) and _placed(joints[b]):
            sure = min(joints[a][2], joints[b][2]) > VISIBLE
            color = _side(a, b) if sure else UNSURE
            start, end = pixel(*joints[a][:2]), pixel(*joints[b][:2])
            cv2.line(picture, start, end, color, 2 * thick if sure else thick, cv2.LINE_AA)
    for i, joint in enumerate(joints):
        if _placed(joint):
            color = _side(i, i) if joint[2] > VISIBLE else UNSURE
            cv2.circle(picture, pixel(*joint[:2]), 2 * thick + 1, color, -1, cv2.LINE_AA)


def _placed(joint: list[float]) -> bool:
    return all(map(math.isfinite, joint)) and max(map(abs, joint[:2])) < DRAWABLE


def _side(a: int, b: int) -> tuple[int, int, int]:
    names = {JOINTS[a].split("_")[0], JOINTS[b].split("_")[0]}
    return LEFT if names <= {"left"} else RIGHT if names <= {"right"} else MIDDLE


def body_axes(yaw: float, pitch: float, roll: float) -> Tensor:
    """The body's left, up and front as a camera at these angles [rad] about it sees them, (3, 3): right, down, away."""
    left = torch.tensor([math.cos(yaw), math.sin(pitch) * math.sin(yaw), -math.sin(yaw) * math.cos(pitch)])
    front = torch.tensor([-math.sin(yaw), math.sin(pitch) * math.cos(yaw), -math.cos(yaw) * math.cos(pitch)])
    up = torch.tensor([0.0, -math.cos(pitch), -math.sin(pitch)])
    turn = torch.tensor(
        [[math.cos(roll), -math.sin(roll), 0.0], [math.sin(roll), math.cos(roll), 0.0], [0.0, 0.0, 1.0]]
    )
    return torch.stack([left, up, front]) @ turn.T


def _gizmo(picture: np.ndarray, angles: list[float], thick: int) -> None:
    if not all(map(math.isfinite, angles)):
        return
    length = GIZMO * min(picture.shape[:2])
    middle = picture.shape[1] - 1.4 * length, picture.shape[0] - 1.4 * length
    for axis, color in sorted(zip(body_axes(*angles).tolist(), AXES), key=lambda pair: -pair[0][2]):
        tip = round(middle[0] + length * axis[0]), round(middle[1] + length * axis[1])
        cv2.arrowedLine(picture, (round(middle[0]), round(middle[1])), tip, color, 2 * thick, cv2.LINE_AA, 0, 0.2)
