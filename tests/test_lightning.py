"""The loop of one's own that docs/python.md shows: features through a loader, metrics in a LightningModule."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import torch
from pytorch_lightning import Trainer

from cltransfer import camera_language_metrics
from cltransfer.features import Features
from cltransfer.testing import sample_features, without_person

PAGE = Path(__file__).resolve().parents[1] / "docs" / "python.md"
(SNIPPET,) = re.findall(r"```python\n([^`]*LightningModule.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
QUIET = {"logger": False, "enable_checkpointing": False, "enable_progress_bar": False, "enable_model_summary": False}


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_loop_of_the_docs_gives_what_the_metrics_do() -> None:
    references = [sample_features(seed, 1) for seed in range(4)]
    frames = [sample_features(seed + 9, 1) for seed in range(4)]
    frames[2] = without_person(frames[2])
    names: dict[str, Any] = {"references": references, "given": frames}
    exec(SNIPPET, names)
    model = names["Scored"](torch.nn.Identity())
    (logged,) = Trainer(accelerator="cpu", **QUIET).validate(model, names["loader"], verbose=False)
    metrics = camera_language_metrics()
    metrics.update(reference=Features.concatenate(references), rendered=Features.concatenate(frames))
    assert logged == {name: pytest.approx(float(value), rel=1e-5) for name, value in metrics.compute().items()}
    assert logged["framing_coverage"] == 0.75
