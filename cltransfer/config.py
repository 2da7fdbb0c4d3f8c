"""Config: one YAML grammar, one parent by ``base``, ``key=value`` on top; checked before anything heavy loads.

``section: {name: {options}}`` names a component of a registry; ``null`` removes what the parent had. A config names
components, it never loads code: see :mod:`cltransfer.plugins`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any, Literal

from .config_adam import AdamConfig
from .config_layers import ONE_EACH, Layer, origin, parse_overrides, read_yaml
from .errors import UsageError
from .registry import EXTRACTORS, LOSSES, RENDERERS, SEARCHES, Registry
from .typed import nearest, typed

SECTIONS: dict[str, Registry[Any]] = {
    "renderer": RENDERERS,
    "extractors": EXTRACTORS,
    "losses": LOSSES,
    "search": SEARCHES,
}
COMMAND_LINE = "command line"


@dataclass
class ExtractConfig:
    """Which extractors read the renders.

    Args:
        inner: inside the search, geometric (scene extractors) or image (networks).
        verify: read the result of a clip's transfer with the networks that read the clip.
        corrections: rounds in which the networks' bias is measured on the result and aimed off in a new search.
        bias: robust (steady along the clip) or frame (every frame's own difference, noise and all).
    """

    inner: Literal["geometric", "image"] = "geometric"
    verify: bool = True
    corrections: int = 0
    bias: Literal["robust", "frame"] = "robust"


@dataclass
class RunConfig:
    """Everything a run depends on beside its scene and its reference.

    Args:
        preset: the shipped config the others build on.
        frames: frames to transfer, evenly over the reference; null takes all.
        seed: of the run's own random generator.
        threads: of kernels, OpenCV and networks; 0 takes what CLTRANSFER_THREADS says, else every core there is.
        search_side: longer side of the frames rendered while searching [px].
        output_side: longer side of the final video [px].
        lod: level of detail while searching: splats that share a voxel of so many pixels are merged; 0 merges nothing.
            The result is rendered and scored in full.
        warm_start: start each frame from the frames before it; otherwise from the initial view.
        guide: frames along the clip at which every distance is tried, to choose one path in closed form that all frames
            start from; 0 starts each frame from the ones before it alone.
        zoom: free, fixed at the initial focal length, or auto: fixed where filmic space is undefined, because
            distance and focal length cannot then be told apart.
        engine: refine (least squares on geometry, CMA-ES as rescue), cma (alone) or adam (a baseline). A loss without
            residuals, or renders read by networks, turn refine into cma.
        steps: of refinement per frame at most.
        dampings: tried together in each step of refinement, 1 to 3.
        jacobians: computed afresh per frame at most, after the first frame's; 0 carries one along the clip, and
            computes another only where a frame ends far worse than those before.
        lean: mean total up to which it is enough to follow a clip leanly: one damping, the Jacobian carried from frame
            to frame, nothing rescued; above it, and where it gets worse along the clip, the clip is followed again as
            the keys around this one say, and the better one is kept. 0 does so at once.
        basin: total of the refined first frame above which CMA-ES looks for a better basin.
        rescue: total above which a refined frame is searched by CMA-ES too.
        generations: of the engine cma per frame at most; refine calls CMA-ES with budgets of its own, and takes of
            these five keys sigma0 alone.
        patience: generations without decrease before it stops.
        popsize: candidates a generation.
        sigma0: first step size from the initial view, in the units of x, of which 1 is a large move: of paper_box the
            half-range; of subject_orbit 1 rad about, a factor of 2.2 away; of se3_jaws 1 scene unit, 1 rad.
        warm_sigma: the same for a warm-started frame.
        tolerance: total loss at which a frame is good enough; 1 means every term at its tolerance.
        guard: never take a view from inside something, of almost nothing, or with the person hidden behind something.
        clean: standard deviation of the filter on what was read from a clip, before it is aimed at [frames]; yaw flips
            are repaired too; 0 takes it as it was read. The scores always use what was read.
        path: smooth (the least order, from static to many knots, that costs no more than the noise floor) or exact
            (every frame as it was found).
        joint: rounds in which a smooth path is moved as a whole to where it costs less, unless its loss is small.
        joint_steps: paths evaluated in such a round, at most.
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
    zoom: Literal["auto", "free", "fixed"] = "auto"
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
            raise _told(error, self.origins) from None

    def build_one(self, section: str) -> Any:
        """The only component of ``section``."""
        return next(iter(self.build(section).values()))

    def to_yaml(self) -> str:
        """The merged config, complete and re-runnable: what the preset has and this config has not is null."""
        from omegaconf import OmegaConf

        raw, below = dataclasses.asdict(self), _read(shipped_configs() / f"{self.preset}.yaml").values
        for section in set(SECTIONS) - set(ONE_EACH):
            raw[section] |= {name: None for name in below.get(section) or {} if name not in raw[section]}
        return OmegaConf.to_yaml(OmegaConf.create(raw))


def presets() -> list[str]:
    """Names of the shipped configs."""
    return sorted(p.name[: -len(".yaml")] for p in shipped_configs().iterdir() if p.name.endswith(".yaml"))


def load_config(path: str | Path | None = None, overrides: Iterable[str] = ()) -> RunConfig:
    """Config of a file (or of the preset alone) with ``key=value`` overrides on top.

    A shipped file may be named without its folder and suffix, as ``networks/paper``.
    ``preset=NAME`` among the overrides, or ``preset:`` in the file, chooses what lies below (default: balanced).

    Raises:
        UsageError: a file is missing, too large or no YAML; an unknown key, component or option (the nearest is
            named), a value of the wrong type or range.
    """
    above = layer_of(parse_overrides(overrides), COMMAND_LINE)
    if "base" in above.values:
        raise UsageError(
            COMMAND_LINE, "base", "expected in a file, which it lies below", "use --config FILE or preset=NAME"
        )
    return lay_config([_read_chain(_named(Path(path))), above] if path else [above])


def layer_of(values: Mapping[str, Any], where: str | Path) -> Layer:
    """The layer of ``values`` that are written in ``where``, their names checked.

    Raises:
        UsageError: an unknown key, component or option; the nearest is named.
    """
    _check(values, where)
    return Layer.written(values, where)


def lay_config(layers: Sequence[Layer]) -> RunConfig:
    """Config of ``layers``, the last on top, over the preset that the highest of them names (default: balanced).

    Raises:
        UsageError: as :func:`load_config`, in the name of the layer that is to blame.
    """
    preset, where = next(
        ((layer.values["preset"], layer.origins["preset"]) for layer in reversed(layers) if "preset" in layer.values),
        ("balanced", ""),
    )
    if preset not in presets():
        raise UsageError(where, "preset", f"no preset {preset!r}", nearest(str(preset), presets()))
    merged = _read(shipped_configs() / f"{preset}.yaml")
    for layer in layers:
        merged = layer.over(merged)
    config = _typed({**merged.values, "preset": preset}, merged.origins)
    config.origins = merged.origins
    return config


def shipped_configs() -> Any:
    """The folder of the shipped configs, in a checkout as when installed."""
    installed = package_files("cltransfer") / "configs"
    return installed if installed.is_dir() else Path(__file__).resolve().parent.parent / "configs"


def _named(path: Path) -> Path:
    """The file, or where there is none a shipped one by its name alone, as ``networks/paper``.

    Raises:
        UsageError: there is neither; the nearest shipped one is named.
    """
    if path.exists():
        return path
    shipped = Path(str(shipped_configs()))
    named = [*presets(), *(f"networks/{found.stem}" for found in sorted((shipped / "networks").glob("*.yaml")))]
    if str(path) not in named:
        raise UsageError(path, "", "no such file", nearest(str(path.with_suffix("")), named))
    return shipped / f"{path}.yaml"


def _read_chain(path: Path) -> Layer:
    """A file over its ``base``; the base is named beside it and may name no other."""
    own = _read(path)
    base = own.values.get("base")
    if base is None:
        return own
    parent_path = path.parent / str(base)
    if not parent_path.resolve().is_relative_to(path.parent.resolve().parent):
        raise UsageError(path, "base", "expected a file in this folder or the one above", f"got {base}")
    parent = _read(parent_path)
    if "base" in parent.values:
        raise UsageError(parent_path, "base", "a base names no further base", "merge the two files")
    return own.over(parent)


def _read(path: Any) -> Layer:
    return layer_of(read_yaml(path), path)


def _check(raw: Mapping[str, Any], where: Any) -> None:
    """Names at both levels, without importing a component."""
    known = [f.name for f in dataclasses.fields(RunConfig)]
    for key, value in raw.items():
        if key not in known and key != "base":
            raise UsageError(where, str(key), "no such key", nearest(str(key), known))
        if key in SECTIONS:
            _check_section(key, value, where)


def _check_section(section: str, value: Any, where: Any) -> None:
    if value is None:
        return
    if not isinstance(value, Mapping):
        raise UsageError(where, section, "expected name: {options}", f"got {value!r}")
    registry = SECTIONS[section]
    for name, options in value.items():
        if str(name) not in registry.names():
            hint = f"{nearest(name, registry.names())}; a plugin needs --allow-plugin"
            raise UsageError(where, f"{section}.{name}", f"no such {registry.kind}", hint)
        if options is None:
            continue
        if not isinstance(options, Mapping):
            raise UsageError(where, f"{section}.{name}", "expected options as a mapping", "write {} for the defaults")
        declared = registry.declared_options(str(name))
        for option in options:
            if option not in declared:
                raise UsageError(where, f"{section}.{name}.{option}", "no such option", nearest(option, declared))


def _typed(merged: Mapping[str, Any], origins: Mapping[str, str]) -> RunConfig:
    clean = {k: v for k, v in merged.items() if k != "base"}
    for section in SECTIONS:
        named = {n: o for n, o in (clean.get(section) or {}).items() if o is not None}
        if section in ONE_EACH and len(named) != 1:
            where = origin(origins, section)
            raise UsageError(where, section, f"expected exactly one, got {len(named)}", ", ".join(named))
        clean[section] = named
    if not clean["losses"]:
        where = origin(origins, "losses")
        raise UsageError(where, "losses", "expected at least one", f"known: {', '.join(LOSSES.names())}")
    try:
        return typed(RunConfig, clean)
    except UsageError as error:
        raise _told(error, origins) from None


def _told(error: UsageError, origins: Mapping[str, str]) -> UsageError:
    """``error`` with where its key was written."""
    return UsageError(error.where or origin(origins, error.field), error.field, error.reason, error.hint)
