"""Versions of the packages that results depend on, by whichever distribution they were installed from."""

from __future__ import annotations

import importlib
from importlib import metadata

PACKAGES = {
    "torch": ("torch", "torch"),
    "kornia": ("kornia", "kornia"),
    "onnxruntime": (
        "onnxruntime",
        "onnxruntime", "onnxruntime-gpu", "onnxruntime-directml", "onnxruntime-openvino", "onnxruntime-silicon",
    ),
    "opencv-contrib-python-headless": (
        "cv2",
        "opencv-contrib-python-headless", "opencv-contrib-python", "opencv-python-headless", "opencv-python",
    ),
    "cma": ("cma", "cma"),
    "numba": ("numba", "numba"),
    "av": ("av", "av"),
    "omegaconf": ("omegaconf", "omegaconf"),
}  # fmt: skip
"""What we ask pip for: the module that it brings, then the distributions that bring it too."""


def installed(name: str) -> tuple[str, str | None]:
    """Which distribution brings what package ``name`` does, and its version; None where none of them is here.

    Of a module that no known distribution brings (conda, one's own build) the version is what it says itself.
    """
    module, *distributions = PACKAGES[name]
    for distribution in distributions:
        try:
            return distribution, metadata.version(distribution)
        except metadata.PackageNotFoundError:
            continue
    try:
        return name, str(importlib.import_module(module).__version__)
    except (ImportError, OSError, AttributeError):  # not there, or it cannot be loaded, or it does not say
        return name, None


def versions() -> dict[str, str | None]:
    """The version of every package, by the distribution that brings it."""
    return dict(installed(name) for name in PACKAGES)
