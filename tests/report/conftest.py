import pytest
import torch

from cltransfer.camera import Camera
from cltransfer.pipeline.scores import Scores, Term
from cltransfer.report.data import Flag, ReportData
from cltransfer.subject import Subject
from cltransfer.trajectory import Trajectory

NAN = float("nan")


def term(name: str, values: list[float], weight: float = 2.0, reason: str = "") -> Term:
    return Term(name, "frame", weight, torch.tensor(values, dtype=torch.float64), reason)


def scores(first: list[float], second: list[float]) -> Scores:
    terms = (term("shot_size", first), term("camera_movement", second, 3.0, "no frame before the first"))
    totals = sum(torch.nan_to_num(t.values) * t.weight for t in terms)
    assert isinstance(totals, torch.Tensor)
    return Scores(terms, totals)


@pytest.fixture
def report() -> ReportData:
    eye = torch.tensor([[3.0, 0.5, 1.0], [3.5, 0.4, 1.0], [4.0, 0.3, 1.0], [5.0, 0.2, 1.0]], dtype=torch.float64)
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    times = torch.arange(4, dtype=torch.float64) / 8
    joints = torch.zeros(14, 3, dtype=torch.float64)
    joints[12, 2] = 1.7
    subject = Subject(joints, torch.ones(14).double(), torch.tensor([1.0, 0, 0]).double(), up, 1.7)
    generator = torch.Generator().manual_seed(0)
    return ReportData(
        title="dolly_zoom → courtyard",
        times=times,
        scores=scores([0.01, 0.02, 0.03, 0.02], [NAN, 0.1, 0.2, 0.3]),
        baseline=scores([0.1, 0.2, 0.3, 0.2], [NAN, 1.0, 1.0, 1.0]),
        trajectory=Trajectory(Camera.look_at(eye, torch.zeros(1, 3), up, 0.6, (64, 36)), times),
        subject=subject,
        reference_frames=torch.randint(0, 255, (4, 3, 36, 64), dtype=torch.uint8, generator=generator),
        render_frames=torch.randint(0, 255, (4, 3, 18, 32), dtype=torch.uint8, generator=generator),
        flags=(Flag(0, "camera_movement is undefined"), Flag(None, "focal length is weakly seen")),
        spent={"renders": 40, "seconds": 1.5, "stopped": "patience", "rate": NAN},
        command="cltransfer transfer a b seed=0",
    )
