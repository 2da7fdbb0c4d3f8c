"""A plugin that draws what is there already: the Gaussians of a splat scene as points."""

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
from torch import Tensor

from cltransfer.errors import UsageError
from cltransfer.plugins import allow
from cltransfer.registry import RENDERERS
from cltransfer.scenes.builtin import builtin_scene
from cltransfer.shots import builtin_reference
from cltransfer.testing import RendererCase

pytestmark = pytest.mark.usefixtures("forgotten_renderers")
FILE = Path(__file__).resolve().parents[2] / "plugins" / "points.py"
SMALL = ("preset=fast", "frames=2", "search_side=64", "output_side=96")


@pytest.fixture(autouse=True)
def allowed(forgotten_renderers: None) -> None:
    """The plugin is registered during a test and forgotten after it."""
    allow([FILE])


class TestPoints(RendererCase):
    scene = builtin_scene("plaza")
    points = scene.geometry.means

    @pytest.fixture(autouse=True)
    def build(self, allowed: None) -> None:
        self.component = RENDERERS.build("points")


def nearest(*arguments: Any) -> Tensor:
    drawn: Tensor = sys.modules[type(RENDERERS.build("points")).__module__].nearest(*arguments)
    return drawn


def test_of_two_points_in_a_pixel_the_nearer_is_seen_and_no_third_where_none_is() -> None:
    pixels = torch.tensor([[0.5, 0.5], [0.9, 0.1], [2.0, 1.5]])
    assert nearest(pixels, torch.tensor([3.0, 2.0, 1.0]), (4, 2), 1).tolist() == [[1, 3, 3, 3], [3, 3, 2, 3]]
    assert nearest(pixels, torch.tensor([2.0, 3.0, 1.0]), (4, 2), 1).tolist() == [[0, 3, 3, 3], [3, 3, 2, 3]]


def test_a_square_ends_at_the_edge_of_the_frame_and_what_is_beside_it_reaches_in() -> None:
    pixels = torch.tensor([[0.5, 0.5], [4.5, 0.5], [-9.0, 0.5]])
    assert nearest(pixels, torch.ones(3), (4, 3), 3).tolist() == [[0, 0, 3, 1], [0, 0, 3, 1], [3, 3, 3, 3]]
    assert nearest(pixels[:0], torch.ones(0), (2, 1), 3).tolist() == [[0, 0]]


def test_it_sees_what_the_renderer_of_splats_sees() -> None:
    scene, cameras = builtin_scene("plaza"), builtin_reference("push_in", (160, 90), 2)[1].camera
    several = (RENDERERS.build("points", {"side": 3}), RENDERERS.build("gaussian_splats"))
    points, splats = (renderer.render(scene, cameras, renderer.provides) for renderer in several)
    both = points.require("depth").isfinite() & splats.require("depth").isfinite()
    assert float(both.float().mean()) > 0.7
    off = (points.require("depth") / splats.require("depth") - 1).abs()[both]
    assert float(off.median()) < 0.03
    person, other = (f.require("label") > 0.5 for f in (points, splats))
    assert float((person & other).sum() / (person | other).sum()) > 0.8
    assert float((points.require("image") - splats.require("image")).abs().movedim(1, -1)[both].mean()) < 0.1


def test_haze_and_what_is_nearer_than_the_near_plane_are_not_drawn() -> None:
    scene, cameras = builtin_scene("plaza"), builtin_reference("push_in", (160, 90), 1)[1].camera
    hazy = replace(scene, geometry=replace(scene.geometry, opacity=torch.full((len(scene.geometry),), 0.2)))
    for options, drawn in (({}, False), ({"least": 0.2}, True), ({"least": 0.1, "near": 1e6}, False)):
        seen = RENDERERS.build("points", options).render(hazy, cameras, frozenset({"image", "alpha", "depth"}))
        assert bool(seen.require("alpha").any()) == bool(seen.require("image").any()) == drawn
        assert bool(seen.require("depth").isfinite().any()) == drawn


@pytest.mark.parametrize(
    ("option", "line"), [("side=2", "side must be odd"), ("least=2.0", r"least must be in \[0, 1\]")]
)
def test_option_out_of_range_is_refused(option: str, line: str) -> None:
    name, value = option.split("=")
    with pytest.raises(UsageError, match=line):
        RENDERERS.build("points", {name: float(value) if "." in value else int(value)})


def test_the_tutorial_s_search_is_drawn_by_it_and_so_is_the_film(command: Callable[..., Any], tmp_path: Path) -> None:
    text = (FILE.parent / "README.md").read_text(encoding="utf-8")
    here = {"points.py": str(FILE), "scene.ply": "builtin:plaza", "clip.mp4": "builtin:push_in"}
    here["run"] = str(tmp_path / "run")
    lines = re.findall(r"^cltransfer .*--allow-plugin points\.py.*$", text, re.MULTILINE)
    search, film = ([here.get(word, word) for word in shlex.split(line)[1:]] for line in lines)
    done = command(*search, *SMALL)
    assert done.code == 0, done.err
    total = re.search(r"\| total \| ([\d.]+) \|", done.out)
    assert total is not None
    assert float(total[1]) < 1
    assert command(*film, "output_side=128", "--out", tmp_path / "film.mp4").code == 0
    mesh = command(*("builtin:room-3-mesh" if word == "builtin:plaza" else word for word in search), *SMALL)
    told = "room-3-mesh: renderer points: does not draw Mesh (choose: renderer.mesh={})"
    assert (mesh.code, mesh.err.splitlines()[-1]) == (2, f"error: {told}")
