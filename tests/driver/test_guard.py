"""Views that may not be taken: from inside, of nothing, of a hidden person; and nothing else."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera, concatenate
from cltransfer.config import load_config
from cltransfer.driver import guard
from cltransfer.driver.follow import follow
from cltransfer.driver.guard import READ, Guard, hidden_share
from cltransfer.driver.schedule import make_schedule
from cltransfer.driver.stage import Stage, read_path
from cltransfer.driver.whole_clip import WholeClip
from cltransfer.features import Features
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.plan import Step
from cltransfer.progress import silent
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.run.inputs import Inputs
from cltransfer.run.preparation import Clock, prepare
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.splats import Splats
from cltransfer.search.subject_orbit import SubjectOrbit
from cltransfer.shots import SHOTS, Setup, shot
from cltransfer.skeleton import JOINTS
from cltransfer.testing import sample_subject

H, W = 9, 16


def view(depth: float = 3.0, seen: float = 1.0, person: bool = True) -> Features:
    """One view whose left part, ``seen`` of it, lies at ``depth``; the joints' box fills the middle."""
    at = torch.full((1, H, W), math.nan)
    at[:, :, : round(seen * W)] = depth
    subject = torch.zeros(1, H, W, dtype=torch.bool)
    subject[:, 2:7, 6:10] = person
    keypoints = torch.full((1, 14, 3), 1.0, dtype=torch.float64)
    keypoints[..., 0] = torch.linspace(5, 11, 14)
    keypoints[..., 1] = torch.linspace(1, 8, 14)
    return Features((W, H), depth=at, subject=subject, keypoints=keypoints)


def out_of_frame(features: Features) -> Features:
    """The same with the joints to the right of the frame."""
    keypoints = features.require("keypoints").clone()
    keypoints[..., 0] += 10 * W
    return replace(features, keypoints=keypoints)


@pytest.mark.parametrize(
    ("features", "reason"),
    [
        (out_of_frame(view(seen=0.0, person=False)), "the view is almost empty"),
        (view(depth=0.1), "the camera stands inside something"),
        (view(person=False), "the person is hidden"),
    ],
)
def test_a_view_is_refused_for_one_reason(features: Features, reason: str) -> None:
    reasons = Guard(1.8).reasons(features)
    assert [name for name, wrong in reasons.items() if bool(wrong[0])] == [reason]


def test_a_person_may_fill_the_frame_from_nearer_than_a_thing() -> None:
    near = view(depth=0.4)  # 0.22 of the height
    assert near.subject is not None
    assert bool(Guard(1.8).blocked(near))
    near.subject[:] = True
    assert not bool(Guard(1.8).blocked(near))
    assert not bool(Guard(1.8).blocked(replace(view(depth=0.4), subject=None)))  # nobody tells: it may be the person


