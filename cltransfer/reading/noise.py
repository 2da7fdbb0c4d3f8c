"""How much of a total is the networks' jitter, so that nothing below it can be told apart."""

from __future__ import annotations

import torch
from torch import Tensor

from ..along_clip import places
from ..features import Features
from ..pipeline.objective import Objective
from ..pipeline.scores import frame_totals
from .tracks import righted

TOLD = 0.01  # of a total, that nobody sees: less is not told, as what rounding leaves of a reference that stands


def noise_floor(objective: Objective, read: Features, wanted: Features, times: Tensor | None = None) -> float:
    """Total that the networks' jitter makes up: the reference as it was read against itself filtered.

    0 where it was not filtered. Nothing below it can be told apart. A frame read back to front is an error, no jitter,
    as a first or last one that leaps away is, and one that shows nothing tells none.
    """
    at = None if times is None else places(times)
    terms = objective.terms(read if wanted is read else righted(read, times, at), wanted)
    defined = torch.isfinite(terms) & objective.defined(read)
    return float(frame_totals(objective, terms, defined).nanmean().nan_to_num(0.0))


def noise_note(noise: float) -> str:
    """What a reader should know of a total whose reference jitters by ``noise``; empty below :data:`TOLD`."""
    told = "of the total is how the reference, as networks read it, jitters: what differs by less is not told apart"
    return f"up to {noise:.2g} {told}" if noise >= TOLD else ""
