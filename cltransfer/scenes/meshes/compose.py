"""Scenes of several mesh files, described in YAML: which file, where it stands, whether it is the subject.

up: [0, 1, 0]
parts:
  - {file: gallery.glb, label: scene}
  - {file: man.glb, label: subject, translate: [0, 0, 1], rotate_deg: [0, 90, 0], scale: 1.0, time: 0.4}
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix
from torch import Tensor

from ...computer.memory import require_free
from ...errors import InputError
from ...storage.files import content_hash, read_text
from ...storage.yaml_text import MOST_BITS, check_yaml, long_numbers, named_twice, plain_values
from ...subject import Subject
from .. import Scene
from ..steps import check_steps
from .asset_files import inside
from .mesh import Mesh
from .moment import Moment
from .numbers import is_number
from .read_mesh import UP, MeshFile, read_mesh

VARIABLE = "CLTRANSFER_ASSETS"
YAML_LIMIT = 2**20  # bytes
MOST_PARTS = 256
JOINED_BYTES = 100  # of a vertex or a face beside the files' own, while parts are placed and joined
_HINT = f"files lie beside the YAML or below, or in the folder {VARIABLE} names"


@dataclass(frozen=True)
class Part:
    """One file of a scene.

    Args:
        file: mesh file, relative to the YAML's folder or to the asset root.
        label: whether it is the person or what is around.
        translate: where its origin goes, scene units.
        rotate_deg: turns about the x, then the y, then the z axis of the scene [degrees].
        scale: size, > 0; it is applied first, then the turns, then the move.
        time: of its animation [s].
        animation: its name; None is the first.

    Raises:
        ValueError: an option is out of range.
    """

    file: str
    label: str = "scene"
    translate: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotate_deg: tuple[float, ...] = (0.0, 0.0, 0.0)
    scale: float = 1.0
    time: float = 0.0
    animation: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.file, str) or not self.file:
            raise ValueError(f"file must be a name, got {self.file!r}")
        if self.label not in ("subject", "scene"):
            raise ValueError(f"label must be subject or scene, got {self.label!r}")
        for name in ("translate", "rotate_deg"):
            if not _is_vector(getattr(self, name)):
                raise ValueError(f"{name} must be three numbers, got {getattr(self, name)!r}")
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        if not is_number(self.scale) or self.scale <= 0:
            raise ValueError(f"scale must be positive, got {self.scale!r}")
        if not is_number(self.time):
            raise ValueError(f"time must be seconds, got {self.time!r}")
        for name in ("scale", "time"):
            object.__setattr__(self, name, float(getattr(self, name)))  # a whole number may be longer than torch takes
        if self.animation is not None and not isinstance(self.animation, str):
            raise ValueError(f"animation must be a name, got {self.animation!r}")

    @property
    def rotation(self) -> Tensor:
        """Turns about the scene's axes, (3, 3) float64."""
        turns = torch.diag(torch.deg2rad(torch.tensor(self.rotate_deg, dtype=torch.float64)))
        x, y, z = axis_angle_to_rotation_matrix(turns)
        return z @ y @ x

    @property
    def transform(self) -> Tensor:
        """File to scene, (4, 4) float64."""
        matrix = torch.eye(4, dtype=torch.float64)
        matrix[:3, :3] = self.scale * self.rotation
        matrix[:3, 3] = torch.tensor(self.translate, dtype=torch.float64)
        return matrix


def read_composed(path: Path, up: tuple[float, float, float] | None = None) -> Scene:
    """Read the scene that a YAML file composes, of files in its folder or the one that CLTRANSFER_ASSETS names.

    Args:
        path: the YAML.
        up: upwards in the scene; None is what the YAML says, or +y.

    Raises:
        InputError: the YAML is damaged, a part is, a file lies elsewhere, two parts are the subject, or what they make
            lies too far from its origin for float32.
        ResourceError: a part, or all of them, take more memory than is free.
    """
    about = _read_yaml(path)
    parts = _parts(path, about)
    given_up = _unit(path, up or about.get("up", UP))
    read = [_read(path, part, i, given_up) for i, part in enumerate(parts)]
    mesh = _joined(path, parts, [file.mesh for file in read])
    check_steps(path, mesh.corners.flatten(0, 1))
    people = [_moved(part, file.subject) for part, file in zip(parts, read) if part.label == "subject"]
    digest = hashlib.sha256(path.read_bytes())
    for name in (name for file in read for name in file.files):
        digest.update(content_hash(name).encode())
    person = people[0] if people else None
    return Scene(mesh, person, torch.tensor(given_up).double(), path.stem, digest.hexdigest())


