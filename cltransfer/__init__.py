"""Transfer the camera language of a reference clip into a 3D scene, and score it.

Public names are loaded on first use, so that ``cltransfer --help`` does not wait for torch.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # or a type checker takes them for the modules of the same names
    from .evaluate import evaluate as evaluate
    from .transfer import transfer as transfer

__version__ = "0.1.0"

_HOME = {
    "Camera": "camera",
    "Trajectory": "trajectory",
    "Features": "features",
    "Subject": "subject",
    "Scene": "scenes",
    "load_config": "config",
    "Components": "pipeline.components",
    "clip_features": "reading.frames",
    "camera_language_metrics": "metrics",
    "transfer": "transfer",
    "Inputs": "transfer",
    "evaluate": "evaluate",
    "LOSSES": "registry",
    "EXTRACTORS": "registry",
    "RENDERERS": "registry",
    "SEARCHES": "registry",
    "FITTERS": "registry",
}

__all__ = ["__version__", *_HOME]


class _Package(ModuleType):
    """Keeps ``cltransfer.transfer`` the function: importing the module must not rebind it."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (_HOME.get(name) == name and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name == "plugins":  # that cltransfer.plugins.allow may be called as it is written
        return importlib.import_module(".plugins", __name__)
    if name not in _HOME:
        raise AttributeError(f"module 'cltransfer' has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
