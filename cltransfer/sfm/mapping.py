"""Cameras of a clip by COLMAP's incremental mapper (https://doi.org/10.1109/CVPR.2016.445), from matches of ours."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..camera import Camera, intrinsics
from . import NoPathError, OutOfTimeError, load_pycolmap
from .corners import Corners
from .inside_out import sharp, turned
from .parallax import Evidence
from .zoom import zooming

LENSES = (1.0, 0.7, 2.0)  # first guesses of the focal length [longer sides]
FOCAL_RANGE = (0.1, 10.0)  # in which it is refined [longer sides]
PLACED = 0.8  # of the frames must be placed
AS_GOOD = 0.97  # of the most corners explained is as good


@dataclass(frozen=True)
class Clues:
    """What the cameras of a clip are found from.

    Args:
        size: (W, H) of the frames [px].
        corners: of every frame.
        evidence: of pairs of frames.
    """

    size: tuple[int, int]
    corners: Sequence[Corners]
    evidence: Sequence[Evidence]


@dataclass(frozen=True)
class Placed:
    """Cameras of the frames that could be placed, in COLMAP's own frame and scale.

    Args:
        frames: which, (M,) increasing.
        camera: M cameras with one focal length, or of a zoom with one each.
    """

    frames: NDArray  # (M,)
    camera: Camera


def place_frames(clues: Clues, seconds: float, lens: float | None = None) -> Placed:
    """Cameras of a clip of one lens, or of a zoom on the move that the mapper takes for one.

    Mapping starts from several lenses, since a poor guess loses frames; of the models that place enough of them, that
    are no worse than another on the corners of both and that explain most corners the one with the most ordinary lens
    is kept, turned inside out where that explains its corners better, and with a lens for every frame where that does.
    Single-threaded and seeded: the same clip gives the same cameras, unless time cuts off a guess, which then does not
    count.

    Args:
        clues: of the clip.
        seconds: all first guesses of the lens may take together, in equal parts of at least 1 s; COLMAP looks at the
            clock between frames.
        lens: focal length [longer sides] where it is known; None finds it.

    Raises:
        ModelError: pycolmap is not installed.
        NoPathError: too few frames could be placed.
        OutOfTimeError: so far, when time ran out.
    """
    pycolmap = load_pycolmap()
    guesses = LENSES if lens is None else (lens,)
    models, late = [], []
    for guess in guesses:
        options = _options(pycolmap, seconds / len(guesses), lens is None)
        begun = time.monotonic()
        models.append(_mapped(pycolmap, clues, guess, options))
        late.append(time.monotonic() - begun >= options.max_runtime_seconds)
    model = _chosen(clues, [model for model, cut_off in zip(models, late) if not cut_off])
    if model is None:
        raise _too_few(clues, max(model.num_reg_images() for model in models), seconds if any(late) else None)
    other = turned(pycolmap, model, FOCAL_RANGE, lens is None)
    model = model if other is None else sharp([model, other])[0]
    other = zooming(pycolmap, model, FOCAL_RANGE) if lens is None else None
    model = model if other is None else sharp([model, other])[0]
    placed = sorted(model.reg_image_ids())
    w2c = torch.eye(4, dtype=torch.float64).repeat(len(placed), 1, 1)
    w2c[:, :3] = torch.from_numpy(np.stack([model.image(i).cam_from_world().matrix() for i in placed]))
    focal = torch.tensor([model.image(i).camera.focal_length for i in placed], dtype=torch.float64)
    return Placed(np.array(placed) - 1, Camera(w2c, intrinsics(focal, clues.size), clues.size))


def _too_few(clues: Clues, placed: int, late: float | None) -> NoPathError:
    """What to say where ``placed`` frames are too few; ``late``: after so many seconds, when time ran out."""
    count = len(clues.corners)
    if late is not None:
        reason = f"time ran out after {late:g} s with {placed} of {count} frames placed"
        return OutOfTimeError("clip", "camera path", reason, "set more seconds")
    if placed >= PLACED * count:
        reason = "no lens of {:g} to {:g} longer sides explains the frames".format(*FOCAL_RANGE)
        return NoPathError("clip", "camera path", reason, "a straight move does not tell the lens: name it, lens=")
    reason = f"only {placed} of {count} frames could be placed with one lens"
    return NoPathError("clip", "camera path", reason, "a zoom on the move, a cut, a moving scene, or few frames")


def _chosen(clues: Clues, models: Sequence[Any]) -> Any | None:
    """Of the models that explain about as many corners as the best, the one with the most ordinary lens.

    Models that are blurred beside another do not count, however many corners they explain: where a camera hardly moves,
    space turned inside out explains more, what is far being near there. None where none places enough frames by a lens
    that there is.
    """
    lens = {id(model): model.camera(1).focal_length / max(clues.size) for model in models if model.num_reg_images()}
    least = PLACED * len(clues.corners)
    enough = [
        model
        for model in models
        if model.num_reg_images() >= least and FOCAL_RANGE[0] <= lens[id(model)] <= FOCAL_RANGE[1]
    ]
    enough = sharp(enough)
    best = max((model.compute_num_observations() for model in enough), default=0)
    good = [model for model in enough if model.compute_num_observations() >= AS_GOOD * best]
    return min(good, key=lambda each: abs(math.log(lens[id(each)])), default=None)


def _mapped(pycolmap: Any, clues: Clues, guess: float, options: Any) -> Any:
    """COLMAP's largest model from a first ``guess`` of the lens; empty where it finds none."""
    with tempfile.TemporaryDirectory(prefix="cltransfer-sfm-") as folder:
        database = Path(folder) / "matches.db"
        _write_database(pycolmap, database, clues, guess)
        models = pycolmap.incremental_mapping(database, folder, Path(folder) / "models", options)
    return max(models.values(), key=lambda each: each.num_reg_images(), default=pycolmap.Reconstruction())


