"""What is compared: a method is a name and what it sets over a preset."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from ..config import load_config, to_yaml
from ..config.options import RunConfig
from ..errors import UsageError

# for all: geometric features on both sides, 160 px in the search, one thread, nothing verified by networks
COMMON = ("extract.inner=geometric", "extract.verify=false", "search_side=160", "output_side=160", "threads=1")
TERMS = ("shot_size", "framing", "filmic_space", "camera_movement", "camera_angle")
ROBUST, FAITHFUL = (tuple(f"losses.{name}.mode={mode}" for name in TERMS) for mode in ("robust", "faithful"))
# over the paper's preset: the losses that everybody has here; 40 is the weight of the robust movement
ON_ROBUST_LOSSES = (*ROBUST, "losses.camera_movement.weight=40")
_RENDERERS = {"mesh": "renderer.mesh={}", "grid": "renderer.nerf_grid={}"}  # by the form of a built-in scene


@dataclass(frozen=True)
class Method:
    """How cameras are found.

    Args:
        overrides: config overrides, a preset among them.
        drift: None searches; otherwise the reference's path is replayed from the first frame that the overrides find,
            its scale growing to ``drift`` at the last frame.
        rebuilt: whether that path is rebuilt from the reference's frames, by structure from motion.
    """

    overrides: tuple[str, ...]
    drift: float | None = None
    rebuilt: bool = False


METHODS = {
    "balanced": Method(("preset=balanced",)),
    "fast": Method(("preset=fast",)),
    "max": Method(("preset=max",)),
    "paper": Method(("preset=paper", *ON_ROBUST_LOSSES)),
    # CMA-ES in place of least squares for every frame; what becomes of its path is as in balanced, refined as a whole
    "cma": Method(("preset=balanced", "engine=cma", "generations=100", "patience=20", "popsize=10")),
    "five_adam": Method(("preset=five_adam",)),
    "jaws_clean": Method(("preset=jaws_clean",)),
    "jaws_code": Method(("preset=jaws_code",)),
    "jaws_losses_cma": Method(("preset=jaws_losses_cma",)),
    "replay": Method(("preset=fast",), drift=1.0),
    "replay_drift": Method(("preset=fast",), drift=1.5),
    "replay_rebuilt": Method(("preset=fast",), drift=1.0, rebuilt=True),
}


def method(name: str) -> Method:
    """The method called ``name``.

    Raises:
        UsageError: there is none.
    """
    if name not in METHODS:
        raise UsageError("", f"method {name!r}", "no such method", f"known: {', '.join(METHODS)}")
    return METHODS[name]


def config_of(name: str, pupil: str, seed: int, options: tuple[str, ...] = ()) -> RunConfig:
    """The config of method ``name`` for a transfer into the built-in scene ``pupil``, with ``options`` on top."""
    drawn_by = renderer_override(pupil)
    return load_config(overrides=[*method(name).overrides, *COMMON, *drawn_by, f"seed={seed}", *options])


@cache
def config_text(name: str, pupil: str, seed: int, options: tuple[str, ...]) -> str:
    """:func:`config_of` as YAML and what is replayed; kept: trials share it, and to compose it takes 0.1 s."""
    drift, rebuilt = method(name).drift, method(name).rebuilt
    replay = ("" if drift is None else f"drift: {drift}\n") + ("rebuilt: true\n" if rebuilt else "")
    return to_yaml(config_of(name, pupil, seed, options)) + replay


def judge_config(scene: str, overrides: tuple[str, ...] = ()) -> RunConfig:
    """The config of the judge of a built-in scene: its renderer, the default extractors and the robust losses."""
    return load_config(overrides=["preset=balanced", *renderer_override(scene), *overrides])


def renderer_override(scene: str) -> tuple[str, ...]:
    """What chooses the renderer of a built-in scene, by the form in its name."""
    form = scene.rpartition("-")[2]
    return (_RENDERERS[form],) if form in _RENDERERS else ()
