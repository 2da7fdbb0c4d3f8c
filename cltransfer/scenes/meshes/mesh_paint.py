"""How the parts of a mesh file look: colours and textures of trimesh, and what it does not pass on of a glTF."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ...computer.array_type import Array
from ...computer.memory import require_free
from ...errors import InputError
from .glass import tell_unread, transmission_of
from .glow import UNLIT, WHOLE
from .gltf_file import Gltf
from .gltf_places import GLOSSY, shown_texture, transform_of, wraps_of
from .mesh import GREY, REPEATED, Mesh, Wrap
from .textures import Textures, image_of

PLACE_LIMIT = 1e6  # of a texture coordinate, in widths of the texture
FACE_BYTES = 400  # of a face with vertices of its own, at the peak
FLOAT = 5126  # type of an accessor
HALF = 0.5  # alpha below which what is half transparent is not drawn
_MOST = {"f": 1, "B": 255, "H": 65535}  # stored for a colour of 1, by type


@dataclass(frozen=True, eq=False)
class Look:
    """What a material says and trimesh does not pass on.

    Args:
        lit: whether a renderer is to light it; None: where it shows no texture.
        textured: whether it promises a texture.
        transform: from texture coordinates to places in the texture, (2, 3); None where they are the same.
        wraps: how the texture goes on beyond its edges, across and down.
        factor: linear RGBA in [0, 1] that multiplies texture and vertex colours, (4,); None: trimesh says.
        cutoff: alpha in [0, 1] below which nothing is drawn; infinite where nothing is, whatever its alpha.
        opacity: alpha in [0, 1] of what has no factor.
        holes: whether the alpha of its texture counts.
        color: RGB in [0, 1], as a screen shows it, of what has no factor, which multiplies its texture; None: grey, and
            nothing beside a texture.
    """

    lit: bool | None
    textured: bool
    transform: Array | None = None  # (2, 3)
    wraps: tuple[Wrap, Wrap] = REPEATED
    factor: Array | None = None  # (4,)
    cutoff: float = 0.0
    opacity: float = 1.0
    holes: bool = True
    color: tuple[float, float, float] | None = None

    @property
    def least(self) -> float:
        """Alpha of the texture below which nothing is drawn."""
        opacity = self.opacity if self.factor is None else float(self.factor[3])
        if self.cutoff == 0 or not self.holes:
            return 0.0
        return self.cutoff / opacity if opacity > 0 else math.inf


def with_looks(gltf: Gltf) -> tuple[Gltf, Mapping[str, Look]]:
    """The document with other names for its materials, and what each of them is like.

    Coloured vertices without a material get one: trimesh passes their colours on as stored only beside a material.

    Raises:
        InputError: there are not as many colours or texture coordinates as vertices, the latter are no pairs or
            integers that are no shares, a texture is to be moved or wrapped in a way that is not known, or what a
            material lets through is no share.
    """
    for attributes in (one["attributes"] for mesh in gltf.tree["meshes"] for one in mesh["primitives"]):
        _check_counts(gltf, attributes)
    gltf = _with_plain_places(gltf)
    tell_unread(gltf.path, gltf.tree)
    materials = gltf.tree.get("materials", [])
    looks = {str(i): _look(gltf, about) for i, about in enumerate(materials)}
    looks[str(len(materials))] = Look(lit=False, textured=False)  # light is in the colours already
    renamed = [{**about, "name": name} for name, about in zip(looks, [*materials, {}])]
    meshes = [
        {**mesh, "primitives": [_with_material(one, len(materials)) for one in mesh["primitives"]]}
        for mesh in gltf.tree["meshes"]
    ]
    return replace(gltf, tree={**gltf.tree, "materials": renamed, "meshes": meshes}), looks


def _look(gltf: Gltf, about: dict[str, Any]) -> Look:
    return Look(
        lit=UNLIT not in about.get("extensions", {}),
        textured=bool(shown_texture(about)),
        transform=transform_of(gltf.path, about),
        wraps=wraps_of(gltf.path, gltf.tree, about),
        factor=_factor(gltf.path, about),
        cutoff=_cutoff(gltf.path, about),
        holes=not about.get(WHOLE, False),
    )


def _factor(path: Path, about: dict[str, Any]) -> Array | None:
    """Of :class:`Look`: white where the material does not say; trimesh works that of a glossy one out."""
    if GLOSSY in about.get("extensions", {}):
        return None
    stored = about.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1, 1, 1, 1])
    factor = np.array(stored, np.float64)
    if factor.shape != (4,) or not np.isfinite(factor).all():
        raise InputError(path, "materials", f"expected a baseColorFactor of four finite numbers, got {stored!r:.80}")
    return factor.clip(0, 1)


def _cutoff(path: Path, about: dict[str, Any]) -> float:
    """Of :class:`Look`; what is half transparent or more is not drawn, and glass is by what it lets through."""
    mode, cutoff, solid = about.get("alphaMode"), about.get("alphaCutoff", 0.5), 1 - transmission_of(path, about)
    if solid < HALF:
        return math.inf
    if mode not in ("MASK", "BLEND"):
        return 0.0
    if mode == "BLEND":
        return HALF / solid
    if not isinstance(cutoff, (int, float)) or not cutoff >= 0:
        raise InputError(path, "materials", f"expected an alphaCutoff of 0 or more, got {cutoff!r:.40}")
    return float(cutoff) if cutoff <= 1 else math.inf


def _check_counts(gltf: Gltf, attributes: dict[str, Any]) -> None:
    for name in {"COLOR_0", "TEXCOORD_0"} & attributes.keys():
        expected, got = (gltf.entry("accessors", attributes[of])["count"] for of in ("POSITION", name))
        if expected != got:
            raise InputError(gltf.path, name, f"expected {expected}, one of each vertex, got {got}")
    if "TEXCOORD_0" in attributes and (kind := gltf.entry("accessors", attributes["TEXCOORD_0"])["type"]) != "VEC2":
        raise InputError(gltf.path, "TEXCOORD_0", f"expected two numbers of each vertex, a VEC2, got {kind!r:.40}")


def _with_material(primitive: dict[str, Any], material: int) -> dict[str, Any]:
    return {"material": material, **primitive} if "COLOR_0" in primitive["attributes"] else primitive


def _with_plain_places(gltf: Gltf) -> Gltf:
    """The document with texture coordinates that are stored as integers written out: trimesh takes them as they are."""
    attributes = [one["attributes"] for mesh in gltf.tree["meshes"] for one in mesh["primitives"]]
    indices = dict.fromkeys(one["TEXCOORD_0"] for one in attributes if "TEXCOORD_0" in one)
    accessors, views = ([*gltf.tree.get(kind, [])] for kind in ("accessors", "bufferViews"))
    buffers = [*gltf.buffers]
    for index in indices:
        about = gltf.entry("accessors", index)
        if about["componentType"] == FLOAT:
            continue
        if not about.get("normalized"):
            raise InputError(gltf.path, "TEXCOORD_0", "expected float32, or integers that are marked as normalized")
        buffers.append(gltf.array(index).astype("<f4").tobytes())
        accessors[index] = {**about, "bufferView": len(views), "componentType": FLOAT, "byteOffset": 0}
        accessors[index].pop("normalized")
        views.append({"buffer": len(buffers) - 1, "byteLength": len(buffers[-1])})
    return replace(gltf, tree={**gltf.tree, "accessors": accessors, "bufferViews": views}, buffers=tuple(buffers))


def painted(path: Path, looks: Mapping[str, Look], textures: Textures, mesh: Mesh, visual: Any) -> Mesh:
    """The mesh with the colours and the texture of a trimesh visual; ``looks`` are of the materials by name.

    Raises:
        InputError: a colour or a texture coordinate is no sensible number, or a texture is not there.
        ResourceError: vertices of each face's own take more memory than is free.
    """
    if visual.kind == "vertex":
        return _vertex_painted(mesh, visual)
    if visual.kind == "face":
        return _face_painted(path, mesh, visual)
    material = getattr(visual, "material", None)
    if material is None:
        return mesh
    image, uv = image_of(material), getattr(visual, "uv", None)
    shown = image is not None and uv is not None and len(uv) == len(mesh.vertices)
    look = looks.get(str(getattr(material, "name", "")), Look(lit=None, textured=False))
    lit = not shown if look.lit is None else look.lit
    if image is None and look.textured:
        raise InputError(path, "images", "a texture cannot be decoded")
    rgba = _rgba(path, look, visual).expand(len(mesh.vertices), 4)
    mesh = replace(mesh, colors=rgba[:, :3].contiguous(), shaded=torch.full_like(mesh.shaded, lit))
    if look.cutoff > 0:
        mesh = mesh.of_faces(rgba[:, 3][mesh.faces.long()].mean(1) >= look.cutoff)  # no texture makes it more
    if not shown:
        return mesh
    places = _places(path, np.asarray(uv, np.float64), look.transform)
    first = torch.zeros_like(mesh.texture)
    return replace(mesh, uv=places, texture=first, textures=(textures.of(material),), wraps=(look.wraps,))


def _places(path: Path, uv: Array, transform: Array | None) -> Tensor:
    """Places in the texture (V, 2) float32 from the top left; trimesh counts them from the bottom."""
    if uv.shape[1] == 1:  # v is optional in an OBJ, and 0
        uv = np.pad(uv, ((0, 0), (0, 1)))
    _check_places(path, uv)
    places = uv.astype(np.float32)
    places[:, 1] = 1 - places[:, 1]
    if transform is not None:
        moved = places @ transform[:, :2].T + transform[:, 2]
        _check_places(path, moved)
        places = moved.astype(np.float32)
    return torch.from_numpy(places)


def _check_places(path: Path, uv: Array) -> None:
    wrong = np.flatnonzero(~(np.abs(uv) <= PLACE_LIMIT).all(1))
    if len(wrong):
        got = " ".join(f"{value:g}" for value in uv[wrong[0]])
        reason = f"expected at most {PLACE_LIMIT:g} in size, got {got} at vertex {wrong[0]}"
        raise InputError(path, "texture coordinates", reason)


def _vertex_painted(mesh: Mesh, visual: Any) -> Mesh:
    rgba = torch.from_numpy(np.asarray(visual.vertex_colors, np.float32)[:, :3].copy() / 255)
    return replace(mesh, colors=rgba, shaded=torch.zeros_like(mesh.shaded))


def _face_painted(path: Path, mesh: Mesh, visual: Any) -> Mesh:
    """Each face has vertices of its own, so that its colour ends where it does."""
    colors = np.asarray(visual.face_colors, np.float32)[:, :3] / 255
    require_free(FACE_BYTES * len(mesh), path, f"{len(mesh)} faces of a colour each", "thin the file")
    corners = mesh.vertices[mesh.faces.long()].reshape(-1, 3)
    faces = torch.arange(len(corners), dtype=torch.int32).reshape(-1, 3)
    rgb = torch.from_numpy(colors).repeat_interleave(3, 0)
    return Mesh.plain(corners, faces, rgb)


def _rgba(path: Path, look: Look, visual: Any) -> Tensor:
    """What multiplies the texture, as a screen shows it, RGBA in [0, 1] of each vertex or of all, (V or 1, 4)."""
    material, own, factor = visual.material, _own_colors(path, visual), look.factor
    stored = getattr(material, "baseColorFactor", None)
    if factor is None and stored is not None:
        factor = np.asarray(stored) / 255
    if own is not None or factor is not None:
        linear = np.atleast_2d((1.0 if own is None else own) * (1.0 if factor is None else factor))
        return torch.from_numpy(_shown(linear))
    plain = GREY if image_of(material) is None else 1.0
    return torch.tensor([[*(look.color or [plain] * 3), look.opacity]])


def _own_colors(path: Path, visual: Any) -> Array | None:
    """Linear RGBA of a glTF's vertices, (V, 4) in [0, 1]; None where they have none."""
    stored = visual.vertex_attributes.get("color")
    if stored is None:
        return None
    values = np.asarray(stored)
    most = _MOST.get(values.dtype.char)
    if most is None or values.shape[1:] not in ((3,), (4,)):
        got = f"{values.dtype} {values.shape}"
        raise InputError(path, "COLOR_0", f"expected three or four columns of float32, uint8 or uint16, got {got}")
    rgba = np.ones((len(values), 4))
    rgba[:, : values.shape[1]] = values.astype(np.float64) / most
    if not np.isfinite(rgba).all():
        raise InputError(path, "COLOR_0", "expected finite numbers")
    return rgba.clip(0, 1)


def _shown(linear: Array) -> Array:
    """Linear RGBA (N, 4) as a screen shows it, float32: the curve of sRGB, of which alpha has none."""
    rgba = linear.astype(np.float32)
    rgb = linear[:, :3]
    rgba[:, :3] = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)  # IEC 61966-2-1
    return rgba
