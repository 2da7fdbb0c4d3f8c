"""Extractors: features in, more features out. One module per extractor; its name is the file's name.

Image extractors read pixels (require ``image``); scene extractors read what only a renderer knows (require
``camera`` or ``person``). The graph picks by what a loss reaches and what a source has.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, Protocol

if TYPE_CHECKING:
    from ..features import Features


class Extractor(Protocol):
    """What the graph needs of an extractor; a frozen dataclass whose fields are its options."""

    requires: ClassVar[tuple[str, ...]]
    """Features it cannot work without."""
    provides: ClassVar[tuple[str, ...]]
    """Features it adds."""
    family: ClassVar[Literal["image", "scene", "both"]]
    """Whether it reads pixels, the scene, or either (what it requires may come from both)."""

    # Optional class attributes:
    #   uses: features it takes where *both* sides of a comparison have them, so both are read by one rule
    #   needs_before: True if it compares with the frame before; frames without one get NaN
    #   passes: network passes one frame costs (0 where absent)
    #   persons(now): boxes of all persons of each frame, for a detector of ``box``: along a clip one is then followed;
    #     a detector that provides more reads the person in the ``box`` that ``now`` then has, and leaves it
    #   doubts_boxes: True if it gives NaN of a box in which nobody is: where all that read a ``box`` do, frames in
    #     which the detector loses the person have one that is guessed, with score 0
    #   note: what a reader of what it tells should know, a text; empty where that is nothing
    #   network: what it runs, a cached_property, looked at before any frame is read so that it is loaded by then
    #   whole_clip: True if it reads whole clips only, as `evaluate` does: a search, which looks at single renders,
    #     refuses it where no scene extractor provides the same. It then has, instead of __call__,
    #     read_clip(found, load) -> found with what it provides, or with the reasons why not: ``found`` has the N frames
    #     without pixels, ``load(start, stop)`` gives the pixels of a few

    def __call__(self, now: Features, before: Features | None) -> Features:
        """``now`` (B frames) with the provided features added; all else stays what it is, nothing is changed in place.

        ``before`` holds the frame before each, as B frames or one that all share.
        """
        ...
