from __future__ import annotations

import math

import pytest
import torch

from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.scenes.splats import Splats


def test_covariance_of_a_turned_ellipsoid():
    half = math.sqrt(0.5)
    quarter_about_z = torch.tensor([[half, 0, 0, half]])
    one = torch.ones(1)
    splats = Splats(torch.zeros(1, 3), torch.tensor([[1.0, 2, 3]]), quarter_about_z, one, torch.zeros(1, 1, 3), one)
    torch.testing.assert_close(splats.covariances()[0], torch.diag(torch.tensor([4.0, 1, 9])))


def test_a_new_label_leaves_the_old_value_alone():
    room = synthetic_room(200)
    first = room.packed
    marked = room.with_label(torch.ones(200))
    assert float(marked.label.sum()) == 200
    assert float(room.label.sum()) < 200
    assert room.packed is first
    assert float(marked.packed.geometry[:, 10].min()) == 1


@pytest.mark.parametrize("name", ["means", "scales", "quats", "opacity", "label", "sh"])
def test_a_wrong_shape_is_named(name):
    room = synthetic_room(100)
    parts = {n: getattr(room, n) for n in ("means", "scales", "quats", "opacity", "label", "sh")}
    with pytest.raises(ValueError, match=f"{name} must be"):
        Splats(**{**parts, name: parts[name][:, None]})


@pytest.mark.parametrize("name", ["means", "scales", "quats", "opacity", "label", "sh"])
def test_gaussians_that_are_not_finite_are_refused_where_they_would_hide_others(name):
    room = synthetic_room(100)
    parts = {n: getattr(room, n).clone() for n in ("means", "scales", "quats", "opacity", "label", "sh")}
    parts[name][[3, 70]] = torch.nan
    with pytest.raises(ValueError, match=f"^{name} must be finite, 2 of 100 Gaussians are not: leave them out"):
        _ = Splats(**parts).packed


def test_a_seed_makes_one_room():
    first, same, other = synthetic_room(300, 1), synthetic_room(300, 1), synthetic_room(300, 2)
    assert torch.equal(first.means, same.means)
    assert torch.equal(first.sh, same.sh)
    assert not torch.equal(first.means, other.means)
    assert len(first) == 300
    assert 0 < float(first.label.mean()) < 0.5
