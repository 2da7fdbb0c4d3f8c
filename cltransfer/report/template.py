"""Pages from templates that lie beside the code: what is filled in stays text, and nothing is left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined


def rendered(path: Path, **values: Any) -> str:
    """The template in the file ``path`` with ``values``; they are escaped, but for Markup.

    Raises:
        UndefinedError: the template names a value that is not given.
    """
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(path.read_text(encoding="utf-8")).render(**values)