def _read_yaml(path: Path) -> dict[str, Any]:
    import yaml

    text = read_text(path, YAML_LIMIT)
    try:
        check_yaml(text, yaml.SafeLoader)
        about = plain_values(text)
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(path, "", f"not plain YAML: {' '.join(str(error).split())[:160]}") from None
    for number in long_numbers(about):
        raise InputError(path, "", f"expected numbers of at most {MOST_BITS} bits, got one of {number.bit_length()}")
    for twice in named_twice(yaml.compose(text, yaml.SafeLoader)):
        raise InputError(path, twice[:40], "expected each key once, it is there twice")
    if not isinstance(about, dict) or not about.keys() <= {"up", "parts"}:
        came = ", ".join(map(str, about)) if isinstance(about, dict) else type(about).__name__
        raise InputError(path, "", f"expected the keys up and parts and no other, got {came[:80] or 'none'}")
    return about


def _parts(path: Path, about: dict[str, Any]) -> list[Part]:
    listed = about.get("parts")
    if not isinstance(listed, list) or not 1 <= len(listed) <= MOST_PARTS:
        raise InputError(path, "parts", f"expected a list of 1 to {MOST_PARTS}")
    known = {field.name for field in fields(Part)}
    parts = []
    for i, entry in enumerate(listed):
        field = f"parts[{i}]"
        if not isinstance(entry, dict) or "file" not in entry:
            raise InputError(path, field, "expected a mapping with file")
        if unknown := {str(key) for key in entry} - known:
            raise InputError(
                path, field, f"unknown: {', '.join(sorted(unknown))}", f"known: {', '.join(sorted(known))}"
            )
        try:
            parts.append(Part(**entry))
        except ValueError as error:
            raise InputError(path, field, str(error)) from None
    if sum(part.label == "subject" for part in parts) > 1:
        raise InputError(path, "parts", "expected one subject at most")
    return parts


def part_files(path: Path) -> list[Path]:
    """The files that a YAML file composes, see :func:`read_composed`."""
    return [_file(path, part, i) for i, part in enumerate(_parts(path, _read_yaml(path)))]


def _file(path: Path, part: Part, index: int) -> Path:
    folder, named = path.parent, os.environ.get(VARIABLE)
    if named and not (folder / part.file).is_file():
        folder = Path(named)
    try:
        return inside(folder, part.file, path, f"parts[{index}].file")
    except InputError as error:
        raise InputError(path, error.field, error.reason, error.hint or _HINT) from None


def _read(path: Path, part: Part, index: int, up: tuple[float, float, float]) -> MeshFile:
    """The file of one part; its own upwards is the scene's before the part was turned."""
    file = _file(path, part, index)
    if file.suffix.lower() not in (".glb", ".gltf") and (part.time or part.animation):
        field = f"parts[{index}].{'time' if part.time else 'animation'}"
        raise InputError(path, field, f"{file.name} does not move, only glTF does", "leave it out")
    own_up = part.rotation.T @ torch.tensor(up, dtype=torch.float64)
    x, y, z = own_up.tolist()
    return read_mesh(file, Moment(part.time, part.animation), (x, y, z), part.label == "subject")


def _joined(path: Path, parts: Sequence[Part], meshes: Sequence[Mesh]) -> Mesh:
    vertices, faces = sum(len(mesh.vertices) for mesh in meshes), sum(len(mesh) for mesh in meshes)
    require_free(JOINED_BYTES * (vertices + faces), path, f"{faces} faces of its parts", "take fewer parts")
    return Mesh.concatenate([_placed(path, i, part, mesh) for i, (part, mesh) in enumerate(zip(parts, meshes))])


def _placed(path: Path, index: int, part: Part, mesh: Mesh) -> Mesh:
    moved = mesh.moved(part.transform)
    if not bool(moved.vertices.isfinite().all()):
        reason = f"expected vertices that float32 can hold, got infinity at scale {part.scale:g}"
        raise InputError(path, f"parts[{index}]", reason, "take a smaller scale or translate")
    return moved.with_label(torch.full((len(mesh),), float(part.label == "subject")))


def _moved(part: Part, person: Subject | None) -> Subject | None:
    """The person where the part stands; None where its file names no joints, and lifting has to find them."""
    if person is None:
        return None
    joints = person.joints @ part.transform[:3, :3].T + part.transform[:3, 3]
    facing, up = (part.rotation @ direction for direction in (person.facing, person.up))
    return replace(person, joints=joints, facing=facing, up=up, height=person.height * part.scale)


def _is_vector(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) == 3 and all(is_number(part) for part in value)


def _unit(path: Path, value: Any) -> tuple[float, float, float]:
    if not _is_vector(value) or not 0 < math.hypot(*value) < math.inf:
        raise InputError(path, "up", f"expected a direction, got {value!r}")
    x, y, z = (float(part) / math.hypot(*value) for part in value)
    return x, y, z
