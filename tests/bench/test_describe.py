"""The bench of descriptions: what it is asked."""

from typing import cast

import pytest

from cltransfer.bench.describe import SCENES, run_describe
from cltransfer.pipeline.components import Components


def test_a_seed_that_is_named_twice_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cltransfer.bench.describe._clips", lambda scene, seed, size: ())
    told: list[str] = []
    run_describe([1, 1, 2], ["geometry"], cast(Components, None), told.append)
    assert told == [f"seed {seed}, {name}, geometry" for seed in (1, 2) for name in SCENES]
