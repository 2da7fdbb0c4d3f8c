"""What losses are compared with."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def literal() -> ModuleType:
    """The formulas of JAWS as loops."""
    path = Path(__file__).resolve().parents[1] / "reference" / "jaws.py"
    spec = importlib.util.spec_from_file_location("jaws", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
