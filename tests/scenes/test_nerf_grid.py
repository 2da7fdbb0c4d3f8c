from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from cltransfer.computer import memory
from cltransfer.errors import InputError, ResourceError
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.nerf_grid import FORMAT, NerfGrid, read_grid, write_grid


def small_grid(degree: int = 1) -> NerfGrid:
    random = torch.Generator().manual_seed(0)
    density = (torch.rand(3, 4, 5, generator=random) * 4 - 2).clamp(min=0)
    sh = torch.randn(3, 4, 5, (degree + 1) ** 2, 3, generator=random)
    aabb = torch.tensor([[-1.0, 0, 2], [3, 6, 8]], dtype=torch.float64)
    return NerfGrid(density, sh, torch.rand(3, 4, 5, generator=random), aabb)


def tensors(**changes: torch.Tensor) -> dict[str, torch.Tensor]:
    grid = small_grid()
    return {"density": grid.density, "sh": grid.sh, "label": grid.label, "aabb": grid.aabb, **changes}


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_a_grid_comes_back_as_it_was_written(tmp_path, degree):
    grid = small_grid(degree)
    write_grid(tmp_path / "field.safetensors", grid)
    back = read_grid(tmp_path / "field.safetensors")
    for key in ("density", "sh", "label", "aabb"):
        assert torch.equal(getattr(back, key), getattr(grid, key))
    assert back.degree == degree


def test_a_grid_is_a_scene(tmp_path):
    path = tmp_path / "field.safetensors"
    write_grid(path, small_grid())
    scene = load_scene(path, up=(0, 0, 1))
    assert isinstance(scene.geometry, NerfGrid)
    assert (scene.name, scene.subject) == ("field", None)


def test_half_precision_is_read_as_single(tmp_path):
    half = {key: value.half() for key, value in tensors().items()}
    save_file(half, tmp_path / "half.safetensors", metadata={"format": FORMAT})
    grid = read_grid(tmp_path / "half.safetensors")
    assert grid.density.dtype == torch.float32
    torch.testing.assert_close(grid.sh, small_grid().sh, atol=2e-3, rtol=2e-3)


def test_vertices_reach_from_corner_to_corner():
    grid = NerfGrid(torch.ones(3, 4, 5), torch.zeros(3, 4, 5, 1, 3), torch.zeros(3, 4, 5), small_grid().aabb)
    assert grid.voxel.tolist() == [1, 2, 3]
    assert grid.means[0].tolist() == [-1, 0, 2]
    assert grid.means[1].tolist() == [0, 0, 2]
    assert grid.means[-1].tolist() == [3, 6, 8]


