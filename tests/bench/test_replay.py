"""The naive baseline: exact where nothing differs, and wrong in the way that is told of it."""

import math

import pytest
import torch
from kornia.geometry.conversions import axis_angle_to_rotation_matrix

from cltransfer.bench.replay import rebuilt, replayed
from cltransfer.camera import Camera
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene
from cltransfer.scenes.load import load_scene
from cltransfer.shots import SHOTS, shot
from cltransfer.subject import Subject
from cltransfer.testing import sample_subject

SIZE = (160, 90)


@pytest.mark.parametrize("name", SHOTS)
def test_from_its_own_first_camera_a_path_is_itself(name: str) -> None:
    path = shot(name, sample_subject(), SIZE, 6).camera
    again = replayed(path, path[0], 1.0)
    torch.testing.assert_close(again.w2c, path.w2c, atol=1e-9, rtol=0)
    torch.testing.assert_close(again.K, path.K)


def test_a_similarity_of_the_reference_changes_nothing() -> None:
    """What structure from motion leaves open: where, turned how, and how large."""
    path = shot("orbit", sample_subject(), SIZE, 6).camera
    turn = axis_angle_to_rotation_matrix(torch.tensor([[0.3, -1.1, 0.4]], dtype=torch.float64))[0]
    center = 2.5 * path.center @ turn.T + torch.tensor([4.0, -3.0, 1.0])
    w2c = path.w2c.clone()
    w2c[:, :3, :3] = path.w2c[:, :3, :3] @ turn.T
    w2c[:, :3, 3] = -(w2c[:, :3, :3] @ center[..., None])[..., 0]
    rebuilt = Camera(w2c, path.K, SIZE)
    torch.testing.assert_close(replayed(rebuilt, path[0], 1 / 2.5).w2c, path.w2c, atol=1e-9, rtol=0)


def test_the_first_camera_is_home_whatever_is_played() -> None:
    path = shot("dolly_zoom", sample_subject(), SIZE, 5).camera
    eye = torch.tensor([[2.0, 3.0, 1.0]])
    home = Camera.look_at(eye, torch.zeros(1, 3), torch.tensor([0.0, 0.0, 1.0]), math.radians(30), (320, 180))
    played = replayed(path, home, 1.3, drift=1.5)
    torch.testing.assert_close(played[0].w2c, home.w2c)
    torch.testing.assert_close(played.focal / home.focal, path.focal / path.focal[0])


def test_drift_lengthens_later_steps() -> None:
    path = shot("truck", sample_subject(), SIZE, 9).camera
    plain, drifted = (replayed(path, path[0], 1.0, drift).center.diff(dim=0).norm(dim=1) for drift in (1.0, 2.0))
    torch.testing.assert_close(drifted / plain, 2 ** torch.linspace(0, 1, 9, dtype=torch.float64)[1:])


def test_a_scale_that_is_not_positive_is_refused() -> None:
    path = shot("static", sample_subject(), SIZE, 2).camera
    with pytest.raises(ValueError, match="must be positive"):
        replayed(path, path[0], 0.0)


@pytest.fixture(scope="module")
def filmed() -> tuple[Scene, Subject]:
    """A scene, and the person in it."""
    scene = load_scene("builtin:room-3")
    assert scene.subject is not None
    return scene, scene.subject


def test_a_path_is_rebuilt_from_its_frames_up_to_what_they_tell(filmed: tuple[Scene, Subject]) -> None:
    pytest.importorskip("pycolmap", reason="needs the extra cltransfer[sfm]")
    scene, subject = filmed
    path = shot("boom", subject, (320, 180), 9)
    found = rebuilt(GaussianSplats(), scene, path)
    home = path.camera[0]
    off = replayed(found, home, 1.0).center - path.camera.center
    extent = (path.camera.center - path.camera.center.mean(0)).square().sum(1).mean().sqrt()
    assert float(off.norm(dim=1).max()) < 0.2 * float(extent)
    assert not torch.equal(found.w2c, path.camera.w2c)


def test_of_a_camera_that_stands_nothing_is_rebuilt(filmed: tuple[Scene, Subject]) -> None:
    pytest.importorskip("pycolmap", reason="needs the extra cltransfer[sfm]")
    scene, subject = filmed
    path = shot("zoom", subject, (160, 90), 4)
    found = rebuilt(GaussianSplats(), scene, path)
    assert torch.equal(found.w2c, path.camera.w2c[:1].expand(4, 4, 4))
    assert torch.equal(found.K, path.camera.K[:1].expand(4, 3, 3))
