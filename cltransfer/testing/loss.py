"""What a loss keeps to."""

from __future__ import annotations

import copy
import math

import torch

from ..features import Features
from .cases import ComponentCase, only, same, unchanged
from .samples import PERSON_FEATURES, twice_as_large, without_person

GRID = 0.01  # of a value, that a finer grid may change it by


class LossCase(ComponentCase):
    """What a loss keeps to: zero on itself, NaN without a person, the same alone as in a batch."""

    def larger(self, features: Features) -> Features:
        """The same frames twice as wide and high, maps of extras too; override it for extras in pixels."""
        return twice_as_large(features)

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
        same(self.component(features, features).double(), torch.zeros(3, dtype=torch.float64))

    def test_is_finite_and_not_negative(self) -> None:
        value = self.component(self._sample(1, 3), self._sample(2, 3))
        assert value.shape == (3,)
        assert bool((value >= 0).all())
        assert bool(value.isfinite().all())
        assert bool((value > 0).any())

    def test_batch_equals_single(self) -> None:
        reference, rendered = self._sample(1, 3), self._sample(2, 3)
        single = [self.component(reference[i], rendered[i]) for i in range(3)]
        same(self.component(reference, rendered), torch.cat(single))

    def test_one_reference_serves_a_batch(self) -> None:
        reference, rendered = self._sample(1, 1), self._sample(2, 3)
        single = [self.component(reference, rendered[i]) for i in range(3)]
        same(self.component(reference, rendered), torch.cat(single))

    def test_size_does_not_matter(self) -> None:
        """A clip is larger than what a search renders: what is in pixels is to be divided by the side's ``size``."""
        reference, rendered = self._sample(1, 3), self._sample(2, 3)
        value, twice = (self.component(reference, side).double() for side in (rendered, self.larger(rendered)))
        how = "divide what is in pixels by the size of its side (of extras in pixels override larger)"
        close = torch.isclose(twice, value, rtol=GRID, atol=1e-6, equal_nan=True)
        assert bool(close.all()), f"{value.tolist()} becomes {twice.tolist()} of renders twice as large: {how}"

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
            unchanged(features, copied)

    def test_declared_features_suffice(self) -> None:
        """What it requires and uses is all that it reads; what it only uses may be absent."""
        reference, rendered = self._sample(1, 2), self._sample(2, 2)
        needed = frozenset(self.component.requires)
        read = needed | reference.names() & rendered.names() & frozenset(getattr(self.component, "uses", ()))
        same(
            self.component(reference, rendered),
            self.component(only(reference, read), only(rendered, read)),
        )
        assert self.component(only(reference, needed), only(rendered, needed)).shape == (2,)

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
        same(self.component(reference, rendered), torch.stack(norms).sum(0))

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
        same(told[..., 0][there].double(), residuals[there].double())
