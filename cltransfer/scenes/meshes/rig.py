"""A rig's joints by their names: the person of a skinned mesh, without a network.

Programs name the same joint differently (upper_arm.L, LeftArm, arm_joint_L_1). What is read is a side, and a word of
the limb; where a limb's joints share one word they are taken in order from the body outwards.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np
import torch

from ...computer.array_type import Array
from ...skeleton import JOINTS, standing_height
from ...subject import Subject
from .gltf_figure import Skeleton

_LIMBS = {  # joint -> words that mean it, the surest first
    "shoulder": ("upperarm", "uparm", "arm", "shldr"),
    "elbow": ("forearm", "lowerarm", "elbow"),
    "wrist": ("hand", "wrist"),
    "hip": ("thigh", "upleg", "upperleg"),
    "knee": ("shin", "calf", "lowerleg", "knee", "leg"),
    "ankle": ("foot", "ankle"),
}
_COLLARS = {"collar", "clavicle", "collarbone"}
_ENDS = ("wrist", "ankle")  # of the limbs, though a hand or a foot hangs from there
_BEND = "bend"  # ends the name of what bends, beside a twist, of one limb
_HELPERS = {"ik", "pole", "target", "ctrl", "control"}  # what poses a limb, and is none
_CHAINS = {("shoulder", "elbow", "wrist"): "arm", ("hip", "knee", "ankle"): "leg"}
_EXACT = {"upper", "up", "lower", "fore", "hand", "twist", "roll", "thigh", "shin", "foot", "toe"}  # parts of a limb
_SIDE = {"left": "left", "l": "left", "right": "right", "r": "right"}
_MINIMUM = 10  # joints that must be found
_LETTERS = 100  # at the end of a name that are looked at
_TOLD, _SHOWN = 3, 40  # joints and letters of a name in a line

_log = logging.getLogger("cltransfer")


@dataclass(frozen=True, eq=False)
class _Named:
    """The joints of a rig from the root outwards, and the words of each one's name, looked up once for all."""

    rig: Skeleton
    order: list[int]
    words: list[list[str]]
    spelt: list[str]  # the words without sides, as one

    @classmethod
    def of(cls, rig: Skeleton) -> _Named:
        words = [_words(name[-_LETTERS:]) for name in rig.names]
        return cls(rig, _outwards(rig), words, ["".join(w for w in one if w not in _SIDE) for one in words])

    def first(self, word: str) -> int | None:
        return next((joint for joint in self.order if word in self.words[joint]), None)


def subject_of_rig(rig: Skeleton, up: Array) -> Subject | None:
    """The person whose joints ``rig`` names; None where it names too few for shoulders, hips and legs.

    A joint or a vertex that is not finite is not there. The head top is the farthest point of what the head moves,
    straight on from the neck.

    Args:
        rig: posed skeleton, scene units.
        up: unit vector upwards, (3,).
    """
    good = np.isfinite(rig.vertices).all(1)
    rig = replace(rig, vertices=rig.vertices[good], strongest=rig.strongest[good])
    named = _Named.of(rig)
    found = _limb_joints(named)
    neck, head = named.first("neck"), named.first("head")
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
        joints[JOINTS.index("head_top")] = _head_top(named, skull, shoulders.mean(0))
    known = np.isfinite(joints).all(1)
    joints[~known] = np.nan
    facing = np.cross(shoulders[0] - shoulders[1] + hips[0] - hips[1], up)  # from its left
    length = np.linalg.norm(facing)
    if known.sum() < _MINIMUM or not 1e-9 <= length < np.inf:
        return None
    front = torch.from_numpy(facing / length)
    upward = torch.from_numpy(np.asarray(up, np.float64))
    soles = (rig.vertices @ up).min(initial=np.inf)
    standing = joints[JOINTS.index("head_top")] @ up - soles  # bones fall short of round bodies
    body = torch.from_numpy(joints)
    return Subject(body, torch.from_numpy(known).double(), front, upward, standing_height(float(standing), body))


def tell_nobody(path: Path, rig: Skeleton) -> None:
    """Tell that the joints of a mesh name no person, and how it is seen whether one is found otherwise."""
    first = ", ".join(f"{name[:_SHOWN]!r}" for name in rig.names[:_TOLD])
    more = f" and {len(rig.names) - _TOLD} more" * (len(rig.names) > _TOLD)
    _log.warning("%s: its joints, %s%s, name no person; whether networks find one in it is shown by: cltransfer lift",
                 path, first, more)  # fmt: skip


