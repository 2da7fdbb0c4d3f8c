from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from cltransfer.scenes.meshes.gltf_figure import Skeleton
from cltransfer.scenes.meshes.moment import Moment
from cltransfer.scenes.meshes.read_mesh import read_mesh
from cltransfer.scenes.meshes.rig import subject_of_rig
from cltransfer.skeleton import JOINTS

UP = np.array([0.0, 0.0, 1.0])
PLACES = {  # a standing body that faces +y; its left is at -x
    "hips": (0, 1.0), "spine": (0, 1.2), "neck": (0, 1.5), "head": (0, 1.6),
    "collar": (-0.05, 1.45), "shoulder": (-0.2, 1.45), "elbow": (-0.4, 1.2), "wrist": (-0.5, 1.0), "hand": (-0.5, 0.9),
    "hip": (-0.1, 0.95), "knee": (-0.1, 0.5), "ankle": (-0.1, 0.1), "toe": (-0.1, 0.0),
}  # fmt: skip
PARENT = {"spine": "hips", "neck": "spine", "head": "neck", "collar": "spine", "shoulder": "spine",
          "elbow": "shoulder", "wrist": "elbow", "hand": "wrist", "hip": "hips",
          "knee": "hip", "ankle": "knee", "toe": "ankle"}  # fmt: skip
SPARE = ("collar", "hand")  # not every rig has them
STYLES = {
    "mixamo": {"collar": "mixamorig:{Left}Shoulder", "shoulder": "mixamorig:{Left}Arm",
               "elbow": "mixamorig:{Left}ForeArm", "wrist": "mixamorig:{Left}Hand",
               "hip": "mixamorig:{Left}UpLeg", "knee": "mixamorig:{Left}Leg", "ankle": "mixamorig:{Left}Foot",
               "toe": "mixamorig:{Left}ToeBase"},
    "rigify": {"shoulder": "DEF-upper_arm.{L}", "elbow": "DEF-forearm.{L}", "wrist": "DEF-hand.{L}",
               "hip": "DEF-thigh.{L}", "knee": "DEF-shin.{L}", "ankle": "DEF-foot.{L}", "toe": "DEF-toe.{L}"},
    "unreal": {"collar": "clavicle_{l}", "shoulder": "upperarm_{l}", "elbow": "lowerarm_{l}", "wrist": "hand_{l}",
               "hip": "thigh_{l}", "knee": "calf_{l}", "ankle": "foot_{l}", "toe": "ball_{l}"},
    "numbered": {"shoulder": "arm_joint_{L}_1", "elbow": "arm_joint_{L}_2", "wrist": "arm_joint_{L}_3",
                 "hip": "leg_joint_{L}_1", "knee": "leg_joint_{L}_2", "ankle": "leg_joint_{L}_3",
                 "toe": "leg_joint_{L}_5"},
    "makehuman": {"collar": "clavicle.{L}", "shoulder": "upperarm01.{L}", "elbow": "lowerarm01.{L}",
                  "wrist": "wrist.{L}", "hand": "metacarpal1.{L}", "hip": "upperleg01.{L}", "knee": "lowerleg01.{L}",
                  "ankle": "foot.{L}", "toe": "toe1-1.{L}"},
    "biped": {"collar": "Bip01 {L} Clavicle", "shoulder": "Bip01 {L} UpperArm", "elbow": "Bip01 {L} Forearm",
              "wrist": "Bip01 {L} Hand", "hand": "Bip01 {L} Finger0", "hip": "Bip01 {L} Thigh",
              "knee": "Bip01 {L} Calf", "ankle": "Bip01 {L} Foot", "toe": "Bip01 {L} Toe0"},
    "smpl": {"collar": "m_avg_{L}_Collar", "shoulder": "m_avg_{L}_Shoulder", "elbow": "m_avg_{L}_Elbow",
             "wrist": "m_avg_{L}_Wrist", "hand": "m_avg_{L}_Hand", "hip": "m_avg_{L}_Hip", "knee": "m_avg_{L}_Knee",
             "ankle": "m_avg_{L}_Ankle", "toe": "m_avg_{L}_Foot"},
    "smplx": {"collar": "{left}_collar", "shoulder": "{left}_shoulder", "elbow": "{left}_elbow",
              "wrist": "{left}_wrist", "hand": "{left}_middle1", "hip": "{left}_hip", "knee": "{left}_knee",
              "ankle": "{left}_ankle", "toe": "{left}_foot"},
    "genesis 2": {"collar": "{l}Collar", "shoulder": "{l}Shldr", "elbow": "{l}ForeArm", "wrist": "{l}Hand",
                  "hip": "{l}Thigh", "knee": "{l}Shin", "ankle": "{l}Foot", "toe": "{l}Toe"},
    "genesis 8": {"collar": "{l}Collar", "shoulder": "{l}ShldrBend", "elbow": "{l}ForearmBend", "wrist": "{l}Hand",
                  "hand": "{l}Carpal1", "hip": "{l}ThighBend", "knee": "{l}Shin", "ankle": "{l}Foot",
                  "toe": "{l}Metatarsals"},
    "genesis 9": {"collar": "{l}_shoulder", "shoulder": "{l}_upperarm", "elbow": "{l}_forearm", "wrist": "{l}_hand",
                  "hip": "{l}_thigh", "knee": "{l}_shin", "ankle": "{l}_foot", "toe": "{l}_metatarsal"},
}  # fmt: skip
SIDES = {
    "left": {"Left": "Left", "left": "left", "L": "L", "l": "l"},
    "right": {"Left": "Right", "left": "right", "L": "R", "l": "r"},
}


