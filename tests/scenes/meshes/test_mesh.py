from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from cltransfer.scenes.meshes.mesh import Mesh

CORNERS = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = torch.tensor([[0, 1, 2], [0, 1, 3]])


def test_a_plain_mesh_is_grey_shaded_and_nobodys():
    mesh = Mesh.plain(CORNERS, FACES)
    assert len(mesh) == 2
    assert bool(mesh.shaded.all())
    assert not mesh.label.any()
    assert mesh.colors.unique().numel() == 1
    assert not Mesh.plain(CORNERS, FACES, torch.rand(4, 3)).shaded.any()


def test_middles_of_faces_stand_for_them():
    torch.testing.assert_close(Mesh.plain(CORNERS, FACES).means[1], torch.tensor([1 / 3, 0, 1 / 3]))


def test_a_transform_moves_the_vertices():
    transform = torch.tensor([[0.0, -2, 0, 5], [2, 0, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]])
    moved = Mesh.plain(CORNERS, FACES).moved(transform)
    assert moved.vertices[1].tolist() == [5.0, 2.0, 0.0]
    assert moved.vertices.dtype == torch.float32


def test_joined_meshes_keep_their_faces_textures_and_labels():
    image = torch.zeros(2, 3, 4, dtype=torch.uint8)
    textured = replace(Mesh.plain(CORNERS, FACES), texture=torch.tensor([0, -1]).int(), textures=(image,))
    plain = Mesh.plain(CORNERS + 5, FACES).with_label(torch.tensor([1.0, 0.0]))
    other = replace(textured, textures=(image.clone(),))
    joined = Mesh.concatenate([textured, plain, other])
    assert joined.faces.tolist() == [[0, 1, 2], [0, 1, 3], [4, 5, 6], [4, 5, 7], [8, 9, 10], [8, 9, 11]]
    assert joined.texture.tolist() == [0, -1, -1, -1, 1, -1]
    assert joined.label.tolist() == [0, 0, 1, 0, 0, 0]
    assert len(joined.textures) == 2


def test_joined_meshes_keep_an_image_that_they_share_once():
    red, blue = (torch.full((2, 3, 4), value, dtype=torch.uint8) for value in (1, 2))
    first = replace(Mesh.plain(CORNERS, FACES), texture=torch.tensor([1, 0]).int(), textures=(red, blue))
    second = replace(first, texture=torch.tensor([0, -1]).int(), textures=(blue,))
    joined = Mesh.concatenate([first, second])
    assert joined.texture.tolist() == [1, 0, 1, -1]
    assert [image is other for image, other in zip(joined.textures, (red, blue), strict=True)] == [True, True]


def test_an_image_that_is_wrapped_in_two_ways_is_two_textures():
    image = torch.zeros(2, 3, 4, dtype=torch.uint8)
    first = replace(Mesh.plain(CORNERS, FACES), texture=torch.tensor([0, -1]).int(), textures=(image,))
    clamped = replace(first, wraps=(("clamp", "mirror"),))
    joined = Mesh.concatenate([first, clamped, first, clamped])
    assert joined.texture.tolist() == [0, -1, 1, -1] * 2
    assert joined.wraps == (("repeat", "repeat"), ("clamp", "mirror"))
    assert joined.packed.images[:, 4:].tolist() == [[0, 0], [1, 2]]


def test_an_image_that_is_wrapped_in_many_ways_is_packed_once():
    shown, other = (torch.full((2, 3, 4), value, dtype=torch.uint8) for value in (200, 100))
    images, wraps = (shown, other, shown), (("repeat", "repeat"), ("clamp", "clamp"), ("clamp", "mirror"))
    mesh = replace(Mesh.plain(CORNERS, FACES), texture=torch.tensor([0, 2]).int(), textures=images, wraps=wraps)
    packed = mesh.packed
    assert packed.images[:, 0].tolist() == [0, 6, 0]
    assert packed.texels.tolist() == [[200] * 4] * 6 + [[100] * 4] * 6


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"faces": torch.tensor([[0, 1, 4]] * 2)}, r"faces must be in \[0, 4\)"),
        ({"texture": torch.tensor([0, -1]).int()}, r"texture must be in \[-1, 0\)"),
        ({"uv": torch.zeros(3, 2)}, r"uv must be \(4, 2\)"),
        ({"label": torch.zeros(3)}, r"label must be \(2,\)"),
        ({"textures": (torch.zeros(2, 2, 3, dtype=torch.uint8),)}, "RGBA|uint8"),
        ({"wraps": (("clamp", "clamp"),)}, r"wraps must be \(\) or 0, one of each texture, got 1"),
    ],
)
def test_wrong_shapes_and_indices_are_refused(change, reason):
    with pytest.raises(ValueError, match=reason):
        replace(Mesh.plain(CORNERS, FACES), **change)
