from dataclasses import replace

import pytest
import torch

from cltransfer.pipeline.scores import Scores, Term
from cltransfer.report.data import Flag


def term(name: str, values: list[float], reason: str = "") -> Term:
    return Term(name, "frame", 2.0, torch.tensor(values, dtype=torch.float64), reason)


def test_parts_of_different_lengths_are_refused(report):
    with pytest.raises(ValueError, match="render_frames must have 4 frames like times, got 3"):
        replace(report, render_frames=report.render_frames[:3])
    with pytest.raises(ValueError, match=r"framing must be \(2,\), got \(1,\)"):
        Scores((term("framing", [0.5]),), torch.ones(2))


def test_a_reason_is_told_once_with_its_frames(report):
    flags = [Flag(i, "degenerate") for i in range(4)] + [
        Flag(None, "weakly seen"),
        Flag(3, "hidden"),
        Flag(1, "hidden"),
    ]
    told = replace(report, flags=tuple(flags)).findings
    assert told == ("all 4 frames: degenerate", "weakly seen", "frames 1, 3: hidden")


def test_frames_far_apart_are_counted_rather_than_listed(report):
    many = replace(
        report,
        times=torch.arange(40, dtype=torch.float64),
        scores=Scores((), torch.zeros(40)),
        baseline=None,
        trajectory=None,
        reference_frames=None,
        render_frames=torch.zeros(40, 3, 2, 2, dtype=torch.uint8),
        flags=tuple(Flag(i, "hidden") for i in range(0, 40, 2)),
    )
    assert many.findings == ("frames 0, 2, 4, 6, 8, 10, ... (20 in all): hidden",)


def test_of_a_clip_of_one_frame_that_frame_is_named(report):
    one = replace(
        report,
        times=report.times[:1],
        scores=Scores((), torch.zeros(1)),
        baseline=None,
        trajectory=None,
        reference_frames=None,
        render_frames=report.render_frames[:1],
        flags=(Flag(0, "hidden"),),
    )
    assert one.findings == ("frame 0: hidden",)
