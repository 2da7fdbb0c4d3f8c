"""Transfer the camera language of a reference clip into a 3D scene, and score it.

Public names are loaded on first use, so that ``cltransfer --help`` does not wait for torch.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "Camera": "camera",
    "Trajectory": "trajectory",
    "Features": "features",
    "Subject": "subject",
    "Scene": "scenes",
    "load_config": "config",
    "transfer": "transfer",
    "evaluate": "evaluate",
    "LOSSES": "registry",
    "EXTRACTORS": "registry",
    "RENDERERS": "registry",
    "SEARCHES": "registry",
}

__all__ = ["__version__", *_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'cltransfer' has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
