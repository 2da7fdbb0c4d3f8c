"""Renderers: cameras in, buffers out. One module per renderer; its name is the file's name."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

if TYPE_CHECKING:
    from ..camera import Camera
    from ..features import Features
    from ..scenes import Scene


class Renderer(Protocol):
    """What the objective needs of a renderer; a frozen dataclass whose fields are its options.

    One that brings a representation of its own declares two more, both or none: ``suffixes``, the scene files that it
    reads (``ClassVar[tuple[str, ...]]``, in small letters with the dot, none of ours), and ``read(path)``, a static or
    class method that makes a :class:`~cltransfer.scenes.geometry.Geometry` of one and raises InputError where the file
    is damaged. It keeps in mind that files come from strangers: no pickle, sizes looked at before memory is taken.

    One that draws what another renderer does says of which: ``draws = ("gaussian_splats",)``. It is then given no other
    scene, and a reference scene of another kind is drawn by what draws that.

    One that needs a device or a package may have ``require_backend()``, which raises ModelError where that is not here:
    it is asked before anything is read.
    """

    provides: ClassVar[frozenset[str]]
    """Buffers it can make: of image, alpha, label, depth, expected_depth."""

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        """Features of B cameras at ``cameras.size`` with ``buffers`` and no more, plus camera and person.

        A run asks under ``torch.no_grad()``.

        They are on the CPU, where cameras and scenes are, whatever device has drawn them. Image, alpha and label are
        in [0, 1], 0 where nothing is; depth and expected_depth are above 0 and finite, NaN where nothing is: for depth
        that is wherever alpha is below 0.5, and nowhere else.

        Raises:
            UsageError: the scene holds a geometry this renderer does not draw.
        """
        ...
