"""The subject's pixels from labels."""

import pytest
import torch

from cltransfer.extractors.scene_subject import SceneSubject
from cltransfer.features import Features

LABEL = torch.tensor([[[0.0, 0.3, 0.5, 0.51, 1.0]]])


@pytest.mark.parametrize(("threshold", "count"), [(0.5, 2), (0.2, 4), (0.0, 4)])
def test_subject_is_where_the_label_exceeds_the_threshold(threshold: float, count: int) -> None:
    subject = SceneSubject(threshold)(Features((5, 1), label=LABEL), None).subject
    assert subject.dtype == torch.bool
    assert int(subject.sum()) == count


def test_threshold_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"threshold must be in \[0, 1\), got 1"):
        SceneSubject(1.0)
