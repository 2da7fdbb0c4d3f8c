from __future__ import annotations

import importlib.util

import pytest
import torch

from cltransfer.bench.cuda_speed import CANDIDATES, CudaRow, run_cuda
from cltransfer.errors import ModelError

READY = importlib.util.find_spec("gsplat") is not None and torch.cuda.is_available()


@pytest.mark.skipif(READY, reason="nothing is missing here")
def test_without_a_gpu_it_says_so_in_one_line() -> None:
    with pytest.raises(ModelError, match=r"^bench cuda: .*(gsplat is not installed|no CUDA device)") as caught:
        next(run_cuda([]))
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not READY, reason="no CUDA device here, or gsplat is not installed")
def test_rooms_are_drawn_for_10_and_64_candidates_near_the_oracle() -> None:
    rows = [row for row, _ in zip(run_cuda([], repeats=2), range(4))]
    assert {row.candidates for row in rows} == set(CANDIDATES)
    assert min(row.psnr for row in rows) >= 50


def test_a_row_has_a_cell_for_each_column() -> None:
    row = CudaRow("room", 10_000, 64, "all", (900.0, 1000.0, 1100.0), 60.0, 54.3)
    assert len(row.cells()) == len(CudaRow.HEADER.split(" | "))
    assert "1,000 (900-1,100)" in str(row)
