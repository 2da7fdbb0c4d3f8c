"""A shot of a splat scene, found again around a skinned man on a mesh floor."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.errors import UsageError
from cltransfer.pipeline.components import Components
from cltransfer.reading.frames import clip_features, render_features
from cltransfer.run.readback import render_frames
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.person.lifted import lift_scene, summary
from cltransfer.transfer import Inputs, transfer

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data" / "mesh"
SCENE = str(ROOT / "configs" / "scenes" / "man_in_gallery.yaml")
WALKING = """
parts:
  - {file: pc_vr-gallery.glb, label: scene}
  - {file: cesium_man.glb, label: subject, translate: [0.0, 0.0, 1.9], rotate_deg: [0, 20, 0], time: 1.0}
"""
NETWORKS = ("models/yolox_nano.onnx", "models/mp_pose_landmark_lite.onnx")
SMALL = ("frames=3", "output_side=160", "search_side=96", "threads=1")

pytestmark = pytest.mark.needs("mesh/pc_vr-gallery.glb", "mesh/cesium_man.glb")


@pytest.fixture(autouse=True)
def assets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_ASSETS", str(DATA))


def test_the_five_metrics_of_a_transfer_into_a_mesh_come_near_the_reference(tmp_path: Path) -> None:
    scene = tmp_path / "walking.yaml"
    scene.write_text(WALKING)
    result = transfer(Inputs(str(scene), "builtin:dolly_zoom"), load_config(None, [*SMALL, "renderer.mesh={}"]))
    assert result.scene.subject is not None
    assert result.image.shape == (3, 3, 90, 160)
    terms = {term.name: float(term.values.nanmean()) for term in result.verified.terms}
    assert terms["shot_size"] < 0.02
    assert terms["framing"] < 0.02
    assert terms["camera_angle"] < 0.05
    lit = result.image.float().flatten(1).mean(1)
    assert bool((lit > 30).all())  # inside the gallery, not in the void
    assert not torch.equal(result.image[0], result.image[2])


@pytest.mark.needs(*NETWORKS)
def test_of_two_men_in_a_render_the_subject_is_read_not_the_nearer_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA.parent / "models"))
    (tmp_path / "two.yaml").write_text(
        WALKING + "  - {file: cesium_man.glb, label: scene, translate: [1.1, 0.0, 2.35], rotate_deg: [0, 20, 0]}\n"
    )
    scene, parts = load_scene(tmp_path / "two.yaml"), Components.build(load_config(None, ["renderer.mesh={}"]))
    person = scene.subject
    assert person is not None
    eye = person.anchor + 2 * person.height * person.left
    camera = Camera.look_at(eye[None], person.anchor[None], scene.up, 0.9, (640, 360))
    image = render_frames(scene, parts, camera[[0, 0]])
    largest = clip_features(image, parts.plan("image")).require("box")[0]
    box = render_features(image, camera[[0, 0]], person, parts.plan("image")).require("box")[0]
    place = camera.project(person.anchor[None])[0][0, 0]
    assert float(largest[3]) > 1.2 * float(box[3])  # the other one is nearer
    assert bool((box[:2] < place).all() and (place < box[:2] + box[2:4]).all())


def test_the_wrong_renderer_names_the_right_one(tmp_path: Path) -> None:
    scene = tmp_path / "walking.yaml"
    scene.write_text(WALKING)
    with pytest.raises(UsageError) as error:
        transfer(Inputs(str(scene), "builtin:dolly_zoom"), load_config(None, [*SMALL, "renderer.gaussian_splats={}"]))
    assert str(error.value) == ("walking: renderer gaussian_splats: does not draw Mesh (choose: renderer.mesh={})")


@pytest.mark.slow
@pytest.mark.needs(*NETWORKS)
def test_networks_read_the_man_of_the_gallery_from_nearly_all_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA.parent / "models"))
    parts = Components.build(load_config(None, ["renderer.mesh={samples: 2}"]))
    found = lift_scene(load_scene(SCENE), parts.renderer, parts.extractors)
    told = summary(found)
    assert told["joints_known"] == 14
    assert told["views_with_person"] >= 12
    assert told["median_error_widths"] < 0.01
