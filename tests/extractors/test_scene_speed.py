"""The scene extractors are the inner loop: each takes less than a millisecond a frame."""

import time
from collections.abc import Callable, Iterator

import pytest
import torch

from cltransfer.features import Features
from cltransfer.registry import EXTRACTORS
from cltransfer.testing import sample_cameras, sample_subject


def frames(seed: int) -> Features:
    size, batch = (160, 90), 10
    random = torch.Generator().manual_seed(seed)
    depth = torch.rand(batch, 90, 160, generator=random) * 5 + 1
    label = torch.zeros_like(depth)
    label[:, 20:80, 60:100] = 1.0
    camera = sample_cameras(seed, batch, size)
    return Features(size, depth=depth, label=label, subject=label > 0.5, camera=camera, person=sample_subject())


@pytest.fixture
def one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("name", ["scene_joints", "scene_subject", "layers", "scene_flow", "scene_orientation"])
def test_takes_less_than_a_millisecond_a_frame(name: str, within: Callable[[float, float], bool]) -> None:
    extractor, now = EXTRACTORS.build(name), frames(1)
    before = frames(2) if getattr(extractor, "needs_before", False) else None
    extractor(now, before)
    seconds = []
    for _ in range(7):
        start = time.process_time()
        extractor(now, before)
        seconds.append(time.process_time() - start)
    assert within(min(seconds) / len(now), 1e-3)
