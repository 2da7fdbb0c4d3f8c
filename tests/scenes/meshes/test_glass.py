"""What light goes through is drawn as what is transparent: whole, or not at all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cltransfer.errors import InputError
from cltransfer.scenes.meshes.glass import GLASS
from cltransfer.scenes.meshes.read_mesh import read_mesh


def glazed(made: Any, opacity: float = 1.0, mode: str | None = None, **glass: Any) -> Any:
    """The bar, and once more of a material called pane that lets light through."""
    tree, blob = made
    (solid,) = tree["meshes"][0]["primitives"]
    tree["meshes"][0]["primitives"] = [solid, {**solid, "material": 0}]
    pane = {"name": "pane", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, opacity]}}
    tree["materials"] = [{**pane, "extensions": {GLASS: glass}, **({} if mode is None else {"alphaMode": mode})}]
    tree["extensionsUsed"] = [GLASS]
    return tree, blob


@pytest.mark.parametrize(
    ("mode", "opacity", "share", "drawn"),
    [
        (None, 1.0, 1.0, 0), (None, 1.0, 0.6, 0), (None, 0.1, 0.5, 2), (None, 1.0, 0.0, 2), ("OPAQUE", 1.0, 1, 0),
        ("MASK", 1.0, 1.0, 0), ("BLEND", 1.0, 0.4, 2), ("BLEND", 0.7, 0.4, 0), ("BLEND", 0.7, 0.2, 2),
    ],
)  # fmt: skip
def test_glass_that_most_light_goes_through_is_not_drawn(
    bar: Any, write_glb: Any, tmp_path: Any, mode: str | None, opacity: float, share: float, drawn: int
) -> None:
    tree, blob = glazed(bar(), opacity, mode, transmissionFactor=share)
    assert len(read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh) == 2 + drawn


def test_glass_with_a_texture_is_not_drawn_either(
    bar: Any, with_texture: Any, image_file: Any, write_glb: Any, tmp_path: Any
) -> None:
    tree, blob = with_texture(bar(), image_file(np.full((2, 2, 3), 200, np.uint8)))
    (pane,) = tree["meshes"][0]["primitives"]
    tree["meshes"][0]["primitives"] = [{**pane, "material": 1}, pane]
    tree["materials"].append({})
    tree["materials"][0]["extensions"] = {GLASS: {"transmissionFactor": 1}}
    mesh = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh
    assert mesh.texture.tolist() == [-1, -1]


def test_a_file_that_needs_its_glass_is_read(bar: Any, write_glb: Any, tmp_path: Any) -> None:
    tree, blob = glazed(bar(), transmissionFactor=1.0)
    tree["extensionsRequired"] = [GLASS]
    assert len(read_mesh(write_glb(tmp_path / "bar.glb", tree, blob)).mesh) == 2


def test_an_image_of_where_light_goes_through_is_told_and_all_is_drawn(
    bar: Any, write_glb: Any, tmp_path: Any, caplog: pytest.LogCaptureFixture
) -> None:
    tree, blob = glazed(bar(), transmissionFactor=1.0, transmissionTexture={"index": 0})
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    assert len(read_mesh(path, person=False).mesh) == 4
    told = "an image of where it lets light through is not read, all of it is drawn"
    assert caplog.messages == [f"{path}: material 'pane': {told}"]
    caplog.clear()
    tree["meshes"][0]["primitives"].pop()
    read_mesh(write_glb(path, tree, blob), person=False)
    assert caplog.messages == []


@pytest.mark.parametrize("share", [-0.1, 1.5, "1", float("nan")])
def test_what_is_no_share_of_the_light_is_refused(bar: Any, write_glb: Any, tmp_path: Any, share: Any) -> None:
    tree, blob = glazed(bar(), transmissionFactor=share)
    with pytest.raises(InputError, match=r"bar.glb: materials: expected a transmissionFactor in \[0, 1\], got"):
        read_mesh(write_glb(tmp_path / "bar.glb", tree, blob))
