"""A man of fifteen joints whose body and whose head are meshes of their own, as programs export them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from cltransfer.scenes.meshes.asset_files import Beside
from cltransfer.scenes.meshes.gltf_file import read_gltf
from cltransfer.scenes.meshes.gltf_skin import posed
from cltransfer.scenes.meshes.read_mesh import read_mesh
from cltransfer.skeleton import JOINTS

MAN = {  # the joint above each, and where it is; he faces +z, so that his left is at +x
    "hips": ("", (0, 1, 0)), "neck": ("hips", (0, 1.5, 0)), "head": ("neck", (0, 1.58, 0)),
    **{f"{side}{part}": (above if above == "hips" else side + above, (sign * x, y, 0))
       for side, sign in (("Left", 1), ("Right", -1))
       for part, above, x, y in (("Arm", "hips", 0.2, 1.45), ("ForeArm", "Arm", 0.4, 1.2), ("Hand", "ForeArm", 0.5, 1),
                                 ("UpLeg", "hips", 0.1, 0.95), ("Leg", "UpLeg", 0.1, 0.5), ("Foot", "Leg", 0.1, 0.1))},
}  # fmt: skip
NAMES = list(MAN)
BODY = {"hips": [(0, 1, 0.1)], "LeftFoot": [(0.1, 0, 0)], "RightFoot": [(-0.1, 0, 0)]}  # vertices by their joint
HEAD = {"head": [(0.1, 1.6, 0), (0, 1.85, 0), (-0.1, 1.6, 0)]}
Meshes = list[tuple[dict[str, list[tuple[float, float, float]]], int]]  # and the skin of each


@pytest.fixture
def man(builder: Any, write_glb: Callable[..., Path], tmp_path: Path) -> Callable[..., Path]:
    def write(meshes: Meshes, skins: list[list[str]], held: Sequence[str] = ()) -> Path:
        """``held`` names joints, or none, from which a node hangs with one of two triangles."""
        b = builder()
        tree: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "meshes": [], "skins": []}
        tree["nodes"] = [{"name": name, "translation": list(offset(name))} for name in NAMES]
        for i, name in enumerate(NAMES):
            if below := [k for k, other in enumerate(NAMES) if MAN[other][0] == name]:
                tree["nodes"][i]["children"] = below
        for names in skins:
            binds = [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *(-part for part in MAN[name][1]), 1] for name in names]
            joints = [NAMES.index(name) for name in names]
            tree["skins"].append({"joints": joints, "inverseBindMatrices": b.add(binds, kind="MAT4")})
        for mesh, skin in meshes:
            moved = [skins[skin].index(name) for name, points in mesh.items() for _ in points]
            attributes = {
                "POSITION": b.add([point for points in mesh.values() for point in points]),
                "JOINTS_0": b.add([[joint, 0, 0, 0] for joint in moved], "<u2", "VEC4"),
                "WEIGHTS_0": b.add([[1, 0, 0, 0]] * len(moved), kind="VEC4"),
            }
            tree["nodes"].append({"mesh": len(tree["meshes"]), "skin": skin})
            tree["meshes"].append({"primitives": [{"attributes": attributes}]})
        tree["scenes"] = [{"nodes": [0, *range(len(NAMES), len(tree["nodes"]))]}]
        for name in held:
            first = len(tree["nodes"])
            tree["nodes"] += [{"children": [first + 1]}, {"name": "thing", "mesh": len(tree["meshes"])}]
            triangle = {"attributes": {"POSITION": b.add([(0, 0.4, 0), (0.1, 0.4, 0), (0, 0.5, 0)])}}
            tree["meshes"].append({"primitives": [triangle, triangle]})
            beside = tree["nodes"][NAMES.index(name)].setdefault("children", []) if name else tree["scenes"][0]["nodes"]
            beside.append(first)
        tree.update(bufferViews=b.views, accessors=b.accessors, buffers=[{"byteLength": len(b.blob)}])
        return write_glb(tmp_path / "man.glb", tree, b.blob)

    return write


def offset(name: str) -> tuple[float, float, float]:
    above, (x, y, z) = MAN[name]
    u, v, w = MAN[above][1] if above else (0, 0, 0)
    return x - u, y - v, z - w


def test_a_figure_of_several_skins_is_read_as_one_of_a_single_skin(man: Callable[..., Path]) -> None:
    both, lone, back = list(NAMES), ["neck", "head"], NAMES[::-1]
    one = read_mesh(man([(BODY, 0), (HEAD, 0)], [both]))
    assert one.subject is not None
    assert one.subject.joints[JOINTS.index("head_top"), 1] == pytest.approx(1.85)
    for meshes, skins in (
        ([(BODY, 0), (HEAD, 1)], [both, both]),
        ([(HEAD, 0), (BODY, 1)], [both, both]),
        ([(HEAD, 0), (BODY, 1)], [lone, both]),
        ([(BODY, 0), (HEAD, 1)], [back, lone]),
    ):
        found = read_mesh(man(meshes, skins))
        assert found.subject is not None
        assert found.subject.joints.tolist() == one.subject.joints.tolist()
        assert found.subject.height == one.subject.height
        assert found.mesh.label.tolist() == [1, 1]


def test_joints_of_a_figure_are_in_one_order_whichever_mesh_comes_first(man: Callable[..., Path]) -> None:
    for meshes, skins in (([(HEAD, 0), (BODY, 1)], [["head"], NAMES]), ([(BODY, 0), (HEAD, 1)], [NAMES, ["head"]])):
        path = man(meshes, skins)
        _, rig = posed(read_gltf(path, Beside(path)), 0.0)
        assert rig is not None
        assert rig.names == tuple(NAMES)
        assert [rig.names[parent] if parent >= 0 else "" for parent in rig.parents] == [MAN[name][0] for name in NAMES]
        assert [rig.names[joint] for joint in rig.strongest] == ["hips", "LeftFoot", "RightFoot", *["head"] * 3]


def test_skins_that_hang_together_by_another_are_one_figure(man: Callable[..., Path]) -> None:
    glove, sock = {"LeftHand": [(0.5, 1, 0)] * 3}, {"RightFoot": [(-0.1, 0.1, 0)] * 3}
    skins = [["LeftHand"], ["RightFoot"], ["RightFoot", "LeftHand"]]
    path = man([(glove, 0), (sock, 1), ({**sock, **glove}, 2)], skins)
    _, rig = posed(read_gltf(path, Beside(path)), 0.0)
    assert rig is not None
    assert rig.names == ("RightFoot", "LeftHand")
    assert len(rig.vertices) == 12


def test_what_hangs_from_a_joint_is_of_the_person_and_what_stands_beside_is_not(man: Callable[..., Path]) -> None:
    held = ["head", "", "LeftHand"]
    found = read_mesh(man([(BODY, 0), (HEAD, 0)], [NAMES], held))
    assert found.subject is not None
    assert found.subject.joints[JOINTS.index("head_top"), 1] == pytest.approx(1.85)  # a hat is no head
    labels = dict(zip(map(tuple, found.mesh.means.mul(100).round().int().tolist()), found.mesh.label.tolist()))
    assert labels[3, 201, 0] == 1  # above the head
    assert labels[53, 143, 0] == 1  # in the hand
    assert labels[3, 43, 0] == 0
    assert sorted(found.mesh.label.tolist()) == [0, 0, *[1] * 6]


def test_what_no_person_holds_is_of_nobody(man: Callable[..., Path]) -> None:
    found = read_mesh(man([(HEAD, 0)], [["head"]], ["head"]))
    assert found.subject is None
    assert found.mesh.label.tolist() == [0, 0, 0]
