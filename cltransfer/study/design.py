"""What a study compares: samples, methods, and tokens that say nothing about either."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, UsageError
from ..storage.files import read_json

# the paper's three criteria (Sec. 6.4), asked of two anonymised videos beside the reference
QUESTIONS = {
    "visual_style": "Which one is closer to the reference in its visual style?",
    "smoothness": "Which one is smoother?",
    "naturalness": "Which one looks more natural?",
}
FORMAT = "cltransfer.study"
NO_STUDY = "Without people who answer it, this is no user study."


@dataclass(frozen=True)
class Clip:
    """One video that is shown: whose it is, and under which token."""

    token: str
    sample: str
    method: str


@dataclass(frozen=True)
class Item:
    """One comparison: two clips of one sample, in the order of the methods."""

    name: str
    sample: str
    first: str  # token
    second: str  # token


@dataclass(frozen=True)
class Study:
    """A study, as its key file keeps it.

    Args:
        name: digest of what is compared and of the seed.
        methods: in the order in which they were named.
        clips: by token.
        items: every pair of methods on every sample.
    """

    name: str
    methods: tuple[str, ...]
    clips: dict[str, Clip]
    items: tuple[Item, ...]

    @classmethod
    def load(cls, path: Path) -> Study:
        """The study of a key file.

        Raises:
            InputError: the file is no key.
        """
        raw = read_json(path)
        try:
            if raw["format"] != FORMAT:
                raise ValueError
            clips = {token: Clip(token, **said) for token, said in raw["clips"].items()}
            items = tuple(Item(**item) for item in raw["items"])
            known = all(item.first in clips and item.second in clips for item in items)
            pairs = known and all(
                clips[item.first].sample == clips[item.second].sample == item.sample
                and clips[item.first].method != clips[item.second].method
                for item in items
            )
            texts = all(isinstance(method, str) for method in raw["methods"])
            once = len({item.name for item in items}) == len(items) and len(set(raw["methods"])) == len(raw["methods"])
            if not (pairs and texts and once) or {clip.method for clip in clips.values()} != set(raw["methods"]):
                raise ValueError
            return cls(str(raw["study"]), tuple(map(str, raw["methods"])), clips, items)
        except (TypeError, ValueError, KeyError, AttributeError):
            raise InputError(path, "", "is not the key of a study", "expected the .key.json beside the page") from None

    def to_json(self) -> dict[str, Any]:
        """Plain values for the key file."""
        return {
            "format": FORMAT,
            "version": 1,
            "study": self.name,
            "methods": list(self.methods),
            "clips": {c.token: {"sample": c.sample, "method": c.method} for c in self.clips.values()},
            "items": [vars(item) for item in self.items],
        }


def design(samples: Sequence[str], methods: Sequence[str], content: Iterable[str], seed: int) -> Study:
    """Every pair of ``methods`` on every one of ``samples``, under tokens drawn from ``seed``.

    Args:
        samples: names, of the references.
        methods: names, two or more.
        content: digests of what is shown, so that two studies are not taken for one.
        seed: of the tokens and of the study's name.

    Raises:
        UsageError: a name occurs twice, or there are fewer than two methods.
    """
    if len(methods) < 2 or len(set(methods)) < len(methods) or not all(methods):
        raise UsageError("", "--method", "expected two names or more, all different", f"got {', '.join(methods)}")
    text = "\0".join([str(seed), *samples, *methods, *content])
    digest = hashlib.sha256(text.encode()).digest()
    rng = np.random.Generator(np.random.PCG64(list(digest)))
    shown = [(sample, method) for sample in samples for method in methods]
    numbers = rng.choice(16**6, size=len(shown), replace=False)
    tokens = [f"{number:06x}" for number in numbers.tolist()]
    clips = {token: Clip(token, *said) for token, said in zip(tokens, shown)}
    token_of = {(clip.sample, clip.method): token for token, clip in clips.items()}
    pairs = [(sample, pair) for sample in samples for pair in combinations(rng.permutation(list(methods)).tolist(), 2)]
    items = [
        Item(f"item{i + 1}", sample, *(token_of[sample, method] for method in sorted(pair, key=list(methods).index)))
        for i, (sample, pair) in enumerate(pairs)
    ]
    return Study(digest.hex()[:12], tuple(methods), clips, tuple(items))