def body(style: dict[str, str]) -> Skeleton:
    names, parents, points = [], [], []
    at: dict[tuple[str, str], int] = {}
    for part, (x, z) in ((part, at) for part, at in PLACES.items() if part in style or part not in SPARE):
        for side in ("left", "right") if part in style else ("",):
            above = PARENT.get(part)
            parents.append(-1 if above is None else at.get((above, side), at.get((above, ""), -1)))
            at[part, side] = len(names)
            names.append(style[part].format(**SIDES[side]) if side else part)
            points.append([-x if side == "right" else x, 0.0, z])
    crown = np.array([[0.0, 0.1, 1.8], [0.0, -0.1, 1.75], [0.0, 0.0, 0.0]])
    head = names.index("head")
    return Skeleton(tuple(names), tuple(parents), np.array(points), crown, np.array([head, head, 0]))


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_joints_are_found_by_the_names_of_many_programs(style):
    subject = subject_of_rig(body(style), UP)
    for i, name in enumerate(JOINTS[:12]):
        side, part = name.split("_")
        x, z = PLACES[part]
        assert subject.joints[i].tolist() == [x if side == "left" else -x, 0, z]
    assert subject.joints[JOINTS.index("head_top")].tolist() == pytest.approx([0, 0, 1.8])
    assert subject.joints[JOINTS.index("neck")].tolist() == [0, 0, 1.5]
    assert subject.confidence.tolist() == [1.0] * 14
    torch.testing.assert_close(subject.facing, torch.tensor([0.0, 1.0, 0.0]).double())
    torch.testing.assert_close(subject.left, torch.tensor([-1.0, 0.0, 0.0]).double())
    assert subject.height == pytest.approx(1.8, rel=0.05)


def test_in_a_mirror_the_left_arm_is_the_right_one():
    rig, mirror = body(STYLES["rigify"]), np.array([-1.0, 1.0, 1.0])
    seen = replace(rig, points=rig.points * mirror, vertices=rig.vertices * mirror, mirrored=True)
    straight, mirrored = subject_of_rig(rig, UP), subject_of_rig(seen, UP)
    torch.testing.assert_close(mirrored.facing, straight.facing)
    torch.testing.assert_close(mirrored.joints, straight.joints)


