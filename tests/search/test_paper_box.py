"""The paper's box in a scene of another unit; what all searches have in common is in test_search."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cltransfer.search.paper_box import PaperBox
from cltransfer.testing.samples import sample_subject


@pytest.mark.parametrize("unit", [1.0, 3.28, 0.3])
def test_a_box_of_about_a_person_s_size_says_nothing(unit: float) -> None:
    person = sample_subject()
    assert PaperBox().unit_note(replace(person, height=person.height * unit)) == ""


@pytest.mark.parametrize(("unit", "heights"), [(1000.0, "0.0029"), (0.001, "2.9e+03")])
def test_a_box_of_another_unit_is_told_with_one_that_fits(unit: float, heights: str) -> None:
    person = sample_subject()
    person = replace(person, height=person.height * unit)
    told = PaperBox().unit_note(person)
    assert told.startswith("the camera moves by at most 5 scene units along each axis")
    assert f" {heights} heights of the person: search.paper_box.translation=" in told
    fitting = float(told.partition("translation=")[2].split()[0])
    assert fitting == pytest.approx(3 * person.height, rel=0.1)
    assert PaperBox(translation=fitting).unit_note(person) == ""
