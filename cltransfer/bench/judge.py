"""The judge: one reading and one set of losses for every method, whatever it searched by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..driver.stage import Stage, read_path
from ..features import Features
from ..pipeline.components import Components
from ..pipeline.objective import Objective
from ..scenes import Scene
from ..search.subject_orbit import SCALE, SubjectOrbit
from .failure import Shown, cover, failed_frames
from .methods import judge_config
from .truth import median

SIDE = 240  # longer side of the judged frames [px]; no method searches at it
NETWORK_SIDE = 640
RANDOM_VIEWS = 48
# readings by extractors that no method's objective has: pixels instead of the scene's geometry
HELD_OUT = {
    "dis_flow": ("extractors.scene_flow=null", "losses.shot_size=null", "losses.framing=null",
                 "losses.filmic_space=null", "losses.camera_angle=null"),
    "networks": ("extractors.scene_flow=null", "extractors.scene_joints=null", "extractors.scene_orientation=null",
                 "losses.filmic_space=null", "losses.camera_movement=null"),
}  # fmt: skip


@dataclass(frozen=True)
class Reader:
    """How takes are read and scored.

    Args:
        parts: of the judge's config.
        size: (W, H) of the frames [px].
    """

    parts: Components
    size: tuple[int, int]

    @classmethod
    def of(cls, scene: str, overrides: tuple[str, ...] = (), side: int = SIDE) -> Reader:
        """A reader of takes in the built-in scene called ``scene``, in frames of 16:9 that are ``side`` wide [px]."""
        return cls(Components.build(judge_config(scene, overrides)), (side, round(side * 9 / 16)))

    @property
    def objective(self) -> Objective:
        """Eq. 15 with the reader's losses."""
        return self.parts.objective

    def stage(self, scene: Scene, shared: frozenset[str] | None = None) -> Stage:
        """The stage of a scene; ``shared`` names the features of the side that was read before."""
        return Stage(scene, self.parts.renderer, self.parts.plan("scene", shared), self.objective, self.size)

    def read(self, scene: Scene, cameras: Camera, shared: frozenset[str] | None = None) -> Features:
        """Features of N frames."""
        return read_path(self.stage(scene, shared), cameras)

    def shown(self, scene: Scene, cameras: Camera, features: Features) -> Shown:
        """What else tells whether frames have failed."""
        seen = self._drawn(scene, cameras, frozenset({"alpha", "label", "depth"}))
        alpha, label, depth = (
            torch.cat([getattr(frame, name) for frame in seen]) for name in ("alpha", "label", "depth")
        )
        return Shown(features, alpha, label, depth, scene.person.height)

    def cover(self, scene: Scene, cameras: Camera) -> Tensor:
        """Share of each frame that the scene covers, (N,)."""
        return torch.cat([cover(frame.require("alpha")) for frame in self._drawn(scene, cameras, frozenset({"alpha"}))])

    def _drawn(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> list[Features]:
        """Buffers of one frame after the other."""
        small = cameras.at_size(self.size)
        return [self.parts.renderer.render(scene, small[i], buffers) for i in range(len(small))]


@dataclass(frozen=True)
class Verdict:
    """Terms of N frames by one reader.

    Args:
        names: of the losses.
        terms: raw, (N, L); NaN where undefined.
        priced: with the penalty where only the render lacks a term, NaN where the reference does, (N, L).
        totals: Eq. 15, (N,).
    """

    names: tuple[str, ...]
    terms: Tensor  # (N, L)
    priced: Tensor  # (N, L)
    totals: Tensor  # (N,)


def judge(objective: Objective, reference: Features, rendered: Features) -> Verdict:
    """Score N rendered frames against N reference frames."""
    terms, defined = objective.terms(reference, rendered), objective.defined(reference)
    return Verdict(objective.names, terms, objective.priced(terms, defined), objective.totals(terms, defined))


def judge_take(
    reader: Reader, reference: Features, rendered: Features, scene: Scene, cameras: Camera, true: Camera, pinned: Tensor
) -> tuple[Verdict, Mapping[str, Tensor], Tensor]:
    """The verdict on N cameras, the frames that have failed by reason, and those that have by any, (N,) bool.

    Args:
        reader: that read both sides.
        reference: what was to be met, N frames.
        rendered: what the cameras see.
        scene: where they stand.
        cameras: that were found.
        true: those that would have been.
        pinned: frames with a parameter at its bound, (N,) bool.
    """
    verdict = judge(reader.objective, reference, rendered)
    finite = torch.isfinite(cameras.w2c).flatten(1).all(1) & torch.isfinite(verdict.totals)
    shown, covered = reader.shown(scene, cameras, rendered), reader.cover(scene, true)
    reasons = failed_frames(reference, shown, covered, finite, pinned)
    return verdict, reasons, torch.stack(list(reasons.values())).any(0)


def random_total(reader: Reader, reference: Features, scene: Scene, seed: int) -> float:
    """Median over random views of the mean total they have when they are held for the whole clip.

    All round the subject, 10 degrees below to 45 above, 1 to 8 subject heights away, the subject's middle in the frame
    and 0.2 to 2 frame heights tall.
    """
    rng = np.random.Generator(np.random.PCG64([seed, RANDOM_VIEWS]))
    low = [-np.pi, np.radians(-10), 0.0, np.log(1.0), -0.4, -0.4, np.log(0.2)]
    high = [np.pi, np.radians(45), 0.0, np.log(8.0), 0.4, 0.4, np.log(2.0)]
    x = torch.from_numpy(rng.uniform(low, high, (RANDOM_VIEWS, 7)))
    stage = reader.stage(scene, reference.names())
    person = scene.person
    home = Camera.look_at(person.anchor + person.facing[None], person.anchor, scene.up, 0.7, stage.size)
    views = SubjectOrbit().cameras(x / SCALE, home, person)
    held = Features.concatenate([_standing(stage.features(views[i], None)) for i in range(len(views))])
    defined = reader.objective.defined(reference)
    totals = [
        reader.objective.totals(reader.objective.terms(reference[i], held), defined[i]) for i in range(len(reference))
    ]
    return median(torch.stack(totals).mean(0))


def _standing(frame: Features) -> Features:
    """A frame as a camera that stands still sees it again: nothing flows."""
    return replace(frame, image=None, flow=torch.zeros_like(frame.require("flow")))