def test_a_chain_of_many_joints_takes_no_more_than_as_many_short_ones(within):
    rig, more = body(STYLES["unreal"]), 4000
    first, neck = len(rig.names), rig.names.index("neck")
    names = (*(name.replace("head", "skull") for name in rig.names), *["bone"] * more)
    parents = (*rig.parents[: neck + 1], -1, *rig.parents[neck + 2 :], neck, *range(first, first + more - 1))
    points = np.concatenate([rig.points, np.linspace([0, 0, 1.5], [0, 0, 1.6], more)])
    strongest = np.array([first + more - 1, first + more - 1, 0])
    start = time.process_time()
    subject = subject_of_rig(replace(rig, names=names, parents=parents, points=points, strongest=strongest), UP)
    assert within(time.process_time() - start, 4.0)
    assert subject.joints[JOINTS.index("head_top")].tolist() == pytest.approx([0, 0, 1.8])


def test_of_many_joints_each_name_is_looked_at_once(within):
    rig, more = body(STYLES["unreal"]), 30_000
    names = (*rig.names, *(f"ribbon_{i}_l" for i in range(more)))
    many = replace(
        rig, names=names, parents=(*rig.parents, *[0] * more), points=np.concatenate([rig.points, np.ones((more, 3))])
    )
    start = time.process_time()
    subject = subject_of_rig(many, UP)
    assert within(time.process_time() - start, 1.5)
    torch.testing.assert_close(subject.joints, subject_of_rig(rig, UP).joints)


def test_what_helps_to_pose_a_hand_is_no_hand():
    rig = body(STYLES["unreal"])
    helpers = ("ik_hand_gun", "ik_hand_l", "ik_hand_r", "ik_foot_l", "ik_foot_r", "pole_target_hand_l", "ctrl_hand_r")
    crowded = replace(
        rig,
        names=(*rig.names, *helpers),
        parents=(*rig.parents, *[-1] * len(helpers)),
        points=np.concatenate([rig.points, np.full((len(helpers), 3), 7.0)]),
    )
    torch.testing.assert_close(subject_of_rig(crowded, UP).joints, subject_of_rig(rig, UP).joints)


def test_a_rig_of_controls_alone_is_a_person():
    rig = body(STYLES["unreal"])
    controls = replace(rig, names=tuple(f"ctrl_{name}" for name in rig.names))
    torch.testing.assert_close(subject_of_rig(controls, UP).joints, subject_of_rig(rig, UP).joints)


def test_a_bent_pose_keeps_its_height():
    rig = body(STYLES["mixamo"])
    bent = rig.points.copy()
    bent[:, 2] *= 0.5
    bent[:, 1] += np.sqrt(0.75) * rig.points[:, 2]  # every bone keeps about its length
    lying = Skeleton(rig.names, rig.parents, bent, rig.vertices * 0.5, rig.strongest)
    assert subject_of_rig(lying, UP).height > 1.6


@pytest.mark.parametrize("nowhere", [[np.nan] * 3, [0, np.nan, 0], [0, np.inf, 0], [1e308, 1e308, -1e308]])
@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")
def test_a_rig_with_a_joint_that_is_nowhere_faces_a_way_or_is_no_person(nowhere):
    rig = body(STYLES["mixamo"])
    for joint in ("LeftArm", "LeftUpLeg"):
        at = rig.names.index(f"mixamorig:{joint}")
        points = np.where(np.arange(len(rig.points))[:, None] == at, nowhere, rig.points)
        assert subject_of_rig(replace(rig, points=points), UP) is None


@pytest.mark.parametrize("nowhere", [[np.nan] * 3, [0, np.nan, 0], [0, np.inf, 0]])
def test_a_joint_that_is_nowhere_is_not_known(nowhere):
    rig = body(STYLES["mixamo"])
    at, hand = rig.names.index("mixamorig:LeftHand"), JOINTS.index("left_wrist")
    points = np.where(np.arange(len(rig.points))[:, None] == at, nowhere, rig.points)
    vertices, strongest = np.append(rig.vertices, [nowhere], axis=0), np.append(rig.strongest, rig.names.index("head"))
    person = subject_of_rig(replace(rig, points=points, vertices=vertices, strongest=strongest), UP)
    whole = subject_of_rig(rig, UP)
    expected = whole.joints.index_fill(0, torch.tensor(hand), torch.nan)
    torch.testing.assert_close(person.joints, expected, equal_nan=True)
    assert person.confidence.tolist() == [float(i != hand) for i in range(14)]
    assert person.height == whole.height


