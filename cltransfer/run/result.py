"""What a transfer found: cameras, what they show, how they were found and at what cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from torch import Tensor

from ..driver.schedule import Schedule
from ..driver.stage import Spent
from ..pipeline.objective import Objective
from ..pipeline.plan import Family
from ..pipeline.scores import Scores
from ..reading.depth_alignment import DepthAlignment
from ..reading.reference import Reference
from ..scenes import Scene
from ..trajectory import Trajectory
from .rounds import Attempt


@dataclass(frozen=True)
class Result:
    """What a transfer found.

    Args:
        scene, reference: what it was given, read.
        trajectory: N cameras at the output size.
        attempts: every round, the first uncorrected.
        best: index of the round with the lowest total, the one that is kept.
        searched: the score in the search, by the inner extractors at the search size, of the cleaned reference.
        held: the score of the first view held still; None where it cannot be read as the result is.
        search: vectors to cameras.
        renderer: what drew the scene.
        objective: the losses.
        schedule: how frames were searched.
        note: why there were fewer rounds than the config asks for; empty where there were not, and where geometry read
            the reference, so that there is no bias to correct.
        noise: total that cannot be told apart, because networks read both sides; 0 where geometry did.
        family: which extractors read the result: image (networks) or scene (geometry, as of ``extract.verify=false``).
        spent: what it cost.
        seconds: by step.
        alignment: of the depth network, where the scene told it.
        floaters: Gaussians that hang in the air by themselves; 0 where the config keeps them.
        header: what it depends on, as the journal of the run is headed: contents of networks, files and code by name.
    """

    scene: Scene
    reference: Reference
    trajectory: Trajectory
    attempts: tuple[Attempt, ...]
    best: int
    searched: Scores
    held: Scores | None
    search: Any
    renderer: Any
    objective: Objective
    schedule: Schedule
    note: str
    noise: float
    family: Family
    spent: Spent
    seconds: dict[str, float]
    alignment: DepthAlignment | None = None
    floaters: int = 0
    header: Mapping[str, Any] = field(default_factory=dict)

    @property
    def kept(self) -> Attempt:
        """The round that is kept."""
        return self.attempts[self.best]

    @property
    def lasts(self) -> bool:
        """Whether another run tells no more of either side: what one round had to do without led those after it."""
        sides = (self.reference.features, *(attempt.shown.features for attempt in self.attempts))
        return all(side.lasts for side in sides)

    @property
    def verified(self) -> Scores:
        """The score of the rendered frames as they are kept; it is what the run reports."""
        return self.kept.shown.scores

    @property
    def image(self) -> Tensor:
        """The rendered frames, (N, 3, H, W) uint8."""
        return self.kept.shown.image
