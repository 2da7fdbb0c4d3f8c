"""A rig's joints by their names: the person of a skinned mesh, without a network.

Programs name the same joint differently (upper_arm.L, LeftArm, arm_joint_L_1). What is read is a side, and a word of
the limb; where a limb's joints share one word they are taken in order from the body outwards.
"""

from __future__ import annotations

import re
from itertools import count

import numpy as np
import torch

from ...computer.array_type import Array
from ...skeleton import JOINTS, standing_height
from ...subject import Subject
from .gltf_figure import Skeleton

_LIMBS = {  # joint -> words that mean it, the surest first
    "shoulder": ("upperarm", "uparm", "arm"),
    "elbow": ("forearm", "lowerarm", "elbow"),
    "wrist": ("hand", "wrist"),
    "hip": ("thigh", "upleg", "upperleg"),
    "knee": ("shin", "calf", "lowerleg", "knee", "leg"),
    "ankle": ("foot", "ankle"),
}
_HELPERS = {"ik", "pole", "target", "ctrl", "control"}  # what poses a limb, and is none
_CHAINS = {("shoulder", "elbow", "wrist"): "arm", ("hip", "knee", "ankle"): "leg"}
_SIDE = {"left": "left", "l": "left", "right": "right", "r": "right"}
_MINIMUM = 10  # joints that must be found


def subject_of_rig(rig: Skeleton, up: Array) -> Subject | None:
    """The person whose joints ``rig`` names; None where it names too few for shoulders, hips and legs.

    The head top is the farthest point of what the head moves, straight on from the neck.

    Args:
        rig: posed skeleton, scene units.
        up: unit vector upwards, (3,).
    """
    found = {name: joint for name in JOINTS[:12] if (joint := _limb_joint(rig, *name.split("_"))) is not None}
    neck, head = _first(rig, "neck"), _first(rig, "head")
    if not {f"{side}_{part}" for side in ("left", "right") for part in ("shoulder", "hip")} <= found.keys():
        return None
    joints = np.full((14, 3), np.nan)
    for name, joint in found.items():
        joints[JOINTS.index(name)] = rig.points[joint]
    if rig.mirrored:
        joints[:12] = joints[:12].reshape(6, 2, 3)[:, ::-1].reshape(12, 3)  # left and right in turn
    shoulders, hips = joints[:2], joints[6:8]
    joints[JOINTS.index("neck")] = shoulders.mean(0) if neck is None else rig.points[neck]
    skull = head if head is not None else _last_below(rig, neck)
    if skull is not None:
        joints[JOINTS.index("head_top")] = _head_top(rig, skull, shoulders.mean(0))
    known = np.isfinite(joints[:, 0])
    left = shoulders[0] - shoulders[1] + hips[0] - hips[1]
    facing = np.cross(left, up)
    if known.sum() < _MINIMUM or np.linalg.norm(facing) < 1e-9:
        return None
    front = torch.from_numpy(facing / np.linalg.norm(facing))
    upward = torch.from_numpy(np.asarray(up, np.float64))
    standing = joints[JOINTS.index("head_top")] @ up - (rig.vertices @ up).min()  # bones fall short of round bodies
    body = torch.from_numpy(joints)
    return Subject(body, torch.from_numpy(known).double(), front, upward, standing_height(float(standing), body))


def _words(name: str) -> list[str]:
    """Lower-case words of a joint's name; camel case, digits and punctuation part them.

    >>> _words("mixamorig:LeftForeArm"), _words("DEF-upper_arm.L.001_046")
    (['mixamorig', 'left', 'fore', 'arm'], ['def', 'upper', 'arm', 'l'])
    """
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def _side(words: list[str]) -> str | None:
    return next((_SIDE[word] for word in words if word in _SIDE), None)


def _limb_joint(rig: Skeleton, side: str, part: str) -> int | None:
    """The joint called ``side`` and ``part``, or the one in its place of a numbered limb; a helper where no bone is."""
    joints = _outwards(rig)
    bones = [joint for joint in joints if not _HELPERS & set(_words(rig.names[joint]))]
    found = (_named_joint(rig, among, side, part) for among in (bones, joints))
    return next((joint for joint in found if joint is not None), None)


def _named_joint(rig: Skeleton, among: list[int], side: str, part: str) -> int | None:
    for chain, limb in _CHAINS.items():
        numbered = [j for j in among if _stem(rig.names[j], limb) and _side(_words(rig.names[j])) == side]
        if part in chain and len(numbered) >= len(chain):
            return numbered[chain.index(part)]
    for word in _LIMBS[part]:
        for joint in among:
            words = _words(rig.names[joint])
            if _side(words) == side and _says(words, word):
                return joint
    return None


def _stem(name: str, limb: str) -> bool:
    """Whether ``name`` says the limb and nothing more exact, as in arm_joint_L_2."""
    words = [word for word in _words(name) if word not in _SIDE]
    exact = {"upper", "up", "lower", "fore", "hand", "twist", "roll", "thigh", "shin", "foot", "toe"}
    return limb in words and not exact & set(words)


def _says(words: list[str], word: str) -> bool:
    """Whether the name ends in ``word``, perhaps in two; a forearm is no arm and an upper leg no leg."""
    joined = "".join(w for w in words if w not in _SIDE)
    whole = word not in ("arm", "leg") or not joined.removesuffix(word).endswith(("fore", "up", "upper", "lower"))
    return joined.endswith(word) and whole


def _outwards(rig: Skeleton) -> list[int]:
    """Joints by their distance from the root."""
    depth = {-1: -1}
    for joint in range(len(rig.names)):
        way = [joint]
        while way[-1] not in depth:
            way.append(rig.parents[way[-1]])
        depth.update(zip(reversed(way), count(depth[way[-1]])))
    return sorted(range(len(rig.names)), key=depth.__getitem__)


def _first(rig: Skeleton, word: str) -> int | None:
    return next((joint for joint in _outwards(rig) if word in _words(rig.names[joint])), None)


def _last_below(rig: Skeleton, joint: int | None) -> int | None:
    """The outermost joint of the same chain."""
    below: dict[int, int] = {}
    for i, parent in enumerate(rig.parents):
        below.setdefault(parent, i)
    while joint in below:
        joint = below[joint]
    return joint


def _head_top(rig: Skeleton, head: int, chest: Array) -> Array:
    """On the line from the chest through the head joint, as far as the head reaches, (3,)."""
    members = {head}
    for joint in _outwards(rig):
        if rig.parents[joint] in members:
            members.add(joint)
    base = rig.points[head]
    along = (base - chest) / np.linalg.norm(base - chest)
    skin = rig.vertices[np.isin(rig.strongest, list(members))]
    reach = float(((skin - base) @ along).max()) if len(skin) else 0.0
    return np.asarray(base + max(reach, 0.0) * along)