def _write_database(pycolmap: Any, path: Path, clues: Clues, guess: float) -> None:
    """COLMAP's database: one camera, every frame's corners, the matches that agree."""
    width, height = clues.size
    params = [guess * max(clues.size), width / 2, height / 2]
    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=width, height=height, params=params, camera_id=1)
    with pycolmap.Database.open(path) as database:
        database.write_camera(camera, use_camera_id=True)
        rig = pycolmap.Rig(rig_id=1)
        rig.add_ref_sensor(camera.sensor_id)
        database.write_rig(rig, use_rig_id=True)
        for number, corners in enumerate(clues.corners, start=1):  # COLMAP counts from 1
            image = pycolmap.Image(name=f"{number:05d}", camera_id=1, image_id=number)
            database.write_image(image, use_image_id=True)
            frame = pycolmap.Frame(frame_id=number, rig_id=1)
            frame.add_data_id(image.data_id)
            database.write_frame(frame, use_frame_id=True)
            database.write_keypoints(number, corners.pixels.astype(np.float32))
        kind = pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED
        for pair in clues.evidence:
            first, second = (frame + 1 for frame in pair.match.frames)
            index = pair.match.index.astype(np.uint32)
            geometry = pycolmap.TwoViewGeometry(config=kind, F=pair.fundamental, inlier_matches=index)
            database.write_matches(first, second, index)
            database.write_two_view_geometry(first, second, geometry)


def _options(pycolmap: Any, seconds: float, refine: bool) -> Any:
    """A clip's baselines are short and its frames few, so less is asked than COLMAP asks of photographs."""
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = options.mapper.num_threads = 1
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = 0
    options.max_runtime_seconds = max(1, round(seconds))
    options.extract_colors = options.multiple_models = False
    options.min_model_size = 3
    options.ba_refine_focal_length = refine
    options.mapper.abs_pose_refine_focal_length = False
    options.min_focal_length_ratio, options.max_focal_length_ratio = FOCAL_RANGE
    options.mapper.init_min_num_inliers, options.mapper.abs_pose_min_num_inliers = 30, 15
    options.mapper.init_min_tri_angle = 4.0  # [deg]
    options.mapper.filter_min_tri_angle = options.triangulation.min_angle = 0.5  # [deg]
    return options
