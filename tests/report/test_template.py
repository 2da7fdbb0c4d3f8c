from __future__ import annotations

from pathlib import Path

import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

from cltransfer.report.template import rendered


@pytest.fixture
def template(tmp_path: Path) -> Path:
    path = tmp_path / "page.html"
    lines = ["<ul>", "  {% for name in names %}", "  <li>{{ name }}é</li>", "  {% endfor %}", "</ul>", ""]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_what_is_filled_in_stays_text_and_markup_stays_markup(template: Path) -> None:
    page = rendered(template, names=["<i>", Markup("<b>")])
    assert page == "<ul>\n  <li>&lt;i&gt;é</li>\n  <li><b>é</li>\n</ul>"


def test_a_value_that_is_not_given_is_told(template: Path) -> None:
    with pytest.raises(UndefinedError, match="'names' is undefined"):
        rendered(template, name=["a"])
