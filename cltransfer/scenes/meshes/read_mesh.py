"""Mesh files, glTF, OBJ and PLY, read by trimesh with limits; skinned glTF is posed and gives its person."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ...computer.array_type import Array
from ...errors import InputError, ResourceError
from ...subject import Subject
from ..steps import check_steps
from .asset_files import Beside, read_limited
from .gltf_figure import Skeleton
from .gltf_file import read_gltf
from .gltf_images import shown_images
from .gltf_modes import without_fans
from .gltf_skin import POSED, posed
from .gltf_tree import lean
from .mesh import Mesh
from .mesh_need import check_obj, check_ply
from .mesh_paint import Look, painted, with_looks
from .moment import START, Moment
from .mtl import ObjFiles, check_images, looks_of, tell_passed_over
from .obj_text import readable
from .ply_colors import own_visual
from .ply_faces import of_triangles
from .ply_textures import of_one_texture, textures_of
from .rig import subject_of_rig, tell_nobody
from .textures import Textures, image_of

SUFFIXES = (".glb", ".gltf", ".obj", ".ply")
UP = (0.0, 1.0, 0.0)  # of glTF by its standard, of most OBJ and PLY by habit
LOST = 0.01  # share of vertices that may be not finite

_log = logging.getLogger("cltransfer")


@dataclass(frozen=True, eq=False)
class MeshFile:
    """What a mesh file holds.

    Args:
        mesh: its triangles in the file's world; the faces of a recognised figure, and of what its joints hold, are
            labelled.
        subject: the person its skeleton names, None where there is none.
        files: every file that was opened.
    """

    mesh: Mesh
    subject: Subject | None
    files: tuple[Path, ...]


def read_mesh(path: Path, moment: Moment = START, up: tuple[float, float, float] = UP, person: bool = True) -> MeshFile:
    """Read a mesh.

    Args:
        path: .glb, .gltf, .obj or .ply; glTF is told from the content.
        moment: the pose of an animated glTF.
        up: unit vector upwards in the file.
        person: whether its joints are to name one; it is told where they do not.

    Raises:
        InputError: the file is missing, empty, damaged, without faces, larger than the limits, more than 1 % of its
            vertices are not finite, it names a file outside its folder, a texture cannot be decoded, or it lies too far
            from its origin for float32.
        ResourceError: it takes more memory than is free.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(path, "", f"no mesh has the suffix {suffix!r}", f"expected {', '.join(SUFFIXES)}")
    files, rig = ObjFiles(path) if suffix == ".obj" else Beside(path), None
    looks: Mapping[str, Look] = {}
    beside: Any = files
    if suffix in (".glb", ".gltf"):
        data, rig, beside, looks = _posed_glb(path, moment, files)
        suffix = ".glb"
    else:
        data = read_limited(path)
        {".obj": check_obj, ".ply": check_ply}[suffix](path, data)
        data = readable(path, data, files) if isinstance(files, ObjFiles) else of_triangles(path, data)
    found = list(_geometries(path, data, suffix, beside))
    visuals = [geometry.visual for _, _, geometry in found]
    if isinstance(files, ObjFiles):
        check_images(files.libraries, visuals)
        tell_passed_over(files.libraries, visuals)
        looks = looks_of(visuals)
        visuals = [_with_vertex_colors(geometry, looks) for _, _, geometry in found]
    least = {name: look.least for name, look in looks.items()}
    textures = Textures(path, [getattr(visual, "material", None) for visual in visuals], least)
    parts = [_part(path, looks, textures, *part) for part in found]
    mesh = _finite(path, Mesh.concatenate(parts)) if parts else None
    if mesh is None or len(mesh) == 0:
        raise InputError(path, "", "holds no faces", "is it a point cloud, or all transparent?")
    check_steps(path, mesh.corners.flatten(0, 1))
    subject = _subject(rig, up)
    if subject is None:
        if rig is not None and person:
            tell_nobody(path, rig)
        mesh = mesh.with_label(torch.zeros(len(mesh)))
    return MeshFile(mesh, subject, (path, *files.given))


def _subject(rig: Skeleton | None, up: tuple[float, float, float]) -> Subject | None:
    return None if rig is None else subject_of_rig(rig, np.array(up))


def _posed_glb(
    path: Path, moment: Moment, files: Beside
) -> tuple[bytes, Skeleton | None, dict[str, bytes], Mapping[str, Look]]:
    """A file without skins or animation, the skeleton there was, the images it names, and its materials by name."""
    try:
        gltf, rig = posed(read_gltf(path, files), moment.time, moment.animation)
        gltf, images = shown_images(gltf, files)
        gltf, looks = with_looks(without_fans(gltf))
        return replace(gltf, tree=lean(gltf.tree)).to_glb(), rig, images, looks
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        # what a value may be is checked where it is used; any other shape of the JSON ends here
        reason = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"
        raise InputError(path, "", f"damaged glTF: {reason}") from None