def test_a_mask_of_fewer_pixels_than_the_view_tells_the_same() -> None:
    near = view(depth=0.4)
    assert near.subject is not None
    near.subject[:, :, : W // 2] = True
    few = replace(near, subject=near.subject[:, ::3, ::2])
    for guarded in (near, few):
        assert [bool(wrong) for wrong in Guard(1.8).reasons(guarded).values()] == [False, True, False]
    assert not bool(Guard(1.8).blocked(replace(few, subject=torch.ones_like(few.subject))))


@pytest.mark.parametrize(("before", "blocked"), [(0.3, True), (0.5, False)])
def test_a_thing_may_come_nearer_where_one_fills_the_reference(before: float, blocked: bool) -> None:
    layers = torch.zeros(1, 3, H, W, dtype=torch.bool)
    layers[:, 0, :, : round(before * W)] = True
    reference = replace(view(), layers=layers)
    assert bool(Guard(1.8).blocked(view(depth=0.4), reference)) == blocked
    assert bool(Guard(1.8).blocked(view(depth=0.2), reference))


@pytest.mark.parametrize("shown", [True, False])
def test_a_thing_may_come_nearer_where_the_reference_shows_nobody(shown: bool) -> None:
    reference = view(person=shown)
    assert bool(Guard(1.8).blocked(view(depth=0.4), reference)) == shown
    assert bool(Guard(1.8).blocked(view(depth=0.2), reference))


@pytest.mark.parametrize("shown", [True, False])
def test_a_person_whom_the_reference_hides_may_be_hidden(shown: bool) -> None:
    reference = view()
    assert reference.keypoints is not None
    reference.keypoints[..., 2] = float(shown)
    assert bool(Guard(1.8).blocked(view(person=False), reference)) == shown


@pytest.mark.parametrize("seen", [0.15, 0.03, 0.0])
def test_a_person_before_nothing_may_be_filmed_however_small(seen: float) -> None:
    assert not bool(Guard(1.8).blocked(view(seen=seen)))
    untold = replace(view(seen=seen), subject=None)  # where nobody tells, what is seen counts
    assert bool(Guard(1.8).blocked(untold)) == (seen < 0.05)


def test_a_person_out_of_the_frame_is_not_hidden() -> None:
    assert not bool(Guard(1.8).blocked(out_of_frame(view(person=False))))


def test_every_canonical_shot_may_be_taken() -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    cameras = concatenate([shot(name, scene.subject, (W * 6, H * 6), 3).camera for name in SHOTS])
    seen = GaussianSplats().render(scene, cameras, frozenset({"depth"}))
    assert not bool(Guard(scene.subject.height).blocked(seen).any())


def test_a_camera_in_the_chest_may_not() -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    anchor = scene.subject.anchor
    inside = Camera.look_at(anchor[None], anchor + scene.subject.facing, scene.subject.up, 0.7, (W * 6, H * 6))
    seen = GaussianSplats().render(scene, inside, frozenset({"depth"}))
    reasons = Guard(scene.subject.height).reasons(seen)
    assert bool(reasons["the camera stands inside the person"])


def test_a_camera_in_the_chest_may_not_though_two_joints_are_one() -> None:
    """A person written by hand, with the ankles where the knees are."""
    subject = builtin_scene("courtyard").subject
    assert subject is not None
    joints = subject.joints.clone()
    for side in ("left", "right"):
        joints[JOINTS.index(f"{side}_ankle")] = joints[JOINTS.index(f"{side}_knee")]
    chest = subject.key_joints[1, :3]
    inside = Camera.look_at(chest[None], chest[None] + subject.facing, subject.up, 0.7, (W, H))
    seen = Features((W, H), depth=torch.full((1, H, W), 9.0), camera=inside, person=replace(subject, joints=joints))
    assert bool(Guard(subject.height).reasons(seen)["the camera stands inside the person"])


def test_a_camera_in_a_lamp_may_not_though_the_near_plane_leaves_only_a_fog_of_it() -> None:
    scene = load_scene("builtin:path-4005")
    assert scene.subject is not None
    in_lamp = torch.tensor([[-0.520, 0.376, 0.002, 1.225, -0.102, 1.138, 0.661]], dtype=torch.float64)
    home = shot("static", scene.subject, (W * 6, H * 6), 1).camera
    camera = SubjectOrbit().cameras(in_lamp, home, scene.subject)
    drawn = GaussianSplats().render(scene, camera, frozenset({"depth", "label"}))
    seen = replace(drawn, subject=drawn.require("label") > 0.5)
    assert bool(Guard(scene.subject.height).reasons(seen)["the camera stands inside something"])


def test_what_a_network_takes_for_depth_is_not_what_stands_before_the_lens() -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    parts = Components.build(load_config())
    plan = replace(parts.plan("scene"), steps=(Step("nearness", Nearness()),), buffers=frozenset({"image"}))
    stage = Stage(scene, parts.renderer, plan, Objective(parts.losses), (96, 54), guard=Guard(scene.subject.height))
    seen = stage.features(shot("push_in", scene.subject, (96, 54), 2).camera, None)
    assert float(seen.require("depth").max()) == 0
    assert stage.guard is not None
    assert not bool(stage.guard.blocked(seen).any())


def test_a_path_of_blocked_views_pays_even_where_a_loss_has_no_residuals(mean_flow: tuple[str, ...]) -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    parts, size = Components.build(load_config(overrides=mean_flow[:1])), (96, 54)
    camera = shot("push_in", scene.subject, size, 3).camera
    stage = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), size)
    assert stage.objective.groups is None
    reference = read_path(stage, camera)
    search = SubjectOrbit()
    x = search.vector(camera, camera[0], scene.subject)
    free, blocked = (
        WholeClip(replace(stage, guard=guard), search, reference, camera[0]).total(x)
        for guard in (None, Thick(scene.subject.height))
    )
    assert free < 0.01
    assert blocked > 10


