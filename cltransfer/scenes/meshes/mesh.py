"""Triangle meshes as a value: one convention for what every file format says about colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import torch
from torch import Tensor

from ...renderers.kernels.mesh import Packed, pack_images
from ...renderers.kernels.mesh_raster import CLAMP, MIRROR, REPEAT

GREY = 0.8  # colour of what has none

Wrap = Literal["repeat", "clamp", "mirror"]
REPEATED: tuple[Wrap, Wrap] = ("repeat", "repeat")
CLAMPED: tuple[Wrap, Wrap] = ("clamp", "clamp")
_NUMBERS = {"repeat": REPEAT, "clamp": CLAMP, "mirror": MIRROR}  # as the kernels take them


@dataclass(frozen=True, eq=False)
class Mesh:
    """V vertices and F triangles, seen from both sides.

    The colour of a point is its vertices' colour times its texture's, as a screen shows it (sRGB). Where a texture's
    alpha is less than a half there is a hole.

    Args:
        vertices: in the world, (V, 3) float32, scene units.
        faces: three vertices each, (F, 3) int32.
        colors: RGB in [0, 1], (V, 3).
        label: membership in the subject, [0, 1], (F,).
        shaded: whether a renderer is to light the face, (F,) bool; many colours and textures hold their light already.
        uv: place in the texture, (V, 2); (0, 0) is its top left corner, (1, 1) its bottom right.
        texture: which of ``textures``, (F,) int32; -1 is none.
        textures: RGBA images, each (h, w, 4) uint8.
        wraps: how each texture goes on beyond its edges, across and down; () is that all of them repeat.

    Raises:
        ValueError: a shape is wrong, or an index is out of range.
    """

    renderer: ClassVar[str] = "mesh"

    vertices: Tensor  # (V, 3)
    faces: Tensor  # (F, 3)
    colors: Tensor  # (V, 3)
    label: Tensor  # (F,)
    shaded: Tensor  # (F,)
    uv: Tensor  # (V, 2)
    texture: Tensor  # (F,)
    textures: tuple[Tensor, ...] = ()  # (h, w, 4)
    wraps: tuple[tuple[Wrap, Wrap], ...] = ()

    def __post_init__(self) -> None:
        v, f = len(self.vertices), len(self.faces)
        shapes = {"vertices": (v, 3), "faces": (f, 3), "colors": (v, 3), "uv": (v, 2)}
        for name, shape in {**shapes, "label": (f,), "shaded": (f,), "texture": (f,)}.items():
            got = tuple(getattr(self, name).shape)
            if got != shape:
                raise ValueError(f"{name} must be {shape}, got {got}")
        for name, low, count in (("faces", 0, v), ("texture", -1, len(self.textures))):
            index = getattr(self, name)
            if index.numel() and not low <= int(index.min()) <= int(index.max()) < count:
                raise ValueError(f"{name} must be in [{low}, {count}), got {int(index.min())} to {int(index.max())}")
        for image in self.textures:
            if image.dim() != 3 or image.shape[2] != 4 or image.dtype != torch.uint8 or image.numel() == 0:
                raise ValueError(f"a texture must be (h, w, 4) uint8, got {tuple(image.shape)} {image.dtype}")
        if self.wraps and len(self.wraps) != len(self.textures):
            raise ValueError(f"wraps must be () or {len(self.textures)}, one of each texture, got {len(self.wraps)}")

    def __len__(self) -> int:
        return len(self.faces)

    @property
    def corners(self) -> Tensor:
        """Vertices of each face, (F, 3, 3)."""
        return self.vertices[self.faces.long()]

    @property
    def means(self) -> Tensor:
        """Middles of the faces, (F, 3)."""
        return self.corners.mean(1)

    @property
    def wrapped(self) -> tuple[tuple[Tensor, tuple[Wrap, Wrap]], ...]:
        """Each texture, and how it goes on beyond its edges."""
        return tuple(zip(self.textures, self.wraps or [REPEATED] * len(self.textures)))

    def with_label(self, label: Tensor) -> Mesh:
        """The same faces with another subject membership (F,) in [0, 1]."""
        return replace(self, label=label.to(self.label))

    def moved(self, transform: Tensor) -> Mesh:
        """The same mesh after ``transform`` (4, 4); a mirrored one keeps the outer side of its faces."""
        matrix = transform.double()
        vertices = self.vertices.double() @ matrix[:3, :3].T + matrix[:3, 3]
        mirrored = bool(torch.linalg.det(matrix[:3, :3]) < 0)
        return replace(self, vertices=vertices.float(), faces=self.faces[:, [0, 2, 1]] if mirrored else self.faces)

    def of_faces(self, keep: Tensor) -> Mesh:
        """The faces that ``keep`` (F,) bool marks; all vertices stay."""
        rows = {name: getattr(self, name)[keep] for name in ("faces", "label", "shaded", "texture")}
        return replace(self, **rows)

    @classmethod
    def plain(cls, vertices: Tensor, faces: Tensor, colors: Tensor | None = None) -> Mesh:
        """Without textures; without ``colors`` (V, 3) it is grey, and lit by the renderer."""
        grey = torch.full((len(vertices), 3), GREY)
        return cls(
            vertices.float(),
            faces.int(),
            grey if colors is None else colors.float(),
            torch.zeros(len(faces)),
            torch.full((len(faces),), colors is None),
            torch.zeros(len(vertices), 2),
            torch.full((len(faces),), -1, dtype=torch.int32),
        )

    @staticmethod
    def concatenate(parts: Sequence[Mesh]) -> Mesh:
        """All of ``parts`` in one world; an image that several of them share and wrap alike is kept once."""
        first_vertex = np.cumsum([0, *(len(p.vertices) for p in parts)])
        faces = [p.faces + int(first) for p, first in zip(parts, first_vertex)]
        images = {(id(image), wrap): image for p in parts for image, wrap in p.wrapped}
        place = {key: i for i, key in enumerate(images)}
        places = [p.texture.new_tensor([*(place[id(image), wrap] for image, wrap in p.wrapped), -1]) for p in parts]
        texture = [new[p.texture.long()] for p, new in zip(parts, places)]
        names = ("vertices", "colors", "label", "shaded", "uv")
        joined = {name: torch.cat([getattr(p, name) for p in parts]) for name in names}
        return Mesh(
            **joined,
            faces=torch.cat(faces).int(),
            texture=torch.cat(texture).int(),
            textures=tuple(images.values()),
            wraps=tuple(wrap for _, wrap in images),
        )

    @cached_property
    def packed(self) -> Packed:
        """Layout of the CPU kernels, made on first use."""
        wraps = [(_NUMBERS[across], _NUMBERS[down]) for _, (across, down) in self.wrapped]
        arrays = {id(image): image.cpu().numpy() for image in self.textures}  # one of an image under several wraps
        texels, images = pack_images([arrays[id(image)] for image in self.textures], wraps)
        floats = (self.vertices, self.colors, self.uv)
        vertices, colors, uv = (np.ascontiguousarray(t.detach().cpu().numpy(), np.float32) for t in floats)
        faces, texture = (np.ascontiguousarray(t.cpu().numpy(), np.int32) for t in (self.faces, self.texture))
        label = np.ascontiguousarray(self.label.detach().cpu().numpy(), np.float32)
        return Packed(vertices, faces, colors, uv, label, self.shaded.cpu().numpy(), texture, texels, images)


def folded(uv: Tensor, wraps: tuple[Wrap, Wrap]) -> Tensor:
    """Places (N, 2) in a texture that goes on beyond its edges, brought into [0, 1]; what is no number is at 0."""
    return torch.stack([_folded(place, wrap) for place, wrap in zip(uv.unbind(-1), wraps)], dim=-1).nan_to_num(0.0)


def _folded(place: Tensor, wrap: Wrap) -> Tensor:
    if wrap == "clamp":
        return place.clamp(0, 1)
    if wrap == "mirror":
        inside = place - 2 * (place / 2).floor()
        return torch.where(inside > 1, 2 - inside, inside)
    return place - place.floor()
