"""A lens that changes on the move: COLMAP's mapper takes it for one lens and bends the path instead."""

from __future__ import annotations

from typing import Any

from .inside_out import adjust


def zooming(pycolmap: Any, model: Any, lenses: tuple[float, float]) -> Any | None:
    """``model`` with a lens for every frame, refined; None where one is found that there is not.

    Of a clip of one lens the corners are explained as well before (by 0.96 to 1.06 of the error, measured on rendered
    clips); of an orbit that zooms by 1.1 to 1.5 the error was 1.5 to 2 times as great, and the lenses are right.

    Args:
        pycolmap: the module.
        model: COLMAP's reconstruction; it is left as it is.
        lenses: least and greatest focal length [longer sides].
    """
    other = pycolmap.Reconstruction()
    numbers = sorted(model.reg_image_ids())
    for image in map(model.image, numbers):
        lens, number = image.camera, image.image_id
        other.add_camera_with_trivial_rig(
            pycolmap.Camera(
                model="SIMPLE_PINHOLE", width=lens.width, height=lens.height, params=lens.params, camera_id=number
            )
        )
        own = pycolmap.Image(name=image.name, camera_id=number, image_id=number)
        own.points2D = pycolmap.Point2DList([pycolmap.Point2D(corner.xy) for corner in image.points2D])
        other.add_image_with_trivial_frame(own, image.cam_from_world())
    for point in model.points3D.values():
        track = pycolmap.Track()
        for sighting in point.track.elements:
            track.add_element(sighting.image_id, sighting.point2D_idx)
        other.add_point3D(point.xyz, track)
    adjust(pycolmap, other, numbers, True)
    cameras = [other.image(number).camera for number in numbers]
    fit = all(lenses[0] <= c.focal_length / max(c.width, c.height) <= lenses[1] for c in cameras)
    return other if fit else None
