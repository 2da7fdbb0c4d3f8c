"""Options of a run with their defaults, their meaning and their ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ..errors import UsageError
from ..registry import EXTRACTORS, LOSSES, RENDERERS, SEARCHES, Registry
from .adam import AdamConfig
from .layers import told

SECTIONS: dict[str, Registry[Any]] = {
    "renderer": RENDERERS,
    "extractors": EXTRACTORS,
    "losses": LOSSES,
    "search": SEARCHES,
}
MOST_CORRECTIONS = 20  # each may be a search of its own


@dataclass
class ExtractConfig:
    """Which extractors read the renders.

    Args:
        inner: inside the search, geometric (scene extractors) or image (networks).
        verify: read the result of a clip's transfer with the networks that read the clip.
        corrections: rounds in which the networks' bias as measured on the result is aimed off: the path is moved as a
            whole, or searched anew where that does not do; or in which no view is taken in which things hide many
            joints, where the networks lost the person behind some.
        bias: robust (steady along the clip) or frame (every frame's own difference, noise and all).
    """

    inner: Literal["geometric", "image"] = "geometric"
    verify: bool = True
    corrections: int = 0
    bias: Literal["robust", "frame"] = "robust"

    def __post_init__(self) -> None:
        if not 0 <= self.corrections <= MOST_CORRECTIONS:
            raise UsageError("", "extract.corrections", f"expected 0 to {MOST_CORRECTIONS}, got {self.corrections}")


@dataclass
class RunConfig:
    """Everything a run depends on beside its scene and its reference.

    Defaults are for keys that a shipped config leaves out; make one by load_config().

    Args:
        preset: the shipped config the others build on.
        frames: frames to transfer, evenly over the reference; null takes all. Of builtin:SHOT it makes another shot,
            as many frames long at 12 a second; null makes one of 24.
        seed: of the run's own random generator.
        threads: of kernels, OpenCV and networks; 0 takes what CLTRANSFER_THREADS says, else every core there is.
        search_side: longer side of the frames rendered while searching [px].
        output_side: longer side of the final video [px].
        lod: level of detail while searching: splats that share a voxel of so many pixels are merged; 0 merges nothing.
            The result is rendered and scored in full.
        warm_start: start each frame from the frames before it; otherwise from the initial view, or of the up to four
            that are found where none is given from the one that the frame scores best at.
        guide: frames along the clip at which distances are looked up, to choose one path in closed form that all frames
            start from, one where nothing moves, and from aside where that suits better; 0 starts each frame from the
            ones before it alone, as the engines cma and adam, searches but subject_orbit, and a clip without
            warm_start always do.
        zoom: free, fixed at the initial focal length, or auto: fixed where filmic space is undefined, or the reference
            shows nothing before or behind the person, because distance and focal length cannot then be told apart.
            still is auto, but that the path keeps one focal length for all of the clip, whatever that costs; it needs
            path smooth.
        engine: of each frame: refine (least squares on geometry, CMA-ES as rescue), cma (alone) or adam (a baseline). A
            loss without residuals, renders read by networks, or a search whose slopes do not tell every move, turn
            refine into cma, which a note tells. The path through what it found is up to path and joint.
        steps: of refinement at most, each time that a frame is refined: from other starts, or by another Jacobian.
        dampings: tried together in each step of refinement, 1 to 3.
        jacobians: computed afresh per frame at most, after the first frame's; 0 carries one along the clip, and
            computes another only where a frame ends far worse than those before.
        lean: mean total up to which it is enough to follow a clip leanly: one damping, the Jacobian carried from frame
            to frame, nothing rescued; above it, and where it gets worse along the clip or a frame ends far above the
            others, the clip is followed again as the keys around this one say, and the better one is kept. 0 does so
            at once.
        basin: total of the refined first frame above which CMA-ES looks for a better basin.
        rescue: total above which a refined frame is searched by CMA-ES too, if it is also above four times the
            median of the frames before it, ever less often where that does not help; flow counts by half. Of the first
            frame basin says so.
        generations: of the engine cma per frame at most; refine calls CMA-ES with budgets of its own, and takes of
            these five keys sigma0 alone.
        patience: generations without decrease before it stops.
        popsize: candidates a generation.
        sigma0: first step size from the initial view, in the units of x, of which 1 is a large move: of paper_box the
            half-range; of subject_orbit 1 rad about, a factor of 2.2 away; of se3_jaws 1 scene unit, 1 rad.
        warm_sigma: the same for a warm-started frame.
        tolerance: total loss at which a frame is good enough; 1 means every term at its tolerance.
        floaters: drop leaves Gaussians out of the search that hang in the air by themselves, unless what is found is
            far worse among them and can be mended; keep takes the scene as it is. The result always shows them.
        guard: never take a view from inside something, of almost nothing and nobody, or with the person hidden behind
            something.
        clean: standard deviation of the filter on what was read from a clip, before it is aimed at [frames]; yaw flips
            are repaired too, of three frames or more; 0 takes it as it was read. The scores always use what was read.
        path: smooth (the least order, from static to many knots, that costs no more than the noise floor) or exact
            (every frame as it was found).
        joint: rounds in which a smooth path is moved as a whole to where it costs less, unless its loss is small.
        joint_steps: paths evaluated in such a round, at most; more while each saves a tenth.
        adam: how the engine adam descends.
        extract: which extractors read the renders.
        renderer, extractors, losses, search: components by name with their options.
    """

    preset: str = "balanced"
    frames: int | None = None
    seed: int = 0
    threads: int = 0
    search_side: int = 160
    output_side: int = 720
    lod: float = 0.0
    warm_start: bool = True
    guide: int = 5
    zoom: Literal["auto", "free", "fixed", "still"] = "auto"
    engine: Literal["refine", "cma", "adam"] = "cma"
    steps: int = 6
    dampings: int = 3
    jacobians: int = 1
    lean: float = 0.0
    basin: float = 0.3
    rescue: float = 2.0
    generations: int = 100
    patience: int = 20
    popsize: int = 10
    sigma0: float = 0.1
    warm_sigma: float = 0.05
    tolerance: float = 0.0
    floaters: Literal["keep", "drop"] = "keep"
    guard: bool = False
    clean: float = 0.0
    path: Literal["smooth", "exact"] = "exact"
    joint: int = 0
    joint_steps: int = 4
    adam: AdamConfig = field(default_factory=AdamConfig)
    extract: ExtractConfig = field(default_factory=ExtractConfig)
    renderer: dict[str, Any] = field(default_factory=dict)
    extractors: dict[str, Any] = field(default_factory=dict)
    losses: dict[str, Any] = field(default_factory=dict)
    search: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.origins: Mapping[str, str] = {}  # where each key was written, for the errors of what is built of it
        for name, low, high in (
            ("frames", 1, 2000), ("seed", 0, 2**63), ("threads", 0, 1024),
            ("search_side", 16, 4096), ("output_side", 16, 4096),
            ("steps", 1, 1000), ("dampings", 1, 3), ("jacobians", 0, 1000), ("basin", 0.0, 1e6), ("rescue", 0.0, 1e6),
            ("generations", 1, 10**6), ("patience", 1, 10**6), ("popsize", 4, 10**4),
            ("sigma0", 1e-6, 2.0), ("warm_sigma", 1e-6, 2.0), ("tolerance", 0.0, 1e6),
            ("clean", 0.0, 100.0), ("guide", 0, 1000), ("joint", 0, 100), ("joint_steps", 1, 100),
            ("lean", 0.0, 1e6), ("lod", 0.0, 16.0),
        ):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise UsageError("", name, f"expected {low} to {high}, got {value}")

    def build(self, section: str) -> dict[str, Any]:
        """Components of ``section`` by name.

        Raises:
            UsageError: an option has the wrong type or range.
        """
        try:
            return {n: SECTIONS[section].build(n, options) for n, options in getattr(self, section).items()}
        except UsageError as error:
            raise told(error, self.origins) from None

    def build_one(self, section: str) -> Any:
        """The only component of ``section``."""
        return next(iter(self.build(section).values()))
