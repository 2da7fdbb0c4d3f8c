"""A real capture: two files agree on its cameras, and its points have the colours of the pixels they fall on."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cltransfer.scenes.posed import PosedImages, read_posed

SET = Path(__file__).resolve().parents[3].parent / "shared" / "data" / "posed" / "snowmiku"

pytestmark = pytest.mark.skipif(not SET.is_dir(), reason=f"the real capture is not here: {SET}")


@pytest.fixture(scope="module")
def posed() -> PosedImages:
    return read_posed(SET)


def test_both_files_say_the_same_of_every_camera(posed: PosedImages) -> None:
    inria = read_posed(SET / "cameras_3dgs.json")
    assert [Path(name).stem for name in posed.names] == list(inria.names)
    assert posed.missing == inria.missing == ()
    torch.testing.assert_close(inria.camera.w2c, posed.camera.w2c, rtol=0, atol=1e-5)
    fields = [camera.vertical_fov for camera in (posed.camera, inria.camera)]
    torch.testing.assert_close(fields[0], fields[1], rtol=2e-3, atol=0)  # one was rounded to another size


def test_points_have_the_colours_of_the_pixels_they_fall_on(posed: PosedImages) -> None:
    assert posed.points is not None
    assert posed.colors is not None
    shuffled = posed.colors[torch.randperm(len(posed.colors), generator=torch.Generator().manual_seed(0))]
    for index in (0, 30, 60, 90):
        camera, image = posed.images([index], 396)
        pixels, depth = camera.project(posed.points)
        x, y = pixels[0].unbind(1)
        seen = (depth[0] > 0) & (x >= 0) & (x < camera.size[0]) & (y >= 0) & (y < camera.size[1])
        assert float(seen.double().mean()) > 0.3
        found = image[0].permute(1, 2, 0)[y[seen].long(), x[seen].long()].float()
        right, by_chance = (
            float(((found - colors[seen].float()).abs().mean(1) < 12).double().mean())
            for colors in (posed.colors, shuffled)
        )
        assert right > 1.6 * by_chance  # not all: what stands before a point hides it


def test_points_fall_on_their_pixels_and_not_beside_them(posed: PosedImages) -> None:
    assert posed.points is not None
    assert posed.colors is not None
    camera, image = posed.images([15], 792)
    pixels = camera.project(posed.points)[0][0]
    inside = ((pixels >= 8) & (pixels < torch.tensor(camera.size) - 8)).all(1)

    def error(shift: tuple[int, int]) -> float:
        x, y = (pixels[inside] + torch.tensor(shift)).long().unbind(1)
        return float((image[0, :, y, x].T.float() - posed.colors[inside].float()).abs().mean(1).median())

    assert error((0, 0)) < 0.93 * min(error(shift) for shift in ((8, 0), (-8, 0), (0, 8), (0, -8)))


def test_reduced_images_are_taken_with_the_camera_of_their_full_size(posed: PosedImages) -> None:
    camera, image = read_posed(SET / "cameras_3dgs.json").images([0], 198)  # says 3958x2968, images are 792x594
    assert image.shape == (1, 3, 148, 198)
    assert camera.size == (198, 148)