def test_a_blocked_view_has_no_term_and_pays_every_penalty() -> None:
    scene = builtin_scene("courtyard")
    assert scene.subject is not None
    parts, camera = Components.build(load_config()), shot("push_in", scene.subject, (96, 54), 2).camera
    free = Stage(scene, parts.renderer, parts.plan("scene"), Objective(parts.losses), (96, 54))
    reference = read_path(free, camera)[0]
    defined = free.objective.defined(reference)[0]
    assert bool(free.terms(reference, camera, None)[:, defined].isfinite().all())
    stage = replace(free, guard=Thick(scene.subject.height))
    assert bool(stage.terms(reference, camera, None).isnan().all())
    lost = stage.objective.lost_residuals(defined)
    assert float(lost.max()) > 1
    assert torch.equal(stage.residuals(reference, camera, None, defined), lost.expand(2, -1))
    assert bool((free.residuals(reference, camera, None, defined) < lost.max()).all())


def walled(scene: Scene, camera: Camera) -> Scene:
    """``scene`` with a wall of 1 m by 1 m, 0.22 m before ``camera`` (1)."""
    across = torch.linspace(-0.5, 0.5, 41, dtype=torch.float64)
    x, y = torch.meshgrid(across, across, indexing="xy")
    wall = torch.stack([x.flatten(), y.flatten(), torch.full((len(across) ** 2,), 0.22)], dim=1)
    means = wall @ camera.c2w[0, :3, :3].T + camera.center[0]
    splats, n = scene.geometry, len(means)
    more = {
        "means": means.float(),
        "scales": torch.full((n, 3), 0.02),
        "quats": torch.eye(4)[:1].expand(n, 4),
        "opacity": torch.full((n,), 0.99),
        "sh": torch.zeros(n, *splats.sh.shape[1:]),
        "label": torch.zeros(n),
    }
    both = {name: torch.cat([getattr(splats, name), part]) for name, part in more.items()}
    return replace(scene, geometry=Splats(**both), digest="walled")


def test_no_frame_is_taken_from_inside_a_wall_though_the_losses_like_it_there() -> None:
    by_joints = ["preset=fast", "losses.filmic_space=null", "losses.camera_movement=null"]  # they see through a wall
    config, scene, size = load_config(overrides=by_joints), builtin_scene("plaza"), (96, 54)
    assert scene.subject is not None
    parts, search, guard = Components.build(config), SubjectOrbit(), Guard(scene.subject.height)
    true = shot("static", scene.subject, size, 2).camera
    plan = parts.plan("scene", also=READ)
    stage = Stage(scene, parts.renderer, plan, Objective(parts.losses), size)
    reference = read_path(stage, true)
    schedule = make_schedule(config, search, stage.objective, reference)
    home = shot("static", scene.subject, size, 1, setup=Setup(azimuth=math.radians(60))).camera
    inside = replace(stage, scene=walled(scene, true[0]))
    assert not bool(guard.blocked(read_path(inside, home)).any())
    blocked = [
        guard.blocked(read_path(inside, follow(WholeClip(by, search, reference, home[0]), home, schedule).camera))
        for by in (inside, replace(inside, guard=guard))
    ]
    assert bool(blocked[0].all())
    assert not bool(blocked[1].any())


class Thick(Guard):
    """A guard of a scene in which every camera stands inside something."""

    def reasons(self, features: Features, reference: Features | None = None) -> dict[str, torch.Tensor]:
        return {"walls": torch.ones(len(features), dtype=torch.bool)}


@pytest.mark.parametrize("guard", [True, False])
def test_whether_the_person_is_hidden_is_seen_whatever_the_losses_ask_for(guard: bool, tmp_path: Path) -> None:
    asked = ("losses.filmic_space=null", "losses.camera_movement=null", "losses.shot_size=null", "losses.framing=null")
    config = load_config(overrides=[*asked, f"guard={str(guard).lower()}", "search_side=48", "output_side=48"])
    scene, path = builtin_scene("plaza"), tmp_path / "shot.json"
    assert scene.subject is not None
    shot("static", scene.subject, (48, 27), 2).save(path)
    job = prepare(Inputs("builtin:plaza", f"builtin:plaza@{path}"), config, Clock(), silent, None)
    assert ("subject" in job.stage.plan.wanted) == guard


