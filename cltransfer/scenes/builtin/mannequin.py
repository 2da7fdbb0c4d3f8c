"""A jointed, dressed mannequin whose joints are known exactly.

Metres; x forward, y to the body's left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .paint import RGB, Paint, Part, plain
from .surfaces import Array, Lathe, ball, capsule

_SIDES = (1, -1)  # left, right


@dataclass(frozen=True)
class Body:
    """Build, pose and clothes of a person.

    Args:
        height: standing height [m], > 0.
        girth: width against an average body, about 0.8 to 1.3.
        stride: how far the left leg is swung forward and the right one back [rad].
        swing: how far the left and right upper arms are swung forward [rad].
        spread: how far both are held away from the body [rad].
        elbow: how far the left and right forearms are bent forward [rad].
        skin, hair, jacket, shirt, trousers, shoes: colours, RGB in [0, 1].
    """

    height: float = 1.78
    girth: float = 1.0
    stride: float = 0.0
    swing: tuple[float, float] = (0.0, 0.0)
    spread: float = 0.15
    elbow: tuple[float, float] = (0.25, 0.25)
    skin: RGB = (0.86, 0.66, 0.54)
    hair: RGB = (0.20, 0.13, 0.09)
    jacket: RGB = (0.74, 0.24, 0.18)
    shirt: RGB = (0.93, 0.91, 0.86)
    trousers: RGB = (0.20, 0.25, 0.36)
    shoes: RGB = (0.16, 0.14, 0.13)

    def __post_init__(self) -> None:
        if not (self.height > 0 and self.girth > 0):
            raise ValueError(f"height and girth must be positive, got {self.height}, {self.girth}")

    def joints(self) -> Array:
        """The 14 joints of :mod:`cltransfer.skeleton`, (14, 3) [m], lowest ankle at its natural height.

        Proportions are shares of the height: head top 1, shoulders .815, hips .52, knees .285, ankles .045.
        """
        limbs = [self._arm(side) + self._leg(side) for side in _SIDES]
        paired = [limbs[side][part] for part in range(6) for side in (0, 1)]
        neck = (paired[0] + paired[1]) / 2
        joints = np.array([*paired, (0.01, 0.0, 1.0), neck])
        joints[:, 2] += 0.045 - joints[10:12, 2].min()
        return joints * self.height

    def _arm(self, side: int) -> list[Array]:
        swing, bend = (values[0 if side > 0 else 1] for values in (self.swing, self.elbow))
        shoulder = np.array([0.0, side * 0.108 * self.girth, 0.815])
        elbow = shoulder + 0.172 * _hanging(swing, side * self.spread)
        return [shoulder, elbow, elbow + 0.150 * _hanging(swing + bend, side * self.spread * 0.4)]

    def _leg(self, side: int) -> list[Array]:
        swing = side * self.stride
        hip = np.array([0.0, side * 0.055 * self.girth, 0.52])
        knee = hip + 0.235 * _hanging(swing, side * 0.03)
        return [hip, knee, knee + 0.240 * _hanging(swing - 0.5 * self.stride, side * 0.02)]

    def parts(self) -> list[Part]:
        """Painted surfaces, all marked as the subject."""
        joints = self.joints() / self.height
        body = [*self._torso(joints), *self._limbs(joints[0:12:2]), *self._limbs(joints[1:12:2])]
        pieces = [(*piece, 0.0165) for piece in body] + [(*piece, 0.0085) for piece in self._head(joints)]
        h = self.height
        return [Part(shape.scaled(h), paint, spacing * h, subject=True) for shape, paint, spacing in pieces]

    def _limbs(self, chain: Array) -> list[tuple[Lathe, Paint]]:
        """Arm and leg of one side, in body heights."""
        shoulder, elbow, wrist, hip, knee, ankle = chain
        cloth, legs, wide = plain(self.jacket), plain(self.trousers), 0.5 + 0.5 * self.girth
        knuckles = wrist + 0.05 * _unit(wrist - elbow)
        heel, toe = _by(ankle, -0.015, 0.0, -0.020), _by(ankle, 0.075, 0.0, -0.022)
        return [
            (capsule(shoulder, elbow, 0.031 * wide, 0.025 * wide), cloth),
            (capsule(elbow, wrist, 0.025 * wide, 0.020 * wide), cloth),
            (capsule(wrist, knuckles, 0.017, 0.019), plain(self.skin)),
            (capsule(hip, knee, 0.052 * wide, 0.036 * wide), legs),
            (capsule(knee, ankle, 0.036 * wide, 0.026 * wide), legs),
            (capsule(heel, toe, 0.025, 0.021), plain(self.shoes)),
        ]

    def _torso(self, joints: Array) -> list[tuple[Lathe, Paint]]:
        """Hips, jacket, shoulders and a shirt front that shows where forward is, in body heights."""
        g, cloth = self.girth, plain(self.jacket)
        hips, chest = joints[6:8].mean(0), _by(joints[13], 0.0, 0.0, -0.075)
        waist = hips + (chest - hips) * 0.45
        front = capsule(_by(waist, 0.039, 0.0, 0.0), _by(chest, 0.045, 0.0, 0.035), 0.020, 0.026)
        return [
            (
                capsule(hips, _by(waist, 0.0, 0.0, 0.01), 0.088 * g, 0.078 * g, flat=0.66),
                plain(self.trousers),
            ),
            (capsule(_by(hips, 0.0, 0.0, 0.07), chest, 0.087 * g, 0.098 * g, flat=0.62), cloth),
            (capsule(joints[0], joints[1], 0.031, 0.031), cloth),
            (front, plain(self.shirt)),
        ]

    def _head(self, joints: Array) -> list[tuple[Lathe, Paint]]:
        """Neck, head, hair, nose, mouth, eyes and ears, in body heights."""
        middle = _by(joints[12], 0.002, 0.0, -0.066)
        skin, hair, lips = plain(self.skin, 0.015), plain(self.hair, 0.08), plain((0.62, 0.33, 0.30), 0.0)
        neck = capsule(_by(joints[13], 0.0, 0.0, -0.01), _by(middle, -0.004, 0.0, -0.03), 0.034, 0.031)
        nose = capsule(_by(middle, 0.050, 0.0, 0.004), _by(middle, 0.060, 0.0, -0.014), 0.005, 0.008)
        pieces = [
            (neck, skin),
            (ball(middle, 0.044, tall=1.45, flat=1.15), skin),
            (ball(_by(middle, -0.008, 0.0, 0.023), 0.047, tall=0.93, flat=1.13), hair),
            (nose, skin),
            (ball(_by(middle, 0.045, 0.0, -0.033), 0.013, tall=0.3, flat=0.5), lips),
        ]
        for side in _SIDES:
            eye, ear = _by(middle, 0.0465, side * 0.0175, 0.006), _by(middle, -0.004, side * 0.045, -0.006)
            pieces.append((ball(eye, 0.0070, flat=0.6), plain((0.12, 0.10, 0.10), 0.0)))
            pieces.append((ball(ear, 0.006, tall=2.4, flat=2.0), skin))
        return pieces


def _by(point: Array, forward: float, left: float, up: float) -> Array:
    """A place beside ``point``."""
    return point + np.array([forward, left, up])


def _hanging(swing: float, spread: float) -> Array:
    """Unit vector of a limb that hangs down, swung forward and spread to the left [rad]."""
    return np.array([np.sin(swing) * np.cos(spread), np.sin(spread), -np.cos(swing) * np.cos(spread)])


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
