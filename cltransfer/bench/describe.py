"""How often a description is right on clips whose shot size and movement are known because code made them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..camera import Camera
from ..describe.flow_motion import flow_motion
from ..describe.movement import movement
from ..describe.shot_scale import BOUNDS, LEAST_FILLED, SCALES, scale_class, shot_scale
from ..features import Features
from ..pipeline.components import SCENE_SOURCE, Components
from ..pipeline.graph import run_clip
from ..reading.frames import clip_features
from ..scenes import Scene
from ..scenes.builtin import builtin_scene
from ..shots import SHOTS, Setup, shot
from ..subject import Subject
from ..trajectory import Trajectory
from .pages import SECTIONS
from .section import machine, table, write_section

SCENES = ("courtyard", "plaza")
FRAMES, FRAMED_FRAMES = 24, 3
SIZES = {"geometry": (160, 90), "networks": (480, 270)}
NAMES = {  # canonical shot -> the words for it
    "push_in": "push in", "pull_out": "pull out", "pan": "pan right", "tilt": "tilt up", "orbit": "orbit right",
    "zoom": "zoom in", "crash_zoom": "crash zoom", "dolly_zoom": "dolly zoom", "dutch": "roll counterclockwise",
    "boom": "boom up", "truck": "truck right", "static": "static", "handheld": "handheld",
}  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """One clip, or one frame, and what was said of it.

    Args:
        what: movement or scale.
        reader: geometry or networks.
        scene, seed: where.
        truth, said: words; ``said`` is "nothing" where nothing could be said.
    """

    what: str
    reader: str
    scene: str
    seed: int
    truth: str
    said: str


def run_describe(
    seeds: Sequence[int], readers: Sequence[str], parts: Components, done: Callable[[str], None]
) -> list[Answer]:
    """Describe every canonical shot and every shot size in both built-in scenes.

    Args:
        seeds: of where the cameras stand; one named twice counts once.
        readers: geometry (scene extractors) and networks (image extractors on renders).
        parts: of a config.
        done: told what was finished.
    """
    answers: list[Answer] = []
    for seed in dict.fromkeys(seeds):
        for name in SCENES:
            scene = builtin_scene(name)
            for reader in readers:
                for label, path in _clips(scene, seed, SIZES[reader]):
                    features = _read(scene, path, reader, parts)
                    answers += _answers(label, path, features, scene, Answer("", reader, name, seed, "", ""))
                done(f"seed {seed}, {name}, {reader}")
    return answers


def _answers(label: str, path: Trajectory, features: Features, scene: Scene, at: Answer) -> Iterator[Answer]:
    where = (at.reader, at.scene, at.seed)
    if label in NAMES:
        yield Answer("movement", *where, NAMES[label], movement(flow_motion(features, path.times)).name or "nothing")
    truth = true_scale(path.camera, scene.person)
    for i, j in zip(truth.tolist(), shot_scale(features).tolist()):
        yield Answer("scale", *where, SCALES[i], SCALES[j] if j >= 0 else "nothing")


def _clips(scene: Scene, seed: int, size: tuple[int, int]) -> Iterator[tuple[str, Trajectory]]:
    """Canonical shots from a place of their own, then one still clip of each shot size."""
    random = torch.Generator().manual_seed(seed)
    for name in SHOTS:
        yield name, shot(name, scene.person, size, FRAMES, setup=_setup(random, seed))
    for scale in SCALES:
        yield scale, shot("static", scene.person, size, FRAMED_FRAMES, setup=framed(scale, random, seed))


def _setup(random: torch.Generator, seed: int) -> Setup:
    azimuth, elevation, right, down = torch.rand(4, generator=random, dtype=torch.float64).tolist()
    return Setup(
        math.radians(120 * azimuth - 60),
        math.radians(25 * elevation - 5),
        offset=(0.3 * right - 0.15, 0.1 * down - 0.05),
        seed=seed,
    )


def framed(scale: str, random: torch.Generator, seed: int) -> Setup:
    """A setup that frames a standing person in ``scale``: with some headroom, cut where the class says."""
    place, headroom, right, azimuth = torch.rand(4, generator=random, dtype=torch.float64).tolist()
    headroom = 0.03 + 0.09 * headroom
    index = SCALES.index(scale)
    if scale == "ELS":
        coverage = 0.12 + 0.1 * place  # of the frame
        top = 0.7 - coverage
    elif scale == "LS":
        coverage = 0.3 + 0.5 * place
        top = max(headroom, 0.9 - coverage)
    else:
        low = 0.06 if index == 0 else BOUNDS[index - 1]
        cut = low + (0.1 + 0.8 * place) * (BOUNDS[index] - low)  # [body heights]
        coverage, top = (1 - headroom) / cut, headroom
    middle = top + 0.48 * coverage  # the head is at the top, the middle of the key joints lies here
    offset = (0.2 * right - 0.1, middle - 0.5)
    return Setup(math.radians(80 * azimuth - 40), 0.0, distance=3.0, coverage=coverage, offset=offset, seed=seed)


def true_scale(camera: Camera, subject: Subject) -> Tensor:
    """Class (N,) of what the frame really holds of a body that stands from its head top straight down."""
    head = subject.joints[12]
    part = torch.linspace(0, 1, 201, dtype=torch.float64)
    line = head - part[:, None] * subject.height * subject.up
    pixels, _ = camera.project(line)
    inside = ((pixels[..., 1] >= 0) & (pixels[..., 1] <= camera.size[1])).double().mean(1)
    length = (pixels[:, -1] - pixels[:, 0]).norm(dim=1)
    return scale_class(torch.maximum(inside, LEAST_FILLED * camera.size[1] / length))


def _read(scene: Scene, path: Trajectory, reader: str, parts: Components) -> Features:
    if reader == "networks":
        from ..run.readback import render_frames

        return clip_features(render_frames(scene, parts, path.camera), parts.plan("image"))
    plan = parts.plan("scene")
    buffers = plan.buffers - SCENE_SOURCE
    return run_clip(plan, lambda a, b: parts.renderer.render(scene, path.camera[a:b], buffers), len(path))


def accuracy(answers: Sequence[Answer]) -> list[list[str]]:
    """Rows of what, reader, right, of, the share [%], and how many were not told."""
    rows = []
    for what, reader in dict.fromkeys((a.what, a.reader) for a in answers):
        own = [a for a in answers if (a.what, a.reader) == (what, reader)]
        right = sum(a.truth == a.said for a in own)
        silent = sum(a.said == "nothing" for a in own)
        rows.append([what, reader, str(right), str(len(own)), f"{100 * right / len(own):.1f}", str(silent)])
    return rows


def confusion(answers: Sequence[Answer], order: Sequence[str]) -> list[str]:
    """Lines of a Markdown matrix: a row for each truth, a column for each thing said."""
    count = Counter((a.truth, a.said) for a in answers)
    said = [w for w in order if any(a.said == w for a in answers)]
    said += sorted({a.said for a in answers} - set(said))
    truths = [w for w in order if any(a.truth == w for a in answers)]
    rows = [[truth, *(str(count[truth, word] or "") for word in said)] for truth in truths]
    return table(["truth, said", *said], rows)


def report_lines(answers: Sequence[Answer]) -> list[str]:
    """The accuracy, then each confusion matrix."""
    lines = table(["what", "reader", "right", "of", "%", "not told"], accuracy(answers))
    for what, order in (("movement", tuple(NAMES.values())), ("scale", SCALES)):
        for reader in dict.fromkeys(a.reader for a in answers):
            own = [a for a in answers if (a.what, a.reader) == (what, reader)]
            lines += ["", f"{what}, read by {reader}:", "", *confusion(own, order)]
    return lines


def write_describe(answers: Sequence[Answer], path: Path, command: str) -> None:
    """Rewrite the description section of the Markdown file ``path``."""
    lines = [
        f"Made by `{command}`. Movement is judged a clip, shot size a frame; the cameras stand where the seed says.",
        *machine(),
        "",
        *report_lines(answers),
    ]
    write_section(path, SECTIONS["describe"], lines)