def _geometries(path: Path, data: bytes, suffix: str, files: Any) -> Iterator[tuple[str, Array, Any]]:
    """Node, transform to the world (4, 4) and geometry of everything with faces; ``files`` gives bytes by name."""
    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # what matters is raised below
    try:
        # vertices of a PLY are split, and their colours lost, only where there is a texture to be shown
        names = textures_of(data) if suffix == ".ply" else []
        split: dict[str, Any] = {"fix_texture": bool(names)} if suffix == ".ply" else {}
        scene = trimesh.load_scene(io.BytesIO(data), suffix[1:], files, process=False, **split)
        if isinstance(files, Beside) and files.refused is not None:
            raise files.refused
        for node in scene.graph.nodes_geometry:
            transform, name = scene.graph[node]
            geometry = scene.geometry[name]
            if isinstance(geometry, trimesh.Trimesh):
                visual: Any = geometry.visual
                invented = suffix != ".glb" and _is_invented(visual)
                if invented and any(split.values()):
                    raise InputError(path, "images", "a texture cannot be decoded")
                if suffix == ".ply" and (invented or visual.kind in ("face", "vertex")):
                    geometry.visual = own_visual(path, geometry)
                elif invented:
                    geometry.visual = _own_colors(geometry)
                several = len(set(names)) > 1 and visual.kind == "texture"
                for part in of_one_texture(path, geometry, names, files) if several else [geometry]:
                    yield str(node), transform, part
    except (InputError, ResourceError, MemoryError):
        raise
    except Exception as error:  # trimesh lets any exception of its parsers through
        reason = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"
        raise InputError(path, "", f"cannot be read as {suffix[1:]}: {reason}") from None


def _is_invented(visual: Any) -> bool:
    """Whether an OBJ or a PLY shows the grey image that trimesh makes up for texture coordinates without a texture."""
    image = image_of(getattr(visual, "material", None))
    return image is not None and image.format is None


def _with_vertex_colors(geometry: Any, looks: Mapping[str, Look]) -> Any:
    """The look of an OBJ: the colours of its vertices, if any, where its material is drawn without an image."""
    material = getattr(geometry.visual, "material", None)
    bare = material is not None and image_of(material) is None and looks[material.name].cutoff == 0
    if bare and geometry.vertex_attributes.get("color") is not None:
        geometry.visual = _own_colors(geometry)
    return geometry.visual


def _own_colors(geometry: Any) -> Any:
    """The look of an OBJ as it were without texture coordinates."""
    from trimesh.visual import create_visual

    return create_visual(mesh=geometry, vertex_colors=geometry.vertex_attributes.get("color"))


def _part(
    path: Path, looks: Mapping[str, Look], textures: Textures, node: str, transform: Array, geometry: Any
) -> Mesh:
    """One geometry in the world; one of the posed figure is labelled."""
    vertices = torch.from_numpy(np.asarray(geometry.vertices, np.float64))
    if vertices.shape[1:] != (3,):
        reason = f"expected three numbers of each, got {vertices[:1].numel()}"
        raise InputError(path, "vertices", reason, "x, y and z; POSITION of a glTF is a VEC3")
    faces = np.asarray(geometry.faces).reshape(-1, 3)  # of no faces at all trimesh knows no corners
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise InputError(path, "faces", f"name vertex {faces.max()} of {len(vertices)}")
    mesh = Mesh.plain(vertices, torch.from_numpy(faces.astype(np.int32)))
    mesh = painted(path, looks, textures, mesh, geometry.visual)
    return replace(mesh.moved(torch.tensor(transform)), label=torch.full((len(mesh),), float(POSED in node)))


def _finite(path: Path, mesh: Mesh) -> Mesh:
    """Without the faces of vertices that are not finite, which is told; too many of those refuse the file."""
    good = torch.isfinite(mesh.vertices).all(1)
    if bool(good.all()):
        return mesh
    lost = 1 - float(good.double().mean())
    if lost > LOST:
        raise InputError(path, "vertices", f"{lost:.0%} are not finite")
    keep = good[mesh.faces.long()].all(1)
    _log.warning("%s: %d of %d vertices are not finite: %d faces of theirs are left out",
                 path, int((~good).sum()), len(good), int((~keep).sum()))  # fmt: skip
    vertices = mesh.vertices.nan_to_num(0.0, 0.0, 0.0)
    return replace(mesh.of_faces(keep), vertices=vertices)
