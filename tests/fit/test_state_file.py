from __future__ import annotations

import math
import pickle
import resource
from collections import Counter

import pytest
import torch
from safetensors.torch import save_file

from cltransfer.errors import InputError
from cltransfer.fit._state_file import FORMAT, read_state, write_state


def test_nested_state_comes_back_with_its_types(tmp_path):
    state = {
        "epoch": 3,
        "weights": {"a": torch.arange(6.0).reshape(2, 3), "b": torch.tensor(True)},
        "optimizer": {"state": {0: {"step": torch.tensor(2.0)}}, "betas": (0.9, 0.999)},
        "best": math.inf,
        "names": ["x", None, True, -math.inf],
        "empty": {},
    }
    write_state(tmp_path / "state.safetensors", state)
    back = read_state(tmp_path / "state.safetensors")
    assert torch.equal(back["weights"].pop("a"), state["weights"].pop("a"))
    assert torch.equal(back["weights"].pop("b"), state["weights"].pop("b"))
    assert back["optimizer"]["state"][0].pop("step") == state["optimizer"]["state"][0].pop("step")
    assert back == state
    assert isinstance(back["optimizer"]["betas"], tuple)


def test_not_a_number_comes_back(tmp_path):
    write_state(tmp_path / "state.safetensors", [math.nan])
    assert math.isnan(read_state(tmp_path / "state.safetensors")[0])


@pytest.mark.parametrize("value", [object(), {1, 2}, b"bytes", print])
def test_what_is_no_plain_value_is_refused_and_nothing_is_written(tmp_path, value):
    with pytest.raises(TypeError, match="plain values and tensors, got"):
        write_state(tmp_path / "state.safetensors", {"a": [value]})
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_grow_is_an_error_of_the_system(tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"state\.safetensors"):
            write_state(tmp_path / "state.safetensors", {"a": torch.zeros(10_000)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not (tmp_path / "state.safetensors").exists()


def test_a_pickle_is_never_opened(tmp_path):
    path = tmp_path / "state.safetensors"
    path.write_bytes(pickle.dumps(Counter(a=1)))
    with pytest.raises(InputError, match="not a training state"):
        read_state(path)
    torch.save({"a": torch.ones(2)}, path)
    with pytest.raises(InputError, match="not a training state"):
        read_state(path)


@pytest.mark.parametrize("tree", ['["tensor", "9"]', '["code", "x"]', "[1]", "[[[", '["dict", 3]', '["float", "x"]'])
def test_a_tree_that_does_not_fit_is_refused_in_one_line(tmp_path, tree):
    path = tmp_path / "state.safetensors"
    save_file({"0": torch.ones(1)}, path, metadata={"format": FORMAT, "tree": tree})
    with pytest.raises(InputError, match="not a training state") as caught:
        read_state(path)
    assert "\n" not in str(caught.value)


def test_a_foreign_format_is_named(tmp_path):
    save_file({"a": torch.ones(1)}, tmp_path / "x.safetensors", metadata={"format": "pt"})
    with pytest.raises(InputError, match=r"format: expected 'cltransfer.state.1', got 'pt'"):
        read_state(tmp_path / "x.safetensors")
