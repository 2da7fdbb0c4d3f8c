"""What a config builds, and which extractors its losses need for a clip or for renders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .config import RunConfig
from .plan import CLIP_SOURCE, Family, Plan, make_plan

SCENE_SOURCE = frozenset({"camera", "person"})


@dataclass(frozen=True)
class Components:
    """What a config builds.

    Args:
        renderer: the one renderer.
        extractors: by name.
        losses: by name, in the config's order.
    """

    renderer: Any
    extractors: Mapping[str, Any]
    losses: Mapping[str, Any]

    @classmethod
    def build(cls, config: RunConfig) -> Components:
        """Components of ``config``.

        Raises:
            UsageError: an option has the wrong type or range.
        """
        return cls(config.build_one("renderer"), config.build("extractors"), config.build("losses"))

    def plan(self, family: Family, shared: frozenset[str] | None = None) -> Plan:
        """Plan for a clip, or renders as pixels (image), or for renders with all a renderer knows (scene).

        ``shared`` names what the other side has: a loss that the other side cannot feed asks for nothing.
        """
        source = CLIP_SOURCE if family == "image" else frozenset(self.renderer.provides) | SCENE_SOURCE
        wanted: set[str] = set()
        uses: set[str] = set()
        for loss in self.losses.values():
            if shared is None or shared >= set(loss.requires):
                wanted.update(loss.requires)
                uses.update(getattr(loss, "uses", ()))
        return make_plan(frozenset(wanted), self.extractors, source, family, shared, frozenset(uses))
