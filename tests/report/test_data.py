from dataclasses import replace

import pytest
import torch

from cltransfer.scores import Scores, Term


def term(name: str, values: list[float], reason: str = "") -> Term:
    return Term(name, "frame", 2.0, torch.tensor(values, dtype=torch.float64), reason)


def test_parts_of_different_lengths_are_refused(report):
    with pytest.raises(ValueError, match="render_frames must have 4 frames like times, got 3"):
        replace(report, render_frames=report.render_frames[:3])
    with pytest.raises(ValueError, match=r"framing must be \(2,\), got \(1,\)"):
        Scores((term("framing", [0.5]),), torch.ones(2))
