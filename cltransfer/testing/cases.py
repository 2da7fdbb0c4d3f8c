"""What every component keeps to, and an extractor."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor

from ..feature_values import odd_values
from ..features import Features
from ..pipeline.given import replaced
from ..registry.declared import odd_options
from .samples import sample_features


def same(first: Tensor, second: Tensor) -> None:
    """Assert that both are the same but for rounding, NaN where both are."""
    torch.testing.assert_close(first, second, rtol=1e-5, atol=1e-6, equal_nan=True)


def unchanged(features: Features, copied: Features) -> None:
    """Assert that ``features`` are still as their copy is."""
    for name in features.names() - {"camera", "person"}:
        same(features.require(name), copied.require(name))


def only(features: Features, names: frozenset[str]) -> Features:
    """Those of ``names`` alone, and no more than what they hold."""
    keep: Mapping[str, Any] = {n: features.require(n) for n in names if n not in features.extras}
    extras = {n: v for n, v in features.extras.items() if n in names}
    return Features(features.size, **keep, extras=extras)


class ComponentCase:
    """What every component keeps to."""

    component: ClassVar[Any]

    def sample(self, seed: int, batch: int) -> Features:
        """Features to run on; override it for a component that needs extras."""
        return sample_features(seed, batch)

    def _sample(self, seed: int, batch: int) -> Features:
        """What :meth:`sample` gives, which has to be all that the component requires."""
        features = self.sample(seed, batch)
        lacking = ", ".join(sorted(set(getattr(self.component, "requires", ())) - features.names()))
        how = f"sample_features(seed, batch).having({lacking.partition(',')[0]!r}, ...)"
        assert not lacking, f"sample gives no {lacking}: override sample(self, seed, batch), return {how} or the like"
        return features

    def test_is_frozen_dataclass(self) -> None:
        odd = odd_options(type(self.component))
        assert odd is None, f"{odd[0]} ({odd[1]})"


class ExtractorCase(ComponentCase):
    """What an extractor keeps to: it provides what it says from what it says, and changes nothing."""

    def run(self, now: Features, before: Features | None) -> Features:
        """What the component makes of frames: those of a whole clip, where it reads nothing else."""
        if getattr(self.component, "whole_clip", False):
            return self.component.read_clip(now, lambda start, stop: now[start:stop])
        return self.component(now, before)

    def before(self, now: Features) -> Features | None:
        """The frames before ``now``, for an extractor that compares with them."""
        return self.sample(7, len(now)) if getattr(self.component, "needs_before", False) else None

    def blank(self, features: Features) -> Features:
        """``features`` without what the extractor provides."""
        return only(features, features.names() - set(self.component.provides))

    def test_provides_what_it_says(self) -> None:
        now = self.blank(self._sample(1, 3))
        got = self.run(now, self.before(now))
        given = set(self.component.provides) - got.reasons.keys()  # a clip may not tell, which has a reason
        assert got.names() == now.names() | given
        assert all(len(got.require(name)) == 3 for name in given)

    def test_changes_nothing_in_place(self) -> None:
        now = self._sample(1, 2)
        before = self.before(now)
        kept = copy.deepcopy((now, before))
        self.run(now, before)
        for features, copied in zip((now, before), kept):
            if features is not None and copied is not None:
                unchanged(features, copied)

    def test_values_are_of_the_features_units(self) -> None:
        """Pixels, radians and confidence in about [0, 1], as any reading of a clip asks for."""
        now = self.blank(self._sample(1, 3))
        odd = odd_values(self.run(now, self.before(now)), self.component.provides)
        assert odd is None, f"{odd[0]}: {odd[1]} ({odd[2]})"

    def test_leaves_what_it_was_given(self) -> None:
        """Whatever is read after it would read another image, or another person."""
        now = self.blank(self._sample(1, 2))
        other = replaced(self.run(now, self.before(now)), now, self.component.provides)
        assert not other, f"{', '.join(other)} is another: give it a name of its own, or name it in provides"

    def test_batch_equals_single(self) -> None:
        if getattr(self.component, "whole_clip", False):
            return  # of one frame it tells nothing
        now = self.blank(self._sample(1, 3))
        before = self.before(now)
        together = self.component(now, before)
        for i in range(3):
            alone = self.component(now[i], before[i] if before is not None else None)
            for name in self.component.provides:
                same(together[i].require(name), alone.require(name))

    def test_one_frame_before_serves_a_batch(self) -> None:
        """A search compares many candidates with one frame before them."""
        now = self.blank(self._sample(1, 3))
        before = self.before(now)
        if before is None:
            return
        together = self.component(now, before[:1])
        for i in range(3):
            alone = self.component(now[i], before[:1])
            for name in self.component.provides:
                same(together[i].require(name), alone.require(name))

    def test_declared_features_suffice(self) -> None:
        """What it requires and uses is all that it reads; what it only uses may be absent."""
        now = self.blank(self._sample(1, 2))
        before, needed = self.before(now), frozenset(self.component.requires)
        read = needed | now.names() & frozenset(getattr(self.component, "uses", ()))
        declared, lean = (
            self.run(only(now, names), only(before, names) if before is not None else None) for names in (read, needed)
        )
        whole = self.run(now, before)
        for name in self.component.provides:
            assert lean.has(name) or name in lean.reasons
            assert whole.has(name) == declared.has(name), f"{name} is of what is neither required nor used"
            if whole.has(name):
                same(declared.require(name), whole.require(name))
