import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.errors import UsageError
from cltransfer.registry import RENDERERS
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import SETS, builtin_scene, named_scene
from cltransfer.scenes.builtin.forms import as_grid, as_mesh, painted
from cltransfer.scenes.builtin.paint import Part, plain
from cltransfer.scenes.builtin.surfaces import Panel
from cltransfer.scenes.load import load_scene


@pytest.fixture(scope="module", params=SETS)
def scene(request) -> Scene:
    return builtin_scene(request.param)


def test_a_scene_is_small_and_labels_its_person(scene):
    assert 15_000 <= len(scene.geometry) <= 45_000
    assert 2000 < float(scene.geometry.label.sum()) < 8000
    assert scene.subject is not None


def test_gaussians_are_flat_opaque_and_well_formed(scene):
    splats = scene.geometry
    assert torch.isfinite(splats.means).all()
    assert (splats.scales > 0).all()
    assert (splats.scales[:, 2] <= splats.scales[:, :2].amin(1)).all()
    torch.testing.assert_close(splats.quats.norm(dim=1), torch.ones(len(splats)))
    assert splats.opacity.unique().tolist() == pytest.approx([0.99])


def test_joints_lie_within_the_labelled_gaussians(scene):
    body = scene.geometry.means[scene.geometry.label > 0.5].double()
    assert torch.cdist(scene.subject.joints, body).amin(1).max() < 0.12


def test_the_subject_stands_upright_on_the_ground_along_up(scene):
    heights = scene.subject.joints @ scene.up
    assert heights[12] == heights.max()
    assert heights.min() > 0
    assert float(heights[12]) == pytest.approx(scene.subject.height, rel=0.02)
    assert float(scene.subject.facing @ scene.up) == pytest.approx(0)


def test_left_is_the_body_s_left(scene):
    joints = scene.subject.joints
    assert (joints[0] - joints[1]) @ scene.subject.left > 0.2


def test_the_two_scenes_have_different_up_axes():
    assert builtin_scene("courtyard").up.tolist() == [0, 0, 1]
    assert builtin_scene("plaza").up.tolist() == [0, -1, 0]


def test_a_scene_repeats_exactly_and_its_seed_changes_texture_and_digest():
    make = builtin_scene.__wrapped__  # not the kept one
    first, again, other = make("plaza"), make("plaza"), make("plaza", seed=1)
    assert torch.equal(first.geometry.sh, again.geometry.sh)
    assert first.digest == again.digest
    assert not torch.equal(first.geometry.sh, other.geometry.sh)
    assert len({first.digest, other.digest, builtin_scene("courtyard").digest}) == 3


@pytest.mark.parametrize("name", SETS)
def test_every_seed_has_another_person(name):
    people = [builtin_scene(name, seed).subject for seed in (1, 2, 3)]
    assert len({round(person.height, 3) for person in people}) == 3
    assert (people[0].joints / people[0].height - people[1].joints / people[1].height).abs().max() > 0.02


def test_the_second_person_on_the_stage_is_not_the_subject():
    scene = builtin_scene("stage", 2)
    body = scene.geometry.means[scene.geometry.label > 0.5].double()
    assert (body - scene.subject.anchor).norm(dim=1).max() < 0.6 * scene.subject.height


@pytest.mark.parametrize("name", ["room", "path"])
def test_the_forms_of_a_scene_show_one_geometry(name):
    scenes = {form: builtin_scene(name, 2, form) for form in ("splats", "mesh")}
    person = scenes["mesh"].subject
    eye = person.anchor + 4 * person.facing + 1.5 * person.left
    camera = Camera.look_at(eye[None], person.anchor, person.up, 0.9, (160, 90))
    buffers = frozenset({"image", "depth", "label"})
    renderers = {"splats": "gaussian_splats", "mesh": "mesh"}
    seen = {form: RENDERERS.build(renderers[form]).render(scene, camera, buffers) for form, scene in scenes.items()}
    assert torch.equal(person.joints, scenes["splats"].subject.joints)
    assert float((seen["mesh"].depth / seen["splats"].depth).log().abs().nanmedian()) < 0.03
    assert float(((seen["mesh"].label > 0.5) == (seen["splats"].label > 0.5)).float().mean()) > 0.98
    coarse = [torch.nn.functional.avg_pool2d(seen[form].image, 10) for form in ("mesh", "splats")]
    assert float((coarse[0] - coarse[1]).abs().mean()) < 0.05
    assert len({scene.digest for scene in scenes.values()}) == 2


def test_a_grid_has_the_person_where_the_mesh_has_it():
    mesh = builtin_scene("room", 2, "mesh")
    body = Panel((-0.2, -0.3, 0.1), (0.0, 0.6, 0.0), (0.0, 0.0, 1.5))
    parts = [Part(body, plain((0.8, 0.2, 0.2)), 0.05, subject=True)]
    cells = painted(parts, np.array([0.3, 0.2, 0.9]), np.random.Generator(np.random.PCG64(0)))
    forms = {"mesh": as_mesh(cells, np.eye(3)), "nerf_grid": as_grid(cells, np.eye(3), cells=64)}
    eye, up = torch.tensor([[3.0, 0.0, 1.0]]), torch.tensor([0.0, 0.0, 1.0])
    camera = Camera.look_at(eye, torch.tensor([0.0, 0.0, 0.9]), up, 0.9, (96, 54))
    masks = [
        RENDERERS.build(name).render(replace(mesh, geometry=form), camera, frozenset({"label"})).label > 0.5
        for name, form in forms.items()
    ]
    assert float((masks[0] & masks[1]).sum() / (masks[0] | masks[1]).sum()) > 0.7


def test_a_scene_s_name_tells_its_seed_and_form():
    assert load_scene("builtin:room-3-mesh").digest == builtin_scene("room", 3, "mesh").digest
    assert named_scene("plaza").digest == builtin_scene("plaza").digest
    assert (named_scene("room-3-mesh").name, named_scene("plaza").name) == ("room-3-mesh", "plaza")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("room-x", "expected NAME-SEED-FORM, got the seed 'x'"),
        ("room-3-fog", "no form 'fog'"),
        ("plaza-" + "3" * 5000, r"scene 'plaza-33333333333333'...: expected a seed of at most 18 digits"),
        ("den-3", "no such built"),
    ],
)
def test_a_wrong_name_says_what_is_wrong(name, reason):
    with pytest.raises(UsageError, match=reason):
        named_scene(name)


def test_an_unknown_scene_is_one_line_that_names_the_known():
    with pytest.raises(
        UsageError, match=r"scene 'moon': no such built-in scene \(known: courtyard, path, plaza, room, stage\)"
    ):
        builtin_scene("moon")


def test_from_all_round_the_person_every_ray_hits_something(scene):
    subject = scene.subject
    angles = torch.arange(8, dtype=torch.float64) * math.pi / 4
    round_it = angles.cos()[:, None] * subject.facing + angles.sin()[:, None] * subject.left
    eyes = subject.anchor + 3.0 * round_it + 0.3 * subject.up
    cameras = Camera.look_at(eyes, subject.anchor, subject.up, 0.9, (96, 54))
    seen = RENDERERS.build("gaussian_splats").render(scene, cameras, frozenset({"image", "alpha"}))
    assert seen.alpha.mean() > 0.97
    assert seen.alpha.amin() > 0.8
    assert 0.15 < float(seen.image.mean()) < 0.75
