import math

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.errors import UsageError
from cltransfer.registry import RENDERERS
from cltransfer.scenes import Scene
from cltransfer.scenes.builtin import builtin_scene

NAMES = ("courtyard", "plaza")


@pytest.fixture(scope="module", params=NAMES)
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
    first, again, other = builtin_scene("plaza"), builtin_scene("plaza"), builtin_scene("plaza", seed=1)
    assert torch.equal(first.geometry.sh, again.geometry.sh)
    assert first.digest == again.digest
    assert not torch.equal(first.geometry.sh, other.geometry.sh)
    assert len({first.digest, other.digest, builtin_scene("courtyard").digest}) == 3


def test_an_unknown_scene_is_one_line_that_names_the_known():
    with pytest.raises(UsageError, match=r"scene 'moon': no such built-in scene \(known: courtyard, plaza\)"):
        builtin_scene("moon")


def test_from_all_round_the_person_every_ray_hits_something(scene):
    subject = scene.subject
    angles = torch.arange(8, dtype=torch.float64) * math.pi / 4
    round_it = angles.cos()[:, None] * subject.facing + angles.sin()[:, None] * subject.left
    eyes = subject.anchor + 3.0 * round_it + 0.3 * subject.up
    cameras = Camera.look_at(eyes, subject.anchor, subject.up, 0.9, (96, 54))
    seen = RENDERERS.build("gaussian_splats").render(scene, cameras, frozenset({"image", "alpha"}))
    assert seen.alpha.mean() > 0.98
    assert seen.alpha.amin() > 0.8
    assert 0.15 < float(seen.image.mean()) < 0.75
