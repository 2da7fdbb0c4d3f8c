"""The bench of optical flow: what it counts, on pairs whose flow is known."""

from __future__ import annotations

import pytest
import torch

from cltransfer.bench.flow import (
    HEADER,
    PairScore,
    binned_errors,
    named_methods,
    rendered_pairs,
    run_flow,
    summary,
    write_flow,
)
from cltransfer.bench.pages import markers
from cltransfer.errors import UsageError

METHOD = "flow_dis={preset: ultrafast, height: 180}"


@pytest.fixture(scope="module")
def pairs():
    return list(rendered_pairs(["builtin:plaza"], [3, 3], ["truck"]))


@pytest.fixture(scope="module")
def scores(pairs):
    return run_flow(named_methods([METHOD]), iter(pairs))


def test_a_seed_that_is_named_twice_counts_once(pairs):
    assert len(pairs) == 2  # a step of each length


def test_a_longer_step_is_a_longer_flow(pairs):
    lengths = [float(pair.now.flow.norm(dim=1).nanmean()) for pair in pairs]
    assert lengths[1] > 3 * lengths[0] > 1
    assert pairs[0].before.names() == {"image"}


def test_found_flow_is_near_the_exact_and_nearer_where_it_is_trusted(scores):
    (found,) = scores.values()
    for score in found:
        error, trusted = score.error.sum(1) / score.pixels.sum(1)
        assert 0 < trusted < error < 8
        assert 0.7 < score.pixels[1].sum() / score.pixels[0].sum() < 1
        assert 0 < score.movement[1] < score.movement[0] < 5


def test_errors_are_binned_by_the_exact_length_and_gated_by_confidence():
    exact = torch.zeros(1, 2, 1, 5)
    exact[0, 0, 0] = torch.tensor([0.5, 2.0, 2.0, 20.0, float("nan")])
    found = exact.nan_to_num() + torch.tensor([0.0, 3.0])[None, :, None, None]
    found[0, 1, 0, 2] = 1.0
    error, pixels = binned_errors(found, exact, torch.tensor([[[0.9, 0.1, 0.5, 0.0, 1.0]]]))
    assert error.tolist() == [[3.0, 4.0, 0.0, 3.0], [3.0, 1.0, 0.0, 0.0]]
    assert pixels.tolist() == [[1.0, 2.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]]


def test_a_method_without_a_checked_flow_is_refused():
    with pytest.raises(UsageError, match="provides no flow that is checked"):
        named_methods(["flow_dis={check: false}"])
    with pytest.raises(UsageError, match="did you mean 'flow_dis'"):
        named_methods(["flow_dys={}"])


def test_the_section_holds_a_row_a_method(tmp_path):
    page = tmp_path / "benchmarks.md"
    ones = torch.ones(2, 4)
    score = PairScore(
        (10.0, 25.0), ones * torch.tensor([[2.0], [0.5]]), ones * torch.tensor([[4.0], [1.0]]), (1.0, 0.5)
    )
    write_flow({"flow_dis={}": [score, score]}, page, "cltransfer bench flow")
    text = page.read_text()
    assert markers("Optical flow")[0] in text
    assert "| " + " | ".join(HEADER) + " |" in text
    bins = " | ".join(["0.50, 0.50 (25 %)"] * 4)
    assert f"| flow_dis={{}} | 2 | 10 | 25 | {bins} | 1.00 / 1.00, 0.50 / 0.50 |" in text


def test_terms_that_the_gate_left_undefined_are_counted():
    ones = torch.ones(2, 4)
    scores = [PairScore((1.0, 2.0), ones, ones, (4.0, float("nan"))), PairScore((1.0, 2.0), ones, ones, (2.0, 1.0))]
    assert summary({"m": scores})[0][-1] == "3.00 / 3.00, 1.00 / 1.00 (1 undefined)"
