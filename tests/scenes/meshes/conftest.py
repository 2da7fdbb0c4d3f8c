"""Small glTF files that tests write: a bar of two joints whose second one turns and bends the bar."""

from __future__ import annotations

import base64
import io
import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

HALF = math.sqrt(0.5)


Made = tuple[dict[str, Any], bytes]
DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "mesh"


@pytest.fixture
def bar() -> Callable[..., Made]:
    return make_bar


@pytest.fixture
def builder() -> type[Builder]:
    return Builder


@pytest.fixture
def write_glb() -> Callable[..., Path]:
    return to_glb


@pytest.fixture
def write_gltf() -> Callable[..., Path]:
    return to_gltf


@pytest.fixture
def image_file() -> Callable[..., bytes]:
    return to_image


@pytest.fixture
def with_texture() -> Callable[..., Made]:
    return textured


@pytest.fixture
def data() -> Path:
    """Folder of real meshes."""
    if not DATA.is_dir():
        pytest.skip("needs the meshes of shared/data")
    return DATA


class Builder:
    """Collects arrays into one buffer and returns their accessors' indices."""

    def __init__(self) -> None:
        self.blob, self.views, self.accessors = b"", [], []

    def add(self, values: Any, dtype: str = "<f4", kind: str = "VEC3") -> int:
        data = np.asarray(values, dtype)
        component = {"<f4": 5126, "<u2": 5123, "<u4": 5125, "u1": 5121}[dtype]
        self.views.append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": data.nbytes})
        self.accessors.append(
            {"bufferView": len(self.views) - 1, "componentType": component, "count": len(data), "type": kind}
        )
        self.blob += data.tobytes() + b"\0" * (-data.nbytes % 4)
        return len(self.accessors) - 1


def make_bar(interpolation: str = "LINEAR") -> Made:
    """JSON and buffer: a strip from y = 0 to 2, its upper half moved by a joint at y = 1.

    Over two seconds that joint turns by 180 degrees about z and the strip's parent node lifts it by 10 along x.
    """
    b = Builder()
    positions = b.add([[-0.1, 0, 0], [0.1, 0, 0], [-0.1, 2, 0], [0.1, 2, 0]])
    joints = b.add([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]], "<u2", "VEC4")
    weights = b.add([[1, 0, 0, 0]] * 4, kind="VEC4")
    faces = b.add([[0], [1], [2], [1], [3], [2]], "<u2", "SCALAR")
    inverse = np.stack([np.eye(4), np.eye(4)])
    inverse[1, 1, 3] = -1
    binds = b.add(inverse.transpose(0, 2, 1).reshape(2, 16), kind="MAT4")
    times = b.add([[0.0], [1.0], [2.0]], kind="SCALAR")
    turns = b.add([[0, 0, 0, 1], [0, 0, HALF, HALF], [0, 0, 1, 0]], kind="VEC4")
    attributes = {"POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights}
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "root", "children": [1, 3], "translation": [10, 0, 0]},
            {"name": "low", "children": [2]},
            {"name": "high", "translation": [0, 1, 0]},
            {"name": "strip", "mesh": 0, "skin": 0, "translation": [7, 7, 7]},
        ],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": faces}]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": binds}],
        "animations": [
            {
                "name": "bend",
                "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}],
                "samplers": [{"input": times, "output": turns, "interpolation": interpolation}],
            },
            {"name": "rest", "channels": [], "samplers": []},
        ],
        "bufferViews": b.views,
        "accessors": b.accessors,
        "buffers": [{"byteLength": len(b.blob)}],
    }
    return tree, b.blob


def to_glb(path: Path, tree: dict[str, Any], blob: bytes) -> Path:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    return path


def to_gltf(path: Path, tree: dict[str, Any], blob: bytes, uri: str | None = None) -> Path:
    """As JSON; the buffer is in it, or the file ``uri``."""
    inline = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    path.write_text(json.dumps({**tree, "buffers": [{"byteLength": len(blob), "uri": uri or inline}]}))
    return path


def to_image(pixels: np.ndarray, kind: str = "PNG") -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, kind)
    return stream.getvalue()


def textured(made: Made, picture: bytes, **material: Any) -> Made:
    """The bar with texture coordinates of 0 and one material, which shows the image file ``picture``."""
    tree, blob = made
    attributes = tree["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_0"] = len(tree["accessors"])
    views, first = len(tree["bufferViews"]), len(blob)
    tree["accessors"].append({"bufferView": views, "componentType": 5126, "count": 4, "type": "VEC2"})
    tree["bufferViews"].append({"buffer": 0, "byteOffset": first, "byteLength": 32})
    tree["bufferViews"].append({"buffer": 0, "byteOffset": first + 32, "byteLength": len(picture)})
    tree["images"] = [{"bufferView": views + 1, "mimeType": "image/png"}]
    tree["textures"] = [{"source": 0}]
    tree["materials"] = [material or {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    tree["meshes"][0]["primitives"][0]["material"] = 0
    blob += np.zeros((4, 2), "<f4").tobytes() + picture
    tree["buffers"][0]["byteLength"] = len(blob)
    return tree, blob
