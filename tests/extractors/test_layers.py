"""Foreground, character, background: one definition with and one without depth."""

from dataclasses import replace

import pytest
import torch

from cltransfer.extractors.layers import Layers, near_depth
from cltransfer.features import Features


def frame() -> Features:
    """One row: post at 1, subject at 3 to 4, floor beside the subject at 3.5, wall at 9, sky without depth."""
    depth = torch.tensor([[[1.0, 1.0, 3.0, 3.5, 4.0, 3.5, 9.0, torch.nan]]])
    subject = torch.tensor([[[False, False, True, True, True, False, False, False]]])
    return Features((8, 1), depth=depth, subject=subject)


def test_foreground_is_nearer_than_the_near_side_of_the_subject_row_6() -> None:
    foreground, character, background = Layers()(frame(), None).layers[0, :, 0].tolist()
    assert foreground == [True, True] + [False] * 6
    assert character == frame().subject[0, 0].tolist()
    assert background == [False] * 5 + [True, True, False]


def test_without_depth_there_is_no_foreground_row_6() -> None:
    features = replace(frame(), depth=None)
    foreground, character, background = Layers()(features, None).layers[0]
    assert not foreground.any()
    assert torch.equal(background, ~character)


def test_layers_are_disjoint_row_6() -> None:
    random = torch.Generator().manual_seed(0)
    depth = torch.rand(4, 20, 30, generator=random) * 5 + 0.1
    subject = torch.rand(4, 20, 30, generator=random) < 0.3
    layers = Layers()(Features((30, 20), depth=depth, subject=subject), None).layers
    assert (layers.sum(1) == 1).all()


@pytest.mark.parametrize("coarse", ["depth", "subject"])
def test_a_mask_and_a_depth_of_other_pixels_are_brought_onto_the_finer_row_6(coarse: str) -> None:
    few = frame()
    fine = Features(
        (24, 2),
        depth=few.depth.repeat_interleave(2, 1).repeat_interleave(3, 2),
        subject=few.subject.repeat_interleave(2, 1).repeat_interleave(3, 2),
    )
    mixed = replace(fine, **{coarse: getattr(few, coarse)})
    layers = Layers()(mixed, None).layers
    assert layers.shape == (1, 3, 2, 24)
    assert torch.equal(layers, Layers()(fine, None).layers)


@pytest.mark.parametrize("unknown", [0.0, -2.0, torch.inf])
def test_a_depth_that_is_no_distance_is_as_unknown_as_none_row_6(unknown: float) -> None:
    """On the post, on the subject and in the sky."""
    holes = torch.tensor([[[False, True, True, False, False, False, False, True]]])
    nan, other = (replace(frame(), depth=frame().depth.masked_fill(holes, v)) for v in (torch.nan, unknown))
    layers = Layers(near_quantile=0.0)(other, None).layers
    assert torch.equal(layers, Layers(near_quantile=0.0)(nan, None).layers)
    assert layers.any(1)[0, 0].tolist() == [True, False] + [True] * 5 + [False]
    assert float(near_depth(other.depth, other.subject, 0.0)) == 3.5


def test_depth_scale_does_not_matter_row_9() -> None:
    scaled = replace(frame(), depth=41 * frame().depth)
    assert torch.equal(Layers()(scaled, None).layers, Layers()(frame(), None).layers)


def test_without_a_subject_nothing_is_foreground() -> None:
    features = replace(frame(), subject=torch.zeros(1, 1, 8, dtype=torch.bool))
    foreground, character, background = Layers()(features, None).layers[0]
    assert not foreground.any()
    assert not character.any()
    assert int(background.sum()) == 7


def test_near_side_is_a_quantile_of_the_subject() -> None:
    depth = torch.arange(1.0, 101).reshape(1, 10, 10)
    everything = torch.ones(1, 10, 10, dtype=torch.bool)
    assert float(near_depth(depth, everything, 0.0)) == 1
    assert float(near_depth(depth, everything, 0.1)) == 10
    assert near_depth(depth, ~everything, 0.1).isnan().all()
    assert near_depth(depth * torch.nan, everything, 0.1).isnan().all()


def test_a_few_wrong_pixels_do_not_set_the_near_side_row_6() -> None:
    depth, subject = torch.full((1, 10, 10), 5.0), torch.zeros(1, 10, 10, dtype=torch.bool)
    subject[:, :5] = True
    depth[:, 0, :3] = 0.5  # the mask spills over a post
    depth[:, 9] = 2.0  # nearer than the person, not the person
    assert int(Layers()(Features((10, 10), depth=depth, subject=subject), None).layers[:, 0].sum()) == 10


def test_option_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"near_quantile must be in \[0, 1\), got 1"):
        Layers(1.0)
