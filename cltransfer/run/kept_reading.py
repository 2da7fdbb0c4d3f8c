"""What networks read of a path, as the journal keeps it: places and scores. Maps are scored and then let go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from ..camera import Camera
from ..driver.stage import Stage
from ..errors import InputError
from ..features import Features
from ..pipeline.objective import Objective
from ..pipeline.scores import Scores, Term

TOLD = ("keypoints", "box", "orientation")
PLACES = (*TOLD, "camera")  # of the features of a clip, those that are no maps
FLOATS = {str(kind): kind for kind in (torch.float16, torch.bfloat16, torch.float32, torch.float64)}


@dataclass(frozen=True)
class Read:
    """N frames as they were read.

    Args:
        features: :data:`PLACES` alone.
        names: of all that was read.
        scores: against the reference.
    """

    features: Features
    names: frozenset[str]
    scores: Scores

    @classmethod
    def of(cls, features: Features, scores: Scores) -> Read:
        """What stays of ``features``, maps among them, once they were scored."""
        return cls(features.only(PLACES), features.names(), scores)

    def to_json(self) -> dict[str, Any]:
        """JSON values that tell every number to the bit; who looked is not told."""
        places = {name: _told(self.features.require(name)) for name in TOLD if self.features.has(name)}
        return {
            "size": list(self.features.size),
            "places": places,
            "reasons": dict(self.features.reasons),
            "names": sorted(self.names),
            "terms": [[term.values.tolist(), term.reason] for term in self.scores.terms],
            "totals": self.scores.totals.tolist(),
        }

    @classmethod
    def from_json(cls, told: Any, objective: Objective, count: int) -> Read:
        """What :meth:`to_json` told of ``count`` frames, of the losses of ``objective``.

        Raises:
            ValueError, TypeError, LookupError, AttributeError, ArithmeticError: it is something else.
        """
        width, height = told["size"]
        bare = Features((int(width), int(height)), extras={"frames": torch.zeros(count, 0)})
        places: dict[str, Any] = {name: _tensor(told["places"][name]) for name in TOLD if name in told["places"]}
        features = replace(bare, **places, reasons={str(n): str(reason) for n, reason in told["reasons"].items()})
        terms = [
            Term(name, loss.unit, loss.weight, torch.tensor(values, dtype=torch.float64), str(reason))
            for (name, loss), (values, reason) in zip(objective.losses.items(), told["terms"], strict=True)
        ]
        scores = Scores(tuple(terms), torch.tensor(told["totals"], dtype=torch.float64))
        if len(scores.totals) != count:
            raise ValueError(f"expected {count} frames")
        return cls(features.only(PLACES), frozenset(map(str, told["names"])), scores)


def kept_reading(stage: Stage, cameras: Camera, read: Callable[[], Read]) -> Read:
    """What was ``read`` from N cameras, or what the journal of ``stage`` has of it.

    Raises:
        InputError: the journal has something else.
    """
    if stage.journal is None:
        return read()
    told = stage.journal.document(cameras, lambda: read().to_json())
    try:
        return Read.from_json(told, stage.objective, len(cameras))
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError):
        raise InputError(stage.journal.path, "reading", "is damaged", "start over with another --out") from None


def _told(value: Tensor) -> dict[str, Any]:
    return {"type": str(value.dtype), "values": value.tolist()}


def _tensor(told: Mapping[str, Any]) -> Tensor:
    return torch.tensor(told["values"], dtype=FLOATS[told["type"]])
