"""Filmic space (Eq. 8-10): ratios of layer depths, and what an empty layer costs."""

import math
from dataclasses import replace

import pytest
import torch

from cltransfer.features import Features
from cltransfer.losses.filmic_space import FilmicSpace, filmic_space_loss, space_differences
from cltransfer.testing import sample_features

NAN = float("nan")


def stage(foreground: float | None, character: float | None, background: float | None) -> Features:
    """One frame of three flat layers at the given depths; None is an empty layer."""
    depth, layers = torch.full((1, 30, 30), NAN), torch.zeros(1, 3, 30, 30, dtype=torch.bool)
    for k, value in enumerate((foreground, character, background)):
        if value is not None:
            depth[:, 10 * k : 10 * k + 10] = value
            layers[:, k, 10 * k : 10 * k + 10] = True
    return replace(sample_features(0, 1), depth=depth, layers=layers)


def speck() -> Features:
    """A foreground of 4 of 900 pixels, fewer than count."""
    features = stage(None, 2, 8)
    features.layers[:, 0, 0, :4], features.depth[:, 0, :4] = True, 0.1
    return features


def test_is_the_difference_of_both_log_ratios() -> None:
    value = FilmicSpace()(stage(1, 2, 8), stage(3, 4, 5))
    expected = abs(math.log(8 / 2) - math.log(5 / 4)) + abs(math.log(1 / 2) - math.log(3 / 4))
    assert float(value) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("mode", ["robust", "faithful"])
def test_layer_empty_on_both_sides_costs_nothing_row_7(mode: str) -> None:
    value = FilmicSpace(mode=mode)(stage(None, 2, 8), stage(None, 4, 8))
    assert float(value) == pytest.approx(math.log(2), rel=1e-6)


def test_layer_empty_on_one_side_costs_the_mismatch_row_7() -> None:
    full, empty = stage(1, 2, 8), stage(None, 2, 8)
    assert float(FilmicSpace()(full, empty)) == pytest.approx(math.log(2))
    assert float(FilmicSpace()(empty, full)) == pytest.approx(math.log(2))
    assert float(FilmicSpace(mismatch=0.3)(full, empty)) == pytest.approx(0.3)
    assert float(FilmicSpace(mode="faithful")(full, empty)) == pytest.approx(0)


def test_faithful_without_a_ratio_is_undefined_row_7() -> None:
    assert FilmicSpace(mode="faithful")(stage(1, 2, None), stage(None, 2, 8)).isnan().all()
    assert filmic_space_loss(torch.tensor([[NAN, 1.0, 2.0]]), torch.tensor([[1.0, 1.0, NAN]])).isnan().all()


@pytest.mark.parametrize("mode", ["robust", "faithful"])
def test_character_missing_is_undefined_row_7(mode: str) -> None:
    loss = FilmicSpace(mode=mode)
    assert loss(stage(1, None, 8), stage(1, 2, 8)).isnan().all()
    assert loss(stage(1, 2, 8), stage(1, None, 8)).isnan().all()
    assert space_differences(torch.tensor([[NAN] * 3]), torch.tensor([[NAN] * 3]), 0.7).isnan().all()


def test_layer_below_the_least_area_is_empty_row_7() -> None:
    assert float(FilmicSpace()(stage(None, 2, 8), speck())) == 0
    assert float(FilmicSpace(min_area=0.001)(stage(None, 2, 8), speck())) == pytest.approx(math.log(2))


def test_flat_layers_are_no_singularity_row_8() -> None:
    assert float(FilmicSpace()(stage(2, 2, 2), stage(5, 5, 5))) == pytest.approx(0, abs=1e-6)


def test_lens_leaves_the_ratio_alone_row_10() -> None:
    """A longer lens enlarges the middle of the frame and moves no depth; a nearer camera does."""
    near, far = torch.tensor([[1.0, 3.0, 9.0]]), torch.tensor([[2.0, 4.0, 10.0]])
    wide = stage(1, 3, 9)
    long = replace(wide, depth=wide.depth[:, 5:25, 5:25].contiguous(), layers=wide.layers[..., 5:25, 5:25])
    assert float(FilmicSpace()(wide, long)) == pytest.approx(0, abs=1e-6)
    assert float(filmic_space_loss(near, far)) > 0.1


