"""Scenes: what people have, read into one value."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from ..registry.plugin_code import code_of
from ..subject import Subject


@dataclass(frozen=True, eq=False)
class Scene:
    """A geometry with a person in it.

    Args:
        geometry: what a renderer draws, see :class:`~cltransfer.scenes.geometry.Geometry`; it carries the subject's
            labels.
        subject: the person, None until lifted.
        up: unit vector upwards, (3,) float64.
        name: for tables and folders.
        digest: SHA-256 of what it was read from, the key of every cache about it, with :attr:`code`.
        read_by: SHA-256 of the plugin's code that has read it, empty where we have.
    """

    geometry: Any
    subject: Subject | None
    up: Tensor  # (3,)
    name: str
    digest: str
    read_by: str = ""

    @property
    def person(self) -> Subject:
        """The subject of a scene that must have one.

        Raises:
            ValueError: nobody was lifted.
        """
        if self.subject is None:
            raise ValueError(f"expected a scene with a person, {self.name} has none")
        return self.subject

    @property
    def code(self) -> str:
        """SHA-256 of the plugin's code that the geometry comes from, empty for ours: it may make another tomorrow."""
        return self.read_by or code_of(self.geometry)

    @property
    def harmonics(self) -> int | None:
        """Degree of the harmonics that splats were read with: free memory decides of it too. None of other geometry."""
        from .splats import Splats

        return self.geometry.degree if isinstance(self.geometry, Splats) else None

    @property
    def person_digest(self) -> str:
        """SHA-256 of the person and of the labels that mark it."""
        person = None if self.subject is None else self.subject.to_json()
        told = hashlib.sha256(json.dumps(person).encode())
        told.update(self.geometry.label.contiguous().numpy().tobytes())
        return told.hexdigest()
