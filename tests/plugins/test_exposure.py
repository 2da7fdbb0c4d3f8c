"""A plugin of two components that reads pixels: an extractor with a feature of its own, and a loss on that."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from cltransfer.config import load_config
from cltransfer.errors import UsageError
from cltransfer.features import Features
from cltransfer.pipeline.objective import Objective
from cltransfer.plugins import allow
from cltransfer.registry import EXTRACTORS, LOSSES
from cltransfer.testing import ExtractorCase, LossCase, sample_features, without_person

FILE = Path(__file__).resolve().parents[2] / "plugins" / "exposure.py"
SMALL = ("preset=fast", "frames=2", "search_side=64", "output_side=96")


@pytest.fixture(autouse=True)
def allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plugin is registered during a test and forgotten after it."""
    for registry in (EXTRACTORS, LOSSES):
        monkeypatch.setitem(registry._classes, "exposure", object)  # to be as it was, and nothing else with it
        del registry._classes["exposure"]
    allow([FILE])


class TestReadExposure(ExtractorCase):
    @pytest.fixture(autouse=True)
    def build(self, allowed: None) -> None:
        self.component = EXTRACTORS.build("exposure")


class TestExposure(LossCase):
    @pytest.fixture(autouse=True)
    def build(self, allowed: None) -> None:
        self.component = LOSSES.build("exposure")

    def sample(self, seed: int, batch: int) -> Features:
        stops = torch.rand(batch, generator=torch.Generator().manual_seed(seed))
        return sample_features(seed, batch).having("exposure", stops)


def lit(person: float, rest: float, batch: int = 1) -> Features:
    """Frames in which the person has one linear luminance and all else another."""
    features = sample_features(0, batch)
    linear = torch.where(features.require("subject"), person, rest)[:, None].expand(-1, 3, -1, -1)
    return replace(
        features, image=torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    )


def read(features: Features, **options: float) -> list[float]:
    stops = EXTRACTORS.build("exposure", options)(features, None).require("exposure")
    return [round(float(value), 3) for value in stops]


def test_twice_the_light_is_one_stop() -> None:
    assert read(lit(0.4, 0.2), black=1e-6) == [1.0]
    assert read(lit(0.1, 0.8, batch=2), black=1e-6) == [-3.0, -3.0]
    assert read(lit(0.29, 0.09)) == [round(float(torch.tensor(3.0).log2()), 3)]


def test_black_is_no_infinity_and_counts_as_no_more_than_a_silhouette() -> None:
    assert read(lit(0.15, 0.0)) == [4.0]
    assert read(lit(0.0, 1.0)) == [-4.0]
    assert read(lit(0.0, 0.0)) == [0.0]


def test_where_nobody_is_seen_or_nothing_else_it_is_undefined() -> None:
    alone = sample_features(0, 1)
    alone = replace(alone, subject=torch.ones_like(alone.require("subject")))
    stops = [
        EXTRACTORS.build("exposure")(f, None) for f in (without_person(sample_features(0, 1)), alone, lit(0.4, 0.2))
    ]
    assert [bool(f.require("exposure").isnan()) for f in stops] == [True, True, False]
    loss = LOSSES.build("exposure")
    assert [bool(loss(f, stops[2]).isnan()) for f in stops] == [bool(loss(stops[2], f).isnan()) for f in stops]
    assert [bool(loss(f, stops[2]).isnan()) for f in stops] == [True, True, False]


def test_a_mask_of_fewer_pixels_is_laid_over_the_image() -> None:
    features = lit(0.4, 0.2)
    fine = replace(features, image=features.require("image").repeat_interleave(2, 2).repeat_interleave(2, 3))
    assert read(fine, black=1e-6) == [1.0]


def test_the_residual_is_the_square_with_the_sign_of_the_difference() -> None:
    darker, brighter = (sample_features(0, 1).having("exposure", torch.tensor([v])) for v in (-0.5, 1.0))
    loss = LOSSES.build("exposure")
    assert loss.residuals(darker, brighter).tolist() == [[2.25]]
    assert loss.residuals(brighter, darker).tolist() == [[-2.25]]
    most = sys.modules[type(loss).__module__].MOST
    assert (
        float(loss(*(sample_features(0, 1).having("exposure", torch.tensor([v])) for v in (most, -most))))
        == loss.penalty
    )


def test_it_is_refined_with_the_others() -> None:
    losses = load_config(overrides=["losses.exposure={}", "extractors.exposure={}"]).build("losses")
    assert Objective(losses).groups is not None


def test_option_out_of_range_is_refused() -> None:
    with pytest.raises(UsageError, match=r"black must be in \(0, 1\), got 0"):
        EXTRACTORS.build("exposure", {"black": 0.0})


def commands() -> list[list[str]]:
    """What the tutorial says to type, with what is there in place of what its reader has."""
    text = (FILE.parent / "README.md").read_text(encoding="utf-8")
    here = {"exposure.py": str(FILE), "scene.ply": "builtin:plaza", "clip.mp4": "builtin:push_in"}
    lines = re.findall(r"^cltransfer .*--allow-plugin exposure\.py.*$", text, re.MULTILINE)
    return [[here.get(word, word) for word in shlex.split(line, comments=True)[1:]] for line in lines]


def test_the_tutorial_s_search_is_by_pixels_too(command: Callable[..., Any], tmp_path: Path) -> None:
    search, *_ = commands()
    done = command(*search, "--out", tmp_path / "run", *SMALL)
    assert done.code == 0, done.err
    assert re.search(r"\| exposure \| [\d.e-]+ \| stops\^2 \| .* \| 2/2 \|", done.out)
    assert "CMA-ES alone" not in done.out


def test_the_tutorial_shows_either_component_by_its_key(command: Callable[..., Any]) -> None:
    _, show = commands()
    assert "requires: image, subject" in command(*show).out


def test_a_run_without_the_extractor_tells_which_to_name(command: Callable[..., Any], tmp_path: Path) -> None:
    search = [word for word in commands()[0] if not word.startswith("extractors.")]
    done = command(*search, "--out", tmp_path / "run", *SMALL)
    assert "note: exposure: no scene extractor provides 'exposure' (extractors.exposure={} does)\n" in done.out