def _words(name: str) -> list[str]:
    """Lower-case words of a joint's name; camel case, digits and punctuation part them.

    >>> _words("mixamorig:LeftForeArm"), _words("DEF-upper_arm.L.001_046")
    (['mixamorig', 'left', 'fore', 'arm'], ['def', 'upper', 'arm', 'l'])
    """
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def _side(words: list[str]) -> str | None:
    return next((_SIDE[word] for word in words if word in _SIDE), None)


def _limb_joints(named: _Named) -> dict[str, int]:
    """Joints by the names of JOINTS: called so, or in the place of a numbered limb; a helper where no bone is."""
    found = dict[str, int]()
    for side in ("left", "right"):
        joints = [joint for joint in named.order if _side(named.words[joint]) == side]
        bones = [joint for joint in joints if not _HELPERS.intersection(named.words[joint])]
        collar = any(_COLLARS.intersection(named.words[joint]) for joint in joints)
        for chain, limb in _CHAINS.items():
            for among in (joints, bones):  # what is found among the latter stands
                found |= {f"{side}_{part}": joint for part, joint in _limb(named, among, chain, limb, collar)}
    return found


def _limb(
    named: _Named, among: list[int], chain: tuple[str, ...], limb: str, collar: bool
) -> Iterator[tuple[str, int]]:
    numbered = [joint for joint in among if _is_stem(named.words[joint], limb)]
    if len(numbered) >= len(chain):
        yield from zip(chain, numbered)
        return
    for part in chain:
        joint = _called(named, among, part, collar)
        if joint is not None:
            yield part, _nearer(named, among, part, joint)


def _called(named: _Named, among: list[int], part: str, collar: bool) -> int | None:
    """The joint whose name says ``part``: where no other does, what bends, then what is called as the part itself.

    Args:
        named: all joints.
        among: those that are asked, from the root outwards.
        part: of a limb.
        collar: whether this side has one; without it a shoulder may be the collar, and a hip a half of the pelvis.
    """
    bent = [joint for joint in among if named.spelt[joint].endswith(_BEND)]
    asked = [(word, joints, end) for joints, end in ((among, ""), (bent, _BEND)) for word in _LIMBS[part]]
    asked += [(part, among, "")] if collar else []
    called = ((word, joint, end) for word, joints, end in asked for joint in joints)
    return next((joint for word, joint, end in called if _says(named.spelt[joint].removesuffix(end), word)), None)


def _nearer(named: _Named, among: list[int], part: str, joint: int) -> int:
    """The wrist that a hand hangs from, the ankle that a foot does; the joint itself where there is none."""
    if part not in _ENDS:
        return joint
    asked, above = set(among), named.rig.parents[joint]
    while above >= 0:
        if above in asked and _says(named.spelt[above], part):
            return above
        above = named.rig.parents[above]
    return joint


def _is_stem(words: list[str], limb: str) -> bool:
    """Whether a name says the limb and nothing more exact, as in arm_joint_L_2."""
    return limb in words and not _EXACT.intersection(words)


def _says(spelt: str, word: str) -> bool:
    """Whether the name ends in ``word``, perhaps in two; a forearm is no arm and an upper leg no leg."""
    whole = word not in ("arm", "leg") or not spelt.removesuffix(word).endswith(("fore", "up", "upper", "lower"))
    return spelt.endswith(word) and whole


def _outwards(rig: Skeleton) -> list[int]:
    """Joints by their distance from the root."""
    depth = {-1: -1}
    for joint in range(len(rig.names)):
        way = [joint]
        while way[-1] not in depth:
            way.append(rig.parents[way[-1]])
        depth.update(zip(reversed(way), count(depth[way[-1]])))
    return sorted(range(len(rig.names)), key=depth.__getitem__)


def _last_below(rig: Skeleton, joint: int | None) -> int | None:
    """The outermost joint of the same chain."""
    below: dict[int, int] = {}
    for i, parent in enumerate(rig.parents):
        below.setdefault(parent, i)
    while joint in below:
        joint = below[joint]
    return joint


def _head_top(named: _Named, head: int, chest: Array) -> Array:
    """On the line from the chest through the head joint, as far as the head reaches, (3,)."""
    rig, members = named.rig, {head}
    for joint in named.order:
        if rig.parents[joint] in members:
            members.add(joint)
    base = rig.points[head]
    along = (base - chest) / np.linalg.norm(base - chest)
    skin = rig.vertices[np.isin(rig.strongest, list(members))]
    reach = float(((skin - base) @ along).max()) if len(skin) else 0.0
    return np.asarray(base + max(reach, 0.0) * along)