class Nearness:
    """A network that finds everything at no distance."""

    requires, provides, family, passes = ("image",), ("depth",), "image", 1

    def __call__(self, now: Features, before: Features | None = None) -> Features:
        return replace(now, depth=torch.zeros_like(now.require("image")[:, 0]))


def test_things_may_hide_no_more_joints_of_those_shown_than_a_guard_allows() -> None:
    """Joints that the reference lacks, that are outside the frame or that nobody knows of the person are not hidden."""
    person = builtin_scene("plaza").subject
    assert person is not None
    person = replace(person, confidence=torch.ones(14).double().index_fill(0, torch.tensor([13]), 0.0))
    seen = replace(view(), person=person)
    keypoints = seen.require("keypoints").clone()
    keypoints[:, :4, 2] = keypoints[:, 13, 2] = 0.0  # behind something; the last is not known
    keypoints[:, 0, 0] = -1.0  # outside the frame
    seen = replace(seen, keypoints=keypoints)
    reference = view()
    shown = reference.require("keypoints").clone()
    shown[:, 1, 2] = 0.0
    reference = replace(reference, keypoints=shown)
    share = 2 / 11  # of 14 without the first, the second and the last
    assert hidden_share(seen, shown[..., 2] > 0.5).tolist() == [pytest.approx(share)]
    for allowed, refused in ((share - 1e-6, True), (share + 1e-6, False), (1.0, False)):
        reasons = Guard(1.8, allowed).reasons(seen, reference)
        assert [name for name, wrong in reasons.items() if bool(wrong[0])] == [
            "things hide part of the person"
        ] * refused
    assert hidden_share(replace(seen, person=None), shown[..., 2] > 0.5).tolist() == [0.0]


@pytest.mark.parametrize("unit", [1.0, 100.0])
def test_who_stands_inside_the_person_does_so_in_any_unit(unit: float) -> None:
    person = replace(sample_subject(), joints=sample_subject().joints * unit, height=sample_subject().height * unit)
    eye = person.anchor[None] + 0.1 * person.height * person.facing
    camera = Camera.look_at(eye, eye + person.facing, person.up, 0.7, (16, 9))
    seen = Features((16, 9), depth=torch.full((1, 9, 16), 3.0 * person.height), camera=camera, person=person)
    assert bool(Guard(person.height).reasons(seen)["the camera stands inside the person"])


@pytest.mark.parametrize("end", ["over the head", "under the feet"])
@pytest.mark.parametrize(("off", "within"), [(0.11, True), (0.13, False)])
def test_beyond_the_head_and_the_feet_there_is_no_more_body_to_stand_in(end: str, off: float, within: bool) -> None:
    person = sample_subject()
    last, before = person.key_joints[[0, 1] if end == "over the head" else [-1, -2], :3]
    eye = last + off * person.height * torch.nn.functional.normalize(last - before, dim=0)
    camera = Camera.look_at(eye[None], eye[None] + person.facing, person.up, 0.7, (W, H))
    seen = Features((W, H), depth=torch.full((1, H, W), 9.0), camera=camera, person=person)
    assert bool(Guard(person.height).reasons(seen)["the camera stands inside the person"]) == within


def test_how_far_a_reference_is_filled_is_measured_once_for_all_views(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its layers may be far larger than a candidate's view, and thousands of those are held against it."""
    measured = list[Features]()
    usual = guard._filled_frames

    def measure(seen: Features) -> torch.Tensor:
        measured.append(seen)
        return usual(seen)

    monkeypatch.setattr(guard, "_filled_frames", measure)
    now, reference = view(), view()
    layers = torch.zeros(1, 3, H, W, dtype=torch.bool)
    reference = replace(reference, layers=layers)
    told = [Guard(1.7).reasons(now, reference) for _ in range(3)]
    assert len(measured) == 1
    assert told[0].keys() == told[2].keys()
    layers[:] = True  # torch tells of it, so it is another reference
    assert bool(guard._filled(reference).all())