def test_without_a_collar_a_shoulder_may_be_one_and_is_no_limb():
    style = {part: name for part, name in STYLES["smpl"].items() if part != "collar"}
    assert subject_of_rig(body(style), UP) is None


def test_a_hand_that_hangs_from_no_wrist_is_where_the_arm_ends():
    rig = body(STYLES["smpl"])
    loose = replace(rig, parents=tuple(-1 if "Hand" in name else up for name, up in zip(rig.names, rig.parents)))
    hand, wrist = rig.names.index("m_avg_L_Hand"), JOINTS.index("left_wrist")
    assert subject_of_rig(loose, UP).joints[wrist].tolist() == rig.points[hand].tolist()


def test_names_that_tell_nothing_give_no_person():
    rig = body(STYLES["numbered"])
    dumb = Skeleton(
        tuple(f"Bone{i}" for i in range(len(rig.names))), rig.parents, rig.points, rig.vertices, rig.strongest
    )
    assert subject_of_rig(dumb, UP) is None


@pytest.mark.parametrize("more", [0, 30])
def test_a_posed_skin_whose_joints_name_no_person_is_told_in_one_line(bar, write_glb, tmp_path, caplog, more):
    tree, blob = bar()
    first = len(tree["nodes"])
    tree["nodes"] += [{"name": f"Bone{i}" * 9} for i in range(more)]
    tree["skins"] = [{"joints": [1, 2, *range(first, first + more)]}]
    path = write_glb(tmp_path / "bar.glb", tree, blob)
    read_mesh(path)
    joints = f"'low', 'high', '{'Bone0' * 8}' and 29 more" if more else "'low', 'high'"
    told = f"its joints, {joints}, name no person; whether networks find one in it is shown by: cltransfer lift"
    assert caplog.messages == [f"{path}: {told}"]
    caplog.clear()
    read_mesh(path, person=False)
    del tree["nodes"][3]["skin"], tree["skins"]
    read_mesh(write_glb(path, tree, blob))
    assert caplog.messages == []


def test_a_skin_whose_joints_name_a_person_is_read_without_a_word(bar, write_glb, tmp_path, caplog):
    tree, blob = bar()
    rig, first = body(STYLES["smpl"]), len(tree["nodes"])
    tree["nodes"] += [{"name": name, "translation": at} for name, at in zip(rig.names, rig.points.tolist())]
    tree["skins"] = [{"joints": [*range(first, first + len(rig.names))]}]
    found = read_mesh(write_glb(tmp_path / "bar.glb", tree, blob), up=(0.0, 0.0, 1.0))
    assert found.subject.confidence[:12].tolist() == [1] * 12
    assert found.mesh.label.tolist() == [1, 1]
    assert caplog.messages == []


@pytest.mark.parametrize(("file", "animation"), [("cesium_man.glb", None), ("pc_lumberjack.glb", "A-pose")])
def test_real_rigs_give_a_person_who_stands_in_the_mesh(data, file, animation):
    found = read_mesh(data / file, Moment(0.0, animation))
    person, vertices = found.subject, found.mesh.vertices.double()
    low, high = vertices.amin(0), vertices.amax(0)
    assert bool(torch.isfinite(person.joints).all())
    assert bool(((person.joints > low - 0.02) & (person.joints < high + 0.02)).all())
    heights = dict(zip(JOINTS, person.joints[:, 1].tolist()))
    for side in ("left", "right"):
        chain = [
            heights[name] for name in ("head_top", f"{side}_shoulder", f"{side}_hip", f"{side}_knee", f"{side}_ankle")
        ]
        assert chain == sorted(chain, reverse=True)
    assert float(person.facing[2]) > 0.95  # both were modelled facing +z
    assert person.height == pytest.approx(float(high[1] - low[1]), rel=0.03)
    assert bool((found.mesh.label == 1).all())
