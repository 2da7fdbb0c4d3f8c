"""Transfer the camera language of a reference clip into a 3D scene, and score it.

Public names are loaded on first use, so that ``cltransfer --help`` does not wait for torch.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # or to a type checker and an editor each of them is Any, and two the modules of the same names
    from .camera import Camera as Camera
    from .config import load_config as load_config
    from .evaluate import evaluate as evaluate
    from .features import Features as Features
    from .metrics import camera_language_metrics as camera_language_metrics
    from .pipeline.components import Components as Components
    from .reading.frames import clip_features as clip_features
    from .registry import EXTRACTORS as EXTRACTORS
    from .registry import FITTERS as FITTERS
    from .registry import LOSSES as LOSSES
    from .registry import RENDERERS as RENDERERS
    from .registry import SEARCHES as SEARCHES
    from .scenes import Scene as Scene
    from .subject import Subject as Subject
    from .trajectory import Trajectory as Trajectory
    from .transfer import Inputs as Inputs
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
