"""What a loss and an extractor keep to."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor

from ..features import Features
from .samples import PERSON_FEATURES, sample_features, without_person


def _same(first: Tensor, second: Tensor) -> None:
    torch.testing.assert_close(first, second, rtol=1e-5, atol=1e-6, equal_nan=True)


def _unchanged(features: Features, copied: Features) -> None:
    for name in features.names() - {"camera", "person"}:
        _same(features.require(name), copied.require(name))


def _only(features: Features, names: frozenset[str]) -> Features:
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
        params: Any = getattr(type(self.component), "__dataclass_params__", None)
        assert params is not None
        assert params.frozen


class LossCase(ComponentCase):
    """What a loss keeps to: zero on itself, NaN without a person, the same alone as in a batch."""

    def test_names_what_it_requires(self) -> None:
        loss = self.component
        assert loss.requires
        self._sample(0, 1)
        assert loss.unit
        assert math.isfinite(loss.weight)
        assert loss.weight >= 0

    def test_penalty_is_finite_and_positive(self) -> None:
        assert 0 < self.component.penalty < math.inf

    def test_scores_itself_zero(self) -> None:
        features = self._sample(1, 3)
        _same(self.component(features, features).double(), torch.zeros(3, dtype=torch.float64))

    def test_is_finite_and_not_negative(self) -> None:
        value = self.component(self._sample(1, 3), self._sample(2, 3))
        assert value.shape == (3,)
        assert bool((value >= 0).all())
        assert bool(value.isfinite().all())
        assert bool((value > 0).any())

    def test_batch_equals_single(self) -> None:
        reference, rendered = self._sample(1, 3), self._sample(2, 3)
        single = [self.component(reference[i], rendered[i]) for i in range(3)]
        _same(self.component(reference, rendered), torch.cat(single))

    def test_one_reference_serves_a_batch(self) -> None:
        reference, rendered = self._sample(1, 1), self._sample(2, 3)
        single = [self.component(reference, rendered[i]) for i in range(3)]
        _same(self.component(reference, rendered), torch.cat(single))

    def test_person_missing_is_undefined(self) -> None:
        reference, rendered = self._sample(1, 2), without_person(self._sample(2, 2))
        about_person = PERSON_FEATURES & set(self.component.requires)
        value = self.component(reference, rendered)
        assert bool((value.isnan() if about_person else ~(value < 0)).all())

    def test_nobody_in_the_reference_is_undefined(self) -> None:
        """Else its frames without a person would count as ones that have the loss, which nothing rendered has."""
        if not PERSON_FEATURES & set(self.component.requires):
            return
        nobody, rendered = without_person(self._sample(1, 2)), self._sample(2, 2)
        assert bool(self.component(nobody, rendered).isnan().all())
        assert bool(self.component(nobody, without_person(rendered)).isnan().all())

    def test_changes_nothing_in_place(self) -> None:
        """One reference is compared with many renders."""
        sides = self._sample(1, 2), self._sample(2, 2)
        kept = copy.deepcopy(sides)
        self.component(*sides)
        for features, copied in zip(sides, kept):
            _unchanged(features, copied)

    def test_declared_features_suffice(self) -> None:
        """What it requires and uses is all that it reads; what it only uses may be absent."""
        reference, rendered = self._sample(1, 2), self._sample(2, 2)
        needed = frozenset(self.component.requires)
        read = needed | reference.names() & rendered.names() & frozenset(getattr(self.component, "uses", ()))
        _same(
            self.component(reference, rendered),
            self.component(_only(reference, read), _only(rendered, read)),
        )
        assert self.component(_only(reference, needed), _only(rendered, needed)).shape == (2,)

    def test_residuals_add_up_to_the_loss(self) -> None:
        """Loss = sum over the groups of the norm of their residuals, where a loss has any."""
        reference, rendered = self._sample(1, 3), self._sample(2, 3)
        residuals = getattr(self.component, "residuals", None)
        if residuals is None:
            return
        values, groups = residuals(reference, rendered), torch.tensor(self.component.groups)
        assert values.shape == (3, len(groups))
        assert len(getattr(self.component, "signs", ())) in (0, len(groups))
        norms = [values[:, groups == group].norm(dim=1) for group in groups.unique()]
        _same(self.component(reference, rendered), torch.stack(norms).sum(0))

    def test_residuals_are_undefined_where_it_is(self) -> None:
        """Else a search by residuals, which compares one frame with many views, loses the person for nothing."""
        reference, seen = self._sample(1, 1), self._sample(2, 3)
        residuals = getattr(self.component, "residuals", None)
        if residuals is None:
            return
        for rendered in (seen, Features.concatenate([seen[:1], without_person(seen)[1:]])):
            values, shape = residuals(reference, rendered), (3, len(self.component.groups))
            assert values.shape == shape, f"expected {shape} of one reference and three views, got {values.shape}"
            numbers = values.isfinite().all(1), self.component(reference, rendered).isfinite()
            assert torch.equal(*numbers), "a term is NaN in both or in neither, its value and its residuals"

    def test_tells_residuals_beyond_its_jumps(self) -> None:
        """What they are beyond one, and how far it is from there: as they are where that is 0 or less."""
        reference, rendered = self._sample(1, 3), self._sample(2, 3)
        beyond = getattr(self.component, "beyond", None)
        if beyond is None:
            return
        residuals = self.component.residuals(reference, rendered)
        told = beyond(reference, rendered)
        assert told.shape == (*residuals.shape, 2)
        there = told[..., 1] <= 0
        _same(told[..., 0][there].double(), residuals[there].double())


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
        return _only(features, features.names() - set(self.component.provides))

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
                _unchanged(features, copied)

    def test_batch_equals_single(self) -> None:
        if getattr(self.component, "whole_clip", False):
            return  # of one frame it tells nothing
        now = self.blank(self._sample(1, 3))
        before = self.before(now)
        together = self.component(now, before)
        for i in range(3):
            alone = self.component(now[i], before[i] if before is not None else None)
            for name in self.component.provides:
                _same(together[i].require(name), alone.require(name))

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
                _same(together[i].require(name), alone.require(name))

    def test_declared_features_suffice(self) -> None:
        now = self._sample(1, 2)
        before, needed = self.before(now), frozenset(self.component.requires)
        lean = self.run(_only(now, needed), _only(before, needed) if before is not None else None)
        assert all(lean.has(name) or name in lean.reasons for name in self.component.provides)