def test_labels_are_about_the_vertices_that_hold_anything():
    grid = small_grid()
    assert 0 < len(grid) == int((grid.density > 0).sum()) < grid.density.numel()
    labelled = grid.with_label((grid.means[:, 0] > 1).float())
    world_x = torch.linspace(-1, 3, 5).expand(3, 4, 5)
    assert torch.equal(labelled.label, ((world_x > 1) & (grid.density > 0)).float())


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"density": torch.ones(3, 4, 5) * -1}, "density: expected no negative value, got -1"),
        ({"density": torch.zeros(3, 4, 5)}, "density: holds nothing, all is 0"),
        ({"density": torch.full((3, 4, 5), torch.nan)}, "density: expected finite values"),
        ({"density": torch.ones(3, 4)}, r"density: expected \(Z, Y, X\)"),
        ({"density": torch.ones(1, 4, 5)}, "sides of at least 2"),
        ({"density": torch.ones(5, 4, 3)}, r"sh: expected \(5, 4, 3"),
        ({"density": torch.ones(3, 4, 5).int()}, "density: expected floating point, got I32"),
        ({"density": torch.full((3, 4, 5), 1e39, dtype=torch.float64)}, "density: expected finite values"),
        ({"density": torch.full((3, 4, 5), 1e-60, dtype=torch.float64)}, "density: holds nothing, all is 0"),
        ({"sh": torch.zeros(3, 4, 5, 16, 3)}, r"sh: expected .* got \(3, 4, 5, 16, 3\)"),
        ({"sh": torch.full((3, 4, 5, 1, 3), torch.inf)}, "sh: expected finite values"),
        ({"label": torch.full((3, 4, 5), 1.5)}, r"label: expected values in \[0, 1\]"),
        ({"label": torch.zeros(5, 4, 3)}, r"label: expected \(3, 4, 5\)"),
        ({"aabb": torch.tensor([[0.0, 0, 0], [1, 0, 1]])}, "aabb: expected a lower and a greater upper corner"),
        ({"aabb": torch.zeros(6)}, "aabb: expected a lower"),
        ({"aabb": torch.tensor([[0.0, 0, 0], [1, 1, 1e-9]])}, r"aabb: expected at most 100000 times .*, got 2.83e\+09"),
        ({"aabb": torch.tensor([[0, 0, 0], [1e300, 1, 1]], dtype=torch.float64)}, "at most 100000 times"),
    ],
)
def test_a_bad_tensor_is_named_in_one_line(tmp_path, change, line):
    path = tmp_path / "bad.safetensors"
    save_file(tensors(**change), path, metadata={"format": FORMAT})
    with pytest.raises(InputError, match=line) as caught:
        read_grid(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_missing_tensor_and_a_foreign_format_are_named(tmp_path):
    path = tmp_path / "bad.safetensors"
    parts = tensors()
    del parts["label"]
    save_file(parts, path, metadata={"format": FORMAT})
    with pytest.raises(InputError, match="label: tensor is missing"):
        read_grid(path)
    save_file(tensors(), path)
    with pytest.raises(InputError, match=r"format: expected 'cltransfer.nerf_grid.1', got None"):
        read_grid(path)


def test_what_is_no_safetensors_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "bad.safetensors"
    for content in (b"", b"short", struct.pack("<Q", 2**60) + b"{}", b"\x00" * 64):
        path.write_bytes(content)
        with pytest.raises(InputError, match="not a grid"):
            read_grid(path)
    with pytest.raises(InputError, match="no such file"):
        read_grid(tmp_path / "none.safetensors")


def test_a_header_that_declares_more_than_the_file_holds_is_refused(tmp_path):
    size = 2**40
    entry = {"dtype": "F32", "shape": [2**20, 2**9, 2**9], "data_offsets": [0, size]}
    header = json.dumps({"__metadata__": {"format": FORMAT}, "density": entry}).encode()
    path = tmp_path / "bomb.safetensors"
    path.write_bytes(struct.pack("<Q", len(header)) + header + b"\x00" * 16)
    with pytest.raises(InputError, match="not a grid"):
        read_grid(path)


def sparse_grid(path: Path, side: int, terms: int, kind: str) -> Path:
    """A file of ``side`` vertices along each axis, of zeros that take no room."""
    shapes = {"density": [side] * 3, "sh": [side] * 3 + [terms, 3], "label": [side] * 3, "aabb": [2, 3]}
    header: dict[str, object] = {"__metadata__": {"format": FORMAT}}
    end = 0
    for key, shape in shapes.items():
        start, end = end, end + {"F16": 2, "F32": 4}[kind] * math.prod(shape)
        header[key] = {"dtype": kind, "shape": shape, "data_offsets": [start, end]}
    text = json.dumps(header).encode()
    with path.open("wb") as stream:
        stream.write(struct.pack("<Q", len(text)) + text)
        stream.truncate(8 + len(text) + end)
    return path


def test_a_grid_is_held_against_the_memory_before_it_is_read(tmp_path, monkeypatch):
    path = sparse_grid(tmp_path / "sparse.safetensors", 300, 9, "F16")
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**30)
    with pytest.raises(ResourceError, match=r"sparse.safetensors: memory: its tensors need 4558 MB, 1024 MB are free"):
        read_grid(path)


def test_what_may_be_baked_may_be_opened_and_no_more(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "free_bytes", lambda: 2**30)
    with pytest.raises(ResourceError, match="its tensors need"):  # only memory is in its way
        read_grid(sparse_grid(tmp_path / "most.safetensors", 518, 1, "F32"))
    with pytest.raises(InputError, match="density: expected at most 138991832 vertices, got 139798359"):
        read_grid(sparse_grid(tmp_path / "more.safetensors", 519, 1, "F32"))


@pytest.mark.parametrize(("dtype", "most"), [(torch.float16, 6), (torch.float32, 4), (torch.float64, 12)])
def test_a_grid_takes_what_it_keeps_and_what_bringing_it_to_that_takes(tmp_path, monkeypatch, dtype, most):
    path = tmp_path / "field.safetensors"
    parts = {key: value.to(dtype) for key, value in tensors(sh=torch.zeros(3, 4, 5, 9, 3)).items()}
    save_file(parts, path, metadata={"format": FORMAT})
    numbers = sum(value.numel() for value in parts.values())
    monkeypatch.setattr(memory, "free_bytes", lambda: most * numbers)
    with pytest.raises(ResourceError, match="its tensors need"):
        read_grid(path)
    monkeypatch.setattr(memory, "free_bytes", lambda: (most + 1) * numbers)
    assert len(read_grid(path)) > 0


def test_where_a_dense_grid_is_must_fit_in_memory_too(tmp_path, monkeypatch):
    dense = torch.ones(16, 16, 16)
    box = torch.tensor([[0.0, 0, 0], [1, 1, 1]], dtype=torch.float64)
    path = tmp_path / "dense.safetensors"
    for density, fits in ((dense, False), (dense * (torch.arange(16) == 7), True)):
        write_grid(path, NerfGrid(density, torch.zeros(16, 16, 16, 1, 3), torch.zeros(16, 16, 16), box))
        monkeypatch.setattr(memory, "free_bytes", lambda: 24 * 16**3)  # what reading takes
        if fits:
            assert len(load_scene(path).geometry) == 16 * 16
            continue
        with pytest.raises(ResourceError, match=r"dense.safetensors: memory: places of 4096 vertices need 0 MB"):
            load_scene(path)
