"""The protocol: which shot, drawn how, from which scene into which; see docs/protocol.md."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..models.content import reading
from ..shots import SHOTS, Setup, own_setup
from .judge import HELD_OUT
from .methods import config_text, judge_config

READ = 2  # raise it when networks read renders otherwise; 2: of two people who is filmed, not the largest
PROTOCOL = 3  # raise it when the same trial means something else: rows of older protocols are then measured anew
SCENES = ("room", "stage", "path", "plaza")  # two indoors, two outdoors
FIRST_SEED = 1000  # those below were tuned on; some of these have been seen too, docs/protocol.md
SIZE = (640, 360)  # [px] of a reference
FPS = 12.0


@dataclass(frozen=True)
class Start:
    """How close a shot starts.

    Args:
        closer: times its own coverage: half (as factors go) by a longer lens, half by standing nearer; pans, tilts and
            trucks are so much shorter, or the person would leave the frame.
        aim: above the subject's middle [subject heights].
    """

    closer: float
    aim: float


STARTS = {"LS": Start(1.0, 0.0), "MS": Start(2.4, 0.24), "CU": Start(5.0, 0.38)}


@dataclass(frozen=True)
class Trial:
    """One transfer that is measured.

    Args:
        method: see :mod:`cltransfer.bench.methods`.
        shot: canonical shot.
        teacher: built-in scene that the reference is shot in, with its seed.
        pupil: the one it is taught to, with its seed and form; the teacher itself makes the true cameras known.
        seed: of where the shot stands, and of the method.
        frames: N.
        options: config overrides over the method's.
    """

    method: str
    shot: str
    teacher: str
    pupil: str
    seed: int
    frames: int = 24
    options: tuple[str, ...] = ()

    def key(self, networks: bool = False) -> str:
        """Digest of the trial, the config it comes to, what the judge reads and scores by, and the protocol.

        A row that is read by ``networks`` too is another one, and by other networks yet another.
        """
        config = config_text(self.method, self.pupil, self.seed, self.options)
        judge = judge_config(self.pupil)
        told = [PROTOCOL, asdict(self), config, judge.extractors, judge.losses]
        if networks:
            readers = judge_config(self.pupil, HELD_OUT["networks"]).build("extractors").values()
            told += [READ, *(reading(extractor) for extractor in readers)]
        return row_key(*told)


def row_key(*told: object) -> str:
    """Digest of all that a row depends on, plain values."""
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:16]


def drawn_start(shot: str, teacher: str, seed: int) -> tuple[str, Setup]:
    """Start (a key of :data:`STARTS`) and setup of a shot, drawn by its name, its scene and the seed."""
    digest = hashlib.sha256(f"{shot} {teacher}".encode()).digest()
    rng = np.random.Generator(np.random.PCG64([seed, int.from_bytes(digest[:8], "little")]))
    name = tuple(STARTS)[rng.integers(len(STARTS))]
    own, start = own_setup(shot), STARTS[name]
    assert own.coverage is not None
    assert own.distance is not None
    setup = replace(
        Setup.drawn(rng, seed),
        distance=own.distance / math.sqrt(start.closer),
        coverage=start.closer * own.coverage,
        aim=start.aim,
        reach=1 / start.closer,
    )
    return name, setup


@dataclass(frozen=True)
class Tier:
    """How much is measured.

    Args:
        shots: canonical shots.
        pairs: teacher and pupil; the same twice is a self-transfer.
        per_shot: pairs of each shot, going round ``pairs`` from shot to shot.
        seeds: how many, from :data:`FIRST_SEED` where none are named.
        frames: of each clip.
        options: config overrides of every trial.
    """

    shots: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    per_shot: int
    seeds: int
    frames: int
    options: tuple[str, ...] = ()

    def clips(self, seeds: Sequence[int] = ()) -> Iterator[tuple[str, str, str, int]]:
        """Shot, teacher, pupil and seed of every clip.

        Each shot and seed has people and furniture of its own, and a teacher that they have several times has others
        each time, so that no reference is taught twice. Which pairs a shot has goes by the seed's place among
        ``seeds``, whose repetitions count once.
        """
        chosen = dict.fromkeys(seeds or range(FIRST_SEED, FIRST_SEED + self.seeds))
        for number, seed in enumerate(chosen):
            for index, shot in enumerate(self.shots):
                first = index * self.per_shot + number
                places = [(first + k) % len(self.pairs) for k in range(self.per_shot)]
                for place in places:
                    teacher, pupil = self.pairs[place]
                    before = sum(self.pairs[other][0] == teacher for other in places if other < place)
                    drawn = 2 * (100 * seed + index + len(self.shots) * before)
                    taught = drawn if pupil == teacher else drawn + 1  # another person, unless it is itself
                    yield shot, f"{teacher}-{drawn}", f"{pupil}-{taught}", seed

    def trials(self, methods: Sequence[str], seeds: Sequence[int] = (), form: str = "splats") -> list[Trial]:
        """Every method on every clip, clip by clip; the scene that is taught is of ``form``."""
        suffix = "" if form == "splats" else f"-{form}"
        return [
            Trial(method, shot, teacher, pupil + suffix, seed, self.frames, self.options)
            for shot, teacher, pupil, seed in self.clips(seeds)
            for method in methods
        ]


# neighbours in this order share no scene where that can be: the few pairs of a small tier are spread over all scenes
CROSS = tuple(
    (SCENES[i], SCENES[(i + step) % len(SCENES)]) for step, i in itertools.product((1, 2, 3), range(len(SCENES)))
)
SELF = tuple((scene, scene) for scene in SCENES)

# smoke cuts the budgets of the gradient baselines to a tenth: it shows that a bench works and compares nothing
TIERS = {
    "smoke": Tier(
        ("push_in", "orbit", "dolly_zoom"), (("plaza", "room"),), 1, 1, 8, ("adam.iterations=4", "search_side=96")
    ),
    "standard": Tier(SHOTS, CROSS + SELF, 2, 1, 24),
    "full": Tier(SHOTS, CROSS + SELF, len(CROSS + SELF), 5, 24),
}
