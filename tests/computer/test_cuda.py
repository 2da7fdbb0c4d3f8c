"""What is said where CUDA paths cannot run; what they draw is tested beside the renderers."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from types import ModuleType

import pytest
import torch

from cltransfer.computer import cuda
from cltransfer.computer.cuda import require_gsplat
from cltransfer.errors import ModelError


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """gsplat and a CUDA device, as far as one can tell before the kernels are loaded."""
    monkeypatch.setattr(cuda.importlib.util, "find_spec", lambda name: ModuleSpec(name, None))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    backend = ModuleType("gsplat.cuda._backend")
    backend.__dict__["_C"] = object()
    for name, module in {"gsplat": ModuleType("gsplat"), "gsplat.cuda": ModuleType("gsplat.cuda")}.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", backend)
    return backend


def test_with_kernels_nothing_is_said(installed: ModuleType) -> None:
    require_gsplat("renderer", "backend=numba")


def test_without_a_compiler_the_line_says_which_toolkit_is_needed(installed: ModuleType) -> None:
    installed.__dict__["_C"] = None
    with pytest.raises(
        ModelError, match=r"^renderer: gsplat was not compiled: there is no nvcc \(.*or backend=numba\)$"
    ):
        require_gsplat("renderer", "backend=numba")


def test_a_compilation_that_fails_is_one_line(installed: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", None)  # an import of it fails
    with pytest.raises(ModelError, match="renderer: gsplat was not compiled: ") as caught:
        require_gsplat("renderer", "backend=numba")
    assert "\n" not in str(caught.value)


def test_without_a_device_the_line_says_so(installed: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ModelError, match=r"^renderer: there is no CUDA device \(backend=numba\)$"):
        require_gsplat("renderer", "backend=numba")
