"""A loss that costs nothing where it should, or other than it says, does not keep to the contract."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor
from torch.nn.functional import interpolate

from cltransfer.features import Features
from cltransfer.testing import LossCase, sample_features, twice_as_large


@dataclass(frozen=True)
class GazeMatch:
    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("gaze",)
    unit: ClassVar[str] = "rad"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return (rendered.require("gaze") - reference.require("gaze")).abs().sum(1)


class TestGazeMatch(LossCase):
    component = GazeMatch()

    def sample(self, seed: int, batch: int) -> Features:
        gaze = torch.rand(batch, 2, generator=torch.Generator().manual_seed(seed))
        return sample_features(seed, batch).having("gaze", gaze)


class Unaware(LossCase):
    component: ClassVar[Any] = GazeMatch()


@pytest.mark.parametrize("test", ["test_names_what_it_requires", "test_scores_itself_zero", "test_batch_equals_single"])
def test_a_feature_that_the_frames_lack_is_named_with_how_to_give_it(test: str) -> None:
    with pytest.raises(AssertionError, match=r"^sample gives no gaze: override sample\(self, seed, batch\), .*'gaze'"):
        getattr(Unaware(), test)()


@dataclass(frozen=True)
class Careless:
    """How large the person is; of nobody 0, and it writes on what it was given."""

    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("subject",)
    unit: ClassVar[str] = "frame"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        sizes = [side.require("subject").float().mean((1, 2)) for side in (reference, rendered)]
        value = (sizes[1] - sizes[0]).abs().masked_fill(sizes[1] == 0, torch.nan)
        reference.require("subject")[:, 0] = True
        return value


class OfCareless(LossCase):
    component: ClassVar[Any] = Careless()


@pytest.mark.parametrize("test", ["test_nobody_in_the_reference_is_undefined", "test_changes_nothing_in_place"])
def test_a_careless_loss_is_found_out(test: str) -> None:
    with pytest.raises(AssertionError):
        getattr(OfCareless(), test)()


@dataclass(frozen=True)
class Aside:
    """How far the box is from where it should be; its residuals are the careless thing that ``how`` says."""

    how: str = ""
    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("box",)
    unit: ClassVar[str] = "frame"
    penalty: ClassVar[float] = 1.0
    groups: ClassVar[tuple[int, ...]] = (0,)

    def residuals(self, reference: Features, rendered: Features) -> Tensor:
        wanted, found = (side.require("box")[:, 0] / side.size[0] for side in (reference, rendered))
        rows = len(wanted) if self.how == "of the reference" else len(found)
        apart = (found - wanted)[:rows, None]
        return apart.nan_to_num(0.0) if self.how == "of nobody" else apart

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        return replace(self, how="").residuals(reference, rendered)[:, 0].abs()


@pytest.mark.parametrize(
    ("how", "told"), [("of nobody", "NaN in both or in neither"), ("of the reference", r"expected \(3, 1\) of one ref")]
)
def test_residuals_that_a_search_finds_nobody_by_are_found_out(how: str, told: str) -> None:
    class OfAside(LossCase):
        component: ClassVar[Any] = Aside(how)

    OfAside().test_residuals_add_up_to_the_loss()
    with pytest.raises(AssertionError, match=told):
        OfAside().test_residuals_are_undefined_where_it_is()
    OfAside.component = Aside()
    OfAside().test_residuals_are_undefined_where_it_is()


@dataclass(frozen=True)
class Headroom:
    """Difference of the room above the head, as a part of the frame or in its pixels."""

    by: str = "its size"
    weight: float = 1.0
    requires: ClassVar[tuple[str, ...]] = ("keypoints", "subject", "flow")
    unit: ClassVar[str] = "frame"
    penalty: ClassVar[float] = 1.0

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        wanted, found = (self.of(side, reference.size[1]) for side in (reference, rendered))
        return (found - wanted).abs()

    def of(self, side: Features, wanted: int) -> Tensor:
        if self.by == "pixels of the person":
            return side.require("subject").flatten(1).sum(1)
        if self.by == "pixels of flow":
            return side.require("flow")[:, 0].flatten(1).abs().mean(1)
        room = side.require("keypoints")[:, 12, 1]
        return room / {"its size": side.size[1], "one side's size": wanted}.get(self.by, 1)


@pytest.mark.parametrize("by", ["pixels", "one side's size", "pixels of the person", "pixels of flow"])
def test_a_loss_of_pixels_is_found_out(by: str) -> None:
    class OfHeadroom(LossCase):
        component: ClassVar[Any] = Headroom(by)

    OfHeadroom().test_is_finite_and_not_negative()
    with pytest.raises(AssertionError, match=r"of renders twice as large: divide what is in pixels by the size of"):
        OfHeadroom().test_size_does_not_matter()
    OfHeadroom.component = Headroom()
    OfHeadroom().test_size_does_not_matter()


class TestALossOnAnExtraInPixels(LossCase):
    @dataclass(frozen=True)
    class Horizon(GazeMatch):
        requires: ClassVar[tuple[str, ...]] = ("horizon",)

        def __call__(self, reference: Features, rendered: Features) -> Tensor:
            wanted, found = (side.require("horizon") / side.size[1] for side in (reference, rendered))
            return (found - wanted).abs()

    component = Horizon()

    def sample(self, seed: int, batch: int) -> Features:
        rows = 36 * torch.rand(batch, generator=torch.Generator().manual_seed(seed))
        return sample_features(seed, batch).having("horizon", rows)

    def larger(self, features: Features) -> Features:
        return twice_as_large(features).having("horizon", 2 * features.require("horizon"))


@dataclass(frozen=True)
class Likeness(GazeMatch):
    """Difference of the images as a network would see them, at its own size."""

    requires: ClassVar[tuple[str, ...]] = ("image",)
    power: int = 1

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        wanted, found = (
            interpolate(side.require("image"), (224, 224), mode="bilinear") for side in (reference, rendered)
        )
        return (found - wanted).abs().pow(self.power).flatten(1).mean(1)


class TestALossAtASizeOfItsOwn(LossCase):
    component = Likeness()


class TestALossOfSquaresAtASizeOfItsOwn(LossCase):
    component = Likeness(power=2)


@dataclass(frozen=True)
class InFocus(GazeMatch):
    """How much of the person is in focus, by a map of a plugin's own."""

    requires: ClassVar[tuple[str, ...]] = ("subject", "focus")

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        wanted, found = (self.of(side) for side in (reference, rendered))
        return (found - wanted).abs()

    def of(self, side: Features) -> Tensor:
        person = side.require("subject")
        share: Tensor = (side.require("focus")[:, 0] * person).flatten(1).sum(1) / person.flatten(1).sum(1)
        return share.where(person.flatten(1).any(1), torch.nan)


class TestALossOnAMapOfAPluginsOwn(LossCase):
    component = InFocus()

    def sample(self, seed: int, batch: int) -> Features:
        focus = torch.rand(batch, 1, 36, 64, generator=torch.Generator().manual_seed(seed))
        return sample_features(seed, batch).having("focus", focus)


@dataclass(frozen=True)
class Sure(GazeMatch):
    """Counts for less where nobody is sure."""

    uses: ClassVar[tuple[str, ...]] = ("surety",)

    def __call__(self, reference: Features, rendered: Features) -> Tensor:
        value = super().__call__(reference, rendered)
        return value * rendered.require("surety") if rendered.has("surety") else value


class TestWhatALossUsesItMayRead(LossCase):
    component = Sure()

    def sample(self, seed: int, batch: int) -> Features:
        drawn = torch.rand(batch, 3, generator=torch.Generator().manual_seed(seed))
        return sample_features(seed, batch).having("gaze", drawn[:, :2]).having("surety", 0.5 + drawn[:, 2])
