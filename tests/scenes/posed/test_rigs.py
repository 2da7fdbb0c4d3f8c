"""Models of COLMAP 3.12 and later: rigs and frames stand beside the images, which still have their poses."""

from __future__ import annotations

import pytest
import torch

from cltransfer.scenes.posed import read_posed

pycolmap = pytest.importorskip("pycolmap", reason="the extra [sfm] is not installed")


@pytest.mark.parametrize("binary", [True, False])
def test_a_model_of_rigs_has_the_poses_colmap_has(tmp_path, binary):
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 2, 2, 3
    model = pycolmap.synthesize_dataset(options)
    folder = tmp_path / "sparse" / "0"
    folder.mkdir(parents=True)
    (model.write_binary if binary else model.write_text)(str(folder))
    suffix = "bin" if binary else "txt"
    assert (folder / f"rigs.{suffix}").is_file()
    assert (folder / f"frames.{suffix}").is_file()
    posed = read_posed(tmp_path)
    images = sorted(model.images.values(), key=lambda image: image.name)
    assert posed.names == tuple(image.name for image in images)
    for i, image in enumerate(images):
        w2c = torch.from_numpy(image.cam_from_world().matrix())
        torch.testing.assert_close(posed.camera.w2c[i, :3], w2c, atol=1e-9, rtol=0)
