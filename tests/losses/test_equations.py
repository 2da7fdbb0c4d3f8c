"""Faithful mode is the paper's text: each loss against Eq. 3-14 written in plain loops."""

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
import torch

from cltransfer.features import Features
from cltransfer.registry import LOSSES
from cltransfer.skeleton import key_joints
from cltransfer.testing import sample_features


def _load() -> ModuleType:
    path = Path(__file__).resolve().parents[1] / "reference" / "equations.py"
    spec = importlib.util.spec_from_file_location("equations", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


equations = _load()


def random_features(seed: int, size: tuple[int, int] = (24, 14)) -> Features:
    """Two frames of a small random world: any joint may be unseen or out of the frame, layers overlap by chance."""
    random = torch.Generator().manual_seed(seed)
    width, height = size
    joints = torch.rand(2, 14, 3, generator=random) * torch.tensor([1.4 * width, 1.4 * height, 1.0])
    joints[..., 2] = joints[..., 2].sqrt()  # midpoints take the smaller of two confidences
    label = torch.randint(0, 3, (2, height, width), generator=random)
    return replace(
        sample_features(seed, 2),
        size=(width, height),
        keypoints=joints.double(),
        depth=(torch.randn(2, height, width, generator=random) * 0.2 + label).exp(),
        layers=torch.stack([label == k for k in range(3)], dim=1),
        flow=torch.randn(2, 2, height, width, generator=random),
        orientation=torch.rand(2, 3, generator=random) * 8 - 4,
    )


def literal(name: str, reference: Features, rendered: Features, i: int) -> float:
    """Loss ``name`` of frame ``i`` by the loops."""
    if name in ("shot_size", "framing"):
        joints = [key_joints(f.keypoints)[i].tolist() for f in (reference, rendered)]
        return getattr(equations, name)(joints[0], reference.size, joints[1], rendered.size)
    if name == "camera_angle":
        return equations.camera_angle(reference.orientation[i].tolist(), rendered.orientation[i].tolist())
    field = "depth" if name == "filmic_space" else "flow"
    maps = [getattr(f, field)[i] for f in (reference, rendered)]
    maps = [m if field == "depth" else m.permute(1, 2, 0) for m in maps]
    layers = [f.layers[i].tolist() for f in (reference, rendered)]
    return getattr(equations, name)(maps[0].tolist(), layers[0], maps[1].tolist(), layers[1])


def check(name: str, reference: Features, rendered: Features) -> None:
    """Two frames of loss ``name``, against the loops."""
    got = LOSSES.build(name, {"mode": "faithful"})(reference, rendered)
    expected = torch.tensor([literal(name, reference, rendered, i) for i in range(2)], dtype=torch.float64)
    tolerance = 0.01 if name == "filmic_space" else 1e-5  # 256 bins against a grid of 1000
    torch.testing.assert_close(got.double(), expected, atol=tolerance, rtol=tolerance, equal_nan=True)


@pytest.mark.parametrize("size", [(36, 21), (14, 24)])  # of the same shape as the other side's, and of another
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", ["shot_size", "framing", "filmic_space"])
def test_faithful_mode_is_the_equation_where_frames_are_of_unlike_sizes(
    name: str, seed: int, size: tuple[int, int]
) -> None:
    for sides in ((size, (24, 14)), ((24, 14), size)):
        check(name, *(random_features(2 * seed + i, side) for i, side in enumerate(sides)))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", ["shot_size", "framing", "filmic_space", "camera_movement", "camera_angle"])
def test_faithful_mode_is_the_equation(name: str, seed: int) -> None:
    check(name, random_features(2 * seed), random_features(2 * seed + 1))


@pytest.mark.parametrize("emptied", [(0,), (2,), (0, 2)])
def test_faithful_space_skips_what_is_empty(emptied: tuple[int, ...]) -> None:
    reference, rendered = random_features(1), random_features(2)
    rendered.layers[:, list(emptied)] = False
    got = LOSSES.build("filmic_space", {"mode": "faithful"})(reference, rendered)
    expected = torch.tensor([literal("filmic_space", reference, rendered, i) for i in range(2)])
    torch.testing.assert_close(got.float(), expected, atol=0.01, rtol=0.01, equal_nan=True)
    assert bool(got.isnan().all()) == (len(emptied) == 2)
