"""Contract cases that a component's test inherits, and the features they are run on.

A test class names its component, and pytest runs the contract::

    class TestRuleOfThirds(LossCase):
        component = RuleOfThirds()
"""

from __future__ import annotations

from .cases import ComponentCase, ExtractorCase
from .loss import LossCase
from .renderer import RendererCase
from .samples import sample_cameras, sample_features, sample_subject, twice_as_large, without_person

__all__ = [
    "ComponentCase",
    "ExtractorCase",
    "LossCase",
    "RendererCase",
    "sample_cameras",
    "sample_features",
    "sample_subject",
    "twice_as_large",
    "without_person",
]
