"""What both encodings of a COLMAP model hold."""

from __future__ import annotations

from dataclasses import dataclass

from ...computer.array_type import Array

MODELS = {  # COLMAP's number -> name and count of parameters
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
}
TABLES = tuple(f"{name}{suffix}" for name in ("cameras", "images", "points3D") for suffix in (".bin", ".txt"))
STRAIGHTEN = "run: colmap image_undistorter"
COUNTS = dict(MODELS.values())  # name -> count of parameters


@dataclass(frozen=True)
class Calibration:
    """One camera: COLMAP's name of the lens model, (W, H) [px], and its parameters in COLMAP's order."""

    model: str
    size: tuple[float, float]
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class Shot:
    """One image: its name, rotation w, x, y, z (4,) and translation (3,) world to camera, and which camera."""

    name: str
    quaternion: Array
    translation: Array
    camera: int


@dataclass(frozen=True)
class Tables:
    """A model: cameras by id, images, points (P, 3) float64 and their RGB (P, 3) uint8."""

    cameras: dict[int, Calibration]
    images: list[Shot]
    points: Array
    colors: Array