def split(nearer: int) -> Features:
    """The character at 2 before a background at 8, behind 300 pixels of which so many are at 0.5, the others at 1."""
    features = stage(1, 2, 8)
    features.depth.view(-1)[:nearer] = 0.5
    return features


def test_beyond_a_jump_is_what_the_peak_that_is_wanted_costs() -> None:
    reference, loss = stage(0.5, 2, 8), FilmicSpace()
    rendered = Features.concatenate([split(nearer) for nearer in (120, 140, 160, 180)])
    found = loss.beyond(reference, rendered)
    assert found[:, 1, 0].tolist() == pytest.approx([0, 0, 0, 0], abs=1e-6)
    leads = [math.log((300 - n) / n) for n in (120, 140, 160, 180)]
    assert found[:, 1, 1].tolist() == pytest.approx(leads, abs=1e-6)
    there = found[..., 1] <= 0
    assert there.tolist() == [[True, False], [True, False], [True, True], [True, True]]
    torch.testing.assert_close(found[..., 0][there], loss.residuals(reference, rendered)[there])
    assert loss.residuals(reference, rendered)[:, 1].tolist() == pytest.approx([math.log(2)] * 2 + [0] * 2, abs=1e-6)


def test_beyond_a_jump_there_is_no_layer_that_a_side_lacks() -> None:
    for reference, rendered in ((stage(None, 2, 8), stage(1, 2, 8)), (stage(1, 2, 8), stage(None, 2, 8))):
        found = FilmicSpace().beyond(reference, rendered)
        assert found.isnan().all(-1).tolist() == [[False, True]]
    assert FilmicSpace().beyond(stage(1, None, 8), stage(1, 2, 8)).isnan().all()


def test_options_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="mismatch must be >= 0, got -1"):
        FilmicSpace(mismatch=-1)
    with pytest.raises(ValueError, match=r"min_area must be in \[0, 1\], got 2"):
        FilmicSpace(min_area=2)


@pytest.mark.parametrize("none", [torch.nan, torch.inf, 0.0])
def test_a_layer_of_which_less_than_the_least_area_has_a_depth_is_empty(none: float) -> None:
    """A mask is no depth: one pixel of the person that has one would tell how far away they are."""
    features = sample_features(0, 1)
    depth, mask = features.require("depth").clone(), features.require("layers")[0, 1]
    y, x = mask.nonzero()[0].tolist()
    depth[0, mask] = none
    depth[0, y, x] = 9.0
    assert bool(FilmicSpace()(features, replace(features, depth=depth)).isnan())
    assert bool(FilmicSpace(mode="faithful")(features, replace(features, depth=depth)).isfinite())


@pytest.mark.parametrize("unit", [1.0, 37.0])
@pytest.mark.parametrize(
    ("off", "column", "layer"), [(1.5, 0, 8.0), (1 / 1.5, 0, 8.0), (1.5, 1, 0.5), (1 / 1.5, 1, 0.5)]
)
def test_beyond_a_jump_a_peak_costs_how_far_it_is_from_where_it_is_wanted(
    off: float, column: int, layer: float, unit: float
) -> None:
    """By the render's own person, 3 away where that of the reference is 2, and by either side's own unit."""
    reference = stage(0.5, 2, 8)
    there = [0.5 * 1.5, 3, 8 * 1.5]
    there[2 if column == 0 else 0] *= off
    rendered = stage(*there)
    found = FilmicSpace().beyond(reference, replace(rendered, depth=rendered.depth * unit))[0, :, 0]
    expected = [0.0, 0.0]
    expected[column] = math.log(off)
    assert found.tolist() == pytest.approx(expected, abs=1e-5)


def test_beyond_a_jump_there_is_no_layer_below_the_least_area() -> None:
    assert FilmicSpace().beyond(stage(1, 2, 8), speck()).isnan().all(-1).tolist() == [[False, True]]
    assert not FilmicSpace(min_area=0.001).beyond(stage(1, 2, 8), speck()).isnan().any()


def test_one_reference_is_read_by_the_least_area_of_each_loss() -> None:
    reference = speck()
    assert float(FilmicSpace()(reference, stage(None, 2, 8))) == 0
    assert float(FilmicSpace(min_area=0.001)(reference, stage(None, 2, 8))) == pytest.approx(math.log(2))
