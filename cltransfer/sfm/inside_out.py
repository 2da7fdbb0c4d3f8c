"""Space turned inside out: where a camera hardly moves, cameras that move the other way explain a clip nearly as well.

What is far is near there, and more corners are explained, since no point is too far to count; but each is explained
worse: perspective tells the two apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLURRED = 1.3  # median error over that of another model, of the corners of both, with which a model is not believed
SHARED = 50  # corners two models must share for that
PNP_ERROR = 8.0 / 480  # of a corner that places a camera among turned points, before all is refined [frame widths]


def sharp(models: Sequence[Any]) -> list[Any]:
    """Those of ``models`` whose median error on shared corners is at most :data:`BLURRED` times any other's.

    Measured on rendered clips: right models of one clip are within 1.1 of each other, those turned inside out at 1.7
    to 2.4 of a right one.
    """
    errors = [_errors(model) for model in models]

    def blurred(mine: dict[tuple[int, int], float], other: dict[tuple[int, int], float]) -> bool:
        shared = mine.keys() & other.keys()
        if len(shared) < SHARED:
            return False
        return median(mine[corner] for corner in shared) > BLURRED * median(other[corner] for corner in shared)

    return [model for model, mine in zip(models, errors) if not any(blurred(mine, other) for other in errors)]


def turned(pycolmap: Any, model: Any, lenses: tuple[float, float], refine: bool) -> Any | None:
    """``model`` turned inside out and refined; None where no camera sees its points so, or by no lens that there is.

    Args:
        pycolmap: the module.
        model: COLMAP's reconstruction; it is left as it is.
        lenses: least and greatest focal length [longer sides].
        refine: whether the lens is.
    """
    other = pycolmap.Reconstruction(model)
    numbers = sorted(other.reg_image_ids())
    points = other.points3D
    places = _reversed(
        other.image(numbers[len(numbers) // 2]).cam_from_world().matrix(), np.stack([p.xyz for p in points.values()])
    )
    for point, place in zip(points.values(), places):
        point.xyz = place
    for image in map(other.image, numbers):
        pose = _pose(pycolmap, other, image)
        if pose is None:
            return None
        other.frame(image.frame_id).rig_from_world = pose
    adjust(pycolmap, other, numbers, refine)
    camera = other.image(numbers[0]).camera
    lens = camera.focal_length / max(camera.width, camera.height)
    return other if lenses[0] <= lens <= lenses[1] else None


def _reversed(w2c: NDArray, places: NDArray) -> NDArray:
    """Points ``places`` (P, 3) where a camera (3, 4) sees them, the nearest as far as the farthest was."""
    seen = places @ w2c[:, :3].T + w2c[:, 3]
    seen[seen[:, 2] == 0, 2] = np.finfo(float).tiny ** 0.5  # a point that this camera does not see may lie beside it
    nearness = 1 / seen[:, 2]
    low, high = np.percentile(nearness[nearness > 0], [5, 95])
    turned_over = (low + high - nearness).clip(low / 2, 2 * high)
    moved = seen / seen[:, 2:] / turned_over[:, None]
    back: NDArray = (moved - w2c[:, 3]) @ w2c[:, :3]
    return back


def _pose(pycolmap: Any, model: Any, image: Any) -> Any | None:
    """Where ``image`` stands by the points of ``model`` that it sees."""
    seen = [corner for corner in image.points2D if corner.has_point3D()]
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error, options.ransac.random_seed = PNP_ERROR * image.camera.width, 0
    pixels = np.array([corner.xy for corner in seen]).reshape(-1, 2)
    places = np.array([model.points3D[corner.point3D_id].xyz for corner in seen]).reshape(-1, 3)
    found = pycolmap.estimate_and_refine_absolute_pose(pixels, places, image.camera, options)
    return None if found is None else found["cam_from_world"]


def adjust(pycolmap: Any, model: Any, numbers: Sequence[int], lens: bool) -> None:
    """Cameras and points of least reprojection error, and the lens where ``lens``."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length, options.refine_principal_point, options.refine_extra_params = lens, False, False
    options.ceres.solver_options.num_threads = 1
    config = pycolmap.BundleAdjustmentConfig()
    for number in numbers:
        config.add_image(number)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()


def _errors(model: Any) -> dict[tuple[int, int], float]:
    """Distance [px] of every corner, as image and number, from where ``model`` has its point; infinite behind it."""
    found: dict[tuple[int, int], float] = {}
    for image in map(model.image, model.reg_image_ids()):
        seen = [(number, corner) for number, corner in enumerate(image.points2D) if corner.has_point3D()]
        if not seen:
            continue
        places = np.stack([model.points3D[corner.point3D_id].xyz for _, corner in seen])
        projection = image.camera.calibration_matrix() @ image.cam_from_world().matrix()
        pixels = places @ projection[:, :3].T + projection[:, 3]
        ahead, corners = pixels[:, 2] > 0, np.stack([corner.xy for _, corner in seen])
        off = np.full(len(seen), np.inf)
        off[ahead] = np.linalg.norm(pixels[ahead, :2] / pixels[ahead, 2:] - corners[ahead], axis=1)
        found.update({(image.image_id, number): float(each) for (number, _), each in zip(seen, off)})
    return found
