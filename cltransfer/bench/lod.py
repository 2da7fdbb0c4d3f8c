"""What merging splats by distance gains and costs: speed, images, depth, the subject's mask, and candidates' ranking.

Everything is compared with the full scene at the same size. A search needs no more of a render than the right order
of its candidates, so that is what is measured beside the images.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from scipy.stats import spearmanr
from torch import Tensor

from ..camera import Camera
from ..errors import InputError
from ..features import Features
from ..renderers.gaussian_splats import GaussianSplats
from ..scenes import Scene
from ..scenes.load import load_scene
from ..scenes.simplify import working_set
from ..storage.files import csv_text, write_text
from .synthetic_room import synthetic_room
from .truth import median

SIZE = (160, 90)
AWAY = 2.0  # steps from the middle of the candidates to what they are after
CANDIDATES = 32
REPEATS = 5  # of what is timed
STEPS = (0.15, 0.03, 0.006)  # of the candidates about the target, subject heights: early, in the middle, late
LEVELS = (0.0, 1.0, 1.5, 2.0, 3.0)  # k; 0 is the full scene
VERTICAL_FOV = np.radians(39.4)
UP = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
RENDERER = GaussianSplats(threads=1)


@dataclass(frozen=True)
class LodRow:
    """One scene at one level of detail; what is compared is compared with the full scene in the same run.

    Args:
        scene: what was rendered.
        k: voxel size [px]; 0 is the full scene.
        gaussians: that are left.
        build: time to merge [s].
        milliseconds: a frame of 160x90, all buffers, one thread, median.
        speedup: median over the full scene's, taken in turn.
        psnr: of the image [dB], median.
        depth_median, depth_p95: error of the expected depth [%].
        mask_area: over the full scene's, median.
        early, middle, late: Spearman's rank correlation with the full scene's order of candidates, by composition (the
            subject's centroid and log area), at each step size; the median over seeds.
        photometric, depth: the same by image and by depth, the least of the three step sizes.
    """

    scene: str
    k: float
    gaussians: int
    build: float
    milliseconds: float
    speedup: float
    psnr: float
    depth_median: float
    depth_p95: float
    mask_area: float
    early: float
    middle: float
    late: float
    photometric: float
    depth: float

    def __str__(self) -> str:
        values = (f"{value:.3g}" if isinstance(value, float) else str(value) for value in asdict(self).values())
        return " ".join(f"{f.name} {value}" for f, value in zip(fields(self), values))


def room_scene(count: int) -> Scene:
    """The synthetic room as a scene."""
    return Scene(synthetic_room(count), None, UP, f"room {count // 1000}k", "0" * 64)


def labelled_scene(path: Path, members: int) -> Scene:
    """Splats of a file whose first ``members`` Gaussians are its subject.

    Raises:
        InputError: the file cannot be read, or has not more Gaussians than that.
    """
    scene = load_scene(path)
    if not 0 < members < len(scene.geometry):
        raise InputError(path, "--members", f"expected 1 to {len(scene.geometry) - 1}, got {members}")
    label = (torch.arange(len(scene.geometry)) < members).float()
    return replace(scene, geometry=scene.geometry.with_label(label))


def run_lod(scenes: Sequence[Scene], seeds: Sequence[int], levels: Sequence[float] = LEVELS) -> Iterator[LodRow]:
    """Rows of every scene and level; each scene needs its subject's labels."""
    for scene in scenes:
        crowds = [[population(scene, step, seed) for seed in seeds] for step in STEPS]
        full = [[_render(scene, crowd) for crowd in row] for row in crowds]
        for k in levels:
            yield _row(scene, k, crowds, full)


def population(scene: Scene, step: float, seed: int) -> Camera:
    """Candidates about a view of the subject from two heights away, (1 + CANDIDATES,); steps in subject heights.

    The first one is what the others are after, AWAY steps from their middle.
    """
    body = scene.geometry.means[scene.geometry.label > 0.5].double()
    middle = body.median(0).values
    low, high = (body @ scene.up).quantile(torch.tensor([0.01, 0.99], dtype=torch.float64))
    height = float(high - low)
    rng = np.random.Generator(np.random.PCG64([seed, round(step * 1e4)]))
    aside = scene.up.roll(1)
    outward = 0.8 * aside + 0.6 * torch.linalg.cross(scene.up, aside) + 0.2 * scene.up
    moves = torch.from_numpy(rng.normal(size=(2, 1 + CANDIDATES, 3)))  # of the eye and of what it looks at
    moves[:, 0] *= AWAY / moves[:, 0].norm(dim=1, keepdim=True)
    eyes = middle + height * (2 * outward + step * moves[0])
    return Camera.look_at(eyes, middle + height * step * moves[1], scene.up, VERTICAL_FOV, SIZE)


def scores(candidates: Features, target: Features) -> Tensor:
    """Distance of B candidates from one target by composition, image and depth, (3, B)."""
    place, area = composition(candidates)
    wanted_place, wanted_area = composition(target)
    composed = (place - wanted_place).norm(dim=1) + (area / wanted_area).log().abs()
    image = (candidates.require("image") - target.require("image")).square().mean((1, 2, 3))
    depth = (candidates.require("expected_depth") / target.require("expected_depth")).log().abs().nanmean((1, 2))
    return torch.stack([composed, image, depth])


def composition(features: Features) -> tuple[Tensor, Tensor]:
    """Centroid (B, 2) and area (B,) of the subject, as shares of the frame."""
    label = features.require("label").double()
    width, height = features.size
    x, y = (torch.arange(width) + 0.5) / width, (torch.arange(height) + 0.5) / height
    total = label.sum((1, 2))
    centroid = torch.stack([(label * x).sum((1, 2)), (label * y[:, None]).sum((1, 2))], dim=1) / total[:, None]
    return centroid, total / (width * height)


def _render(scene: Scene, cameras: Camera) -> Features:
    return RENDERER.render(scene, cameras, RENDERER.provides)


def _row(scene: Scene, k: float, crowds: list[list[Camera]], full: list[list[Features]]) -> LodRow:
    start = time.perf_counter()
    small = working_set(scene, population(scene, 0.0, 0)[0], k) if k else scene
    build = time.perf_counter() - start
    ranks = np.array([
        np.median([_ranking(_render(small, crowd), known) for crowd, known in zip(*row)], axis=0)
        for row in zip(crowds, full)
    ])  # (steps, 3)  # fmt: skip
    seen = crowds[0][0][:8]
    times, full_times = _in_turn(small, scene, seen)
    few, whole = _render(small, seen), full[0][0][:8]
    error = (few.require("image") - whole.require("image")).square().mean((1, 2, 3))
    depth = 100 * (few.require("expected_depth") / whole.require("expected_depth") - 1).abs()
    depth = depth[depth.isfinite()]
    area = composition(few)[1] / composition(whole)[1]
    return LodRow(
        scene=scene.name,
        k=k,
        gaussians=len(small.geometry),
        build=build if k else 0.0,
        milliseconds=statistics.median(times),
        speedup=statistics.median(full_times) / statistics.median(times),
        psnr=median(-10 * error.log10()),
        depth_median=median(depth),
        depth_p95=float(np.percentile(depth.numpy(), 95)),
        mask_area=median(area),
        early=float(ranks[0, 0]),
        middle=float(ranks[1, 0]),
        late=float(ranks[2, 0]),
        photometric=float(ranks[:, 1].min()),
        depth=float(ranks[:, 2].min()),
    )


def _in_turn(small: Scene, full: Scene, cameras: Camera) -> tuple[list[float], list[float]]:
    """Processor time of both, in turn [ms a frame]; the first of each packs and is not counted."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(REPEATS + 1):
        for scene, kept in zip((small, full), times):
            start = time.thread_time()
            _render(scene, cameras)
            kept.append((time.thread_time() - start) / len(cameras) * 1e3)
    return times[0][1:], times[1][1:]


def _ranking(few: Features, whole: Features) -> list[float]:
    """Spearman's correlation of both orders of candidates 1.. by each score; what they are after is the full one's."""
    target = whole[0]
    found, known = (scores(features[1:], target) for features in (few, whole))
    return [float(spearmanr(a.numpy(), b.numpy()).statistic) for a, b in zip(found, known)]


def write_csv(rows: Sequence[LodRow], path: Path) -> None:
    """Write the rows as CSV."""
    write_text(path, csv_text([[f.name for f in fields(LodRow)], *(asdict(row).values() for row in rows)], 5))
