"""The person in the scene: lifted once, projected for ever."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .errors import InputError
from .skeleton import JOINTS, key_joints, stature
from .storage.files import read_json, write_json

TALLER = 3.0  # times the height that the bones tell, or as much less: a body of two heads is less than 2.5 times it
UNIT = 1e-3  # by which a unit vector may be longer or shorter, and lean


@dataclass(frozen=True, eq=False)
class Subject:
    """One person in a scene; tensors are kept as float64 on the CPU.

    Args:
        joints: the 14 joints of :mod:`cltransfer.skeleton` in the world, (14, 3); NaN where unknown.
        confidence: how far each joint can be trusted, (14,) in [0, 1]; 0 where unknown.
        facing: unit vector the body faces, (3,), orthogonal to ``up``.
        up: unit vector upwards, (3,).
        height: standing height, scene units, > 0.
        metres_per_unit: scale where known.
        people: how many the scene shows, this one among them; None where nobody counted.

    Raises:
        ValueError: a shape is wrong or the height is not positive; :meth:`load` checks the other ranges too.
    """

    joints: Tensor  # (14, 3)
    confidence: Tensor  # (14,)
    facing: Tensor  # (3,)
    up: Tensor  # (3,)
    height: float
    metres_per_unit: float | None = None
    people: int | None = None

    def __post_init__(self) -> None:
        for name, shape in (("joints", (14, 3)), ("confidence", (14,)), ("facing", (3,)), ("up", (3,))):
            got = tuple(getattr(self, name).shape)
            if got != shape:
                raise ValueError(f"{name} must be {shape}, got {got}")
            object.__setattr__(self, name, getattr(self, name).to("cpu", torch.float64))
        if not self.height > 0:
            raise ValueError(f"height must be positive, got {self.height}")

    @cached_property
    def key_joints(self) -> Tensor:
        """Head top, chest, waist, knees, feet with their confidence, (5, 4)."""
        return key_joints(torch.cat([self.joints, self.confidence[:, None]], dim=1))

    @cached_property
    def anchor(self) -> Tensor:
        """Middle of the known key joints along the body's own axes, (3,): what an orbit is centred on.

        Raises:
            ValueError: no joint is known.
        """
        known = self.key_joints[:, :3][self.key_joints[:, 3] > 0]
        if len(known) == 0:
            raise ValueError("subject has no known key joint; lift it from other views")
        along = torch.stack([self.left, self.up, self.facing])  # however the scene lies
        places = known @ along.T
        return torch.linalg.solve(along, (places.amin(0) + places.amax(0)) / 2)

    @property
    def left(self) -> Tensor:
        """Unit vector to the body's left, (3,)."""
        return torch.linalg.cross(self.up, self.facing)

    def to_json(self) -> dict[str, Any]:
        """Plain values; an unknown joint is null."""
        known = torch.isfinite(self.joints).all(1)
        return {
            "format": "cltransfer.subject",
            "version": 1,
            "joints": {n: self.joints[i].tolist() if known[i] else None for i, n in enumerate(JOINTS)},
            "confidence": {n: float(self.confidence[i]) for i, n in enumerate(JOINTS)},
            "facing": self.facing.tolist(),
            "up": self.up.tolist(),
            "height": self.height,
            "metres_per_unit": self.metres_per_unit,
            "people": self.people,
        }

    def save(self, path: str | Path, **more: Any) -> None:
        """Write ``subject.json``; ``more`` adds a report beside the values (it is not read back)."""
        write_json(Path(path), {**self.to_json(), **more})

    @classmethod
    def load(cls, path: str | Path) -> Subject:
        """Read ``subject.json``.

        Raises:
            InputError: the file is missing or a field is missing, of the wrong shape, not finite or no person's.
        """
        path = Path(path)
        data = read_json(path)
        if not isinstance(data, Mapping) or data.get("format") != "cltransfer.subject":
            raise InputError(path, "format", "expected 'cltransfer.subject'", "make one with: cltransfer lift SCENE")
        try:
            joints = [data["joints"][n] or [float("nan")] * 3 for n in JOINTS]
            subject = cls(
                torch.tensor(joints, dtype=torch.float64),
                torch.tensor([float(data["confidence"][n]) for n in JOINTS], dtype=torch.float64),
                torch.tensor(data["facing"], dtype=torch.float64),
                torch.tensor(data["up"], dtype=torch.float64),
                float(data["height"]),
                None if data.get("metres_per_unit") is None else float(data["metres_per_unit"]),
                _count(data.get("people")),
            )
        except KeyError as error:
            raise InputError(path, str(error.args[0]), "field is missing") from None
        except (TypeError, ValueError, RuntimeError, AttributeError, OverflowError) as error:
            raise InputError(path, "", f"not a subject: {error}") from None
        for name, wrong, expected in subject._faults():
            raise InputError(path, name, f"expected {expected}, got {wrong}", "lift the scene again")
        return subject

    def _faults(self) -> Iterator[tuple[str, str, str]]:
        """What a person cannot be: the field, what it is, and what was expected."""
        for name in ("facing", "up"):
            vector = getattr(self, name)
            if not abs(float(vector.norm()) - 1) <= UNIT:
                yield name, str(vector.tolist()), "a unit vector"
        slant = float(self.facing @ self.up)
        if not abs(slant) <= UNIT:
            yield "facing", f"{slant:.3g} of its length along up", "a vector orthogonal to up"
        if not math.isfinite(self.height):
            yield "height", str(self.height), "a length"
        bones = stature(self.joints)  # NaN where no bone is known
        if bones * TALLER < self.height < math.inf or self.height * TALLER < bones:
            yield "height", f"{self.height:g}", f"about {bones:.3g}, as its bones tell"
        if self.metres_per_unit is not None and not 0 < self.metres_per_unit < math.inf:
            yield "metres_per_unit", str(self.metres_per_unit), "a number above 0 or null"
        for i, (name, joint, confidence) in enumerate(zip(JOINTS, self.joints, self.confidence.tolist())):
            known = bool(torch.isfinite(joint).all())
            if not known and not bool(torch.isnan(joint).all()):
                yield f"joints.{name}", str(self.joints[i].tolist()), "three numbers or null"
            if not 0 <= confidence <= (1 if known else 0):
                yield f"confidence.{name}", str(confidence), "a number from 0 to 1" if known else "0: it is unknown"
        if not bool((self.key_joints[:, 3] > 0).any()):
            yield "confidence", "0 for all of them", "a known head, chest, waist, knees or feet"


def _count(value: Any) -> int | None:
    if value is not None and (type(value) is not int or value < 1):
        raise ValueError(f"people must be a whole number of at least 1, got {value!r}")
    return value
