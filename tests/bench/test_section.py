from __future__ import annotations

import pytest

from cltransfer.bench.section import write_section
from cltransfer.errors import InputError

PAGE = "# Mine\n\n## Stress\n\n<!-- stress: begin -->\nold\n<!-- stress: end -->\n\nAfter.\n"


def test_a_section_is_rewritten_and_the_rest_stays(tmp_path):
    (tmp_path / "page.md").write_text(PAGE)
    write_section(tmp_path / "page.md", "Stress", ["new"])
    assert (tmp_path / "page.md").read_text() == PAGE.replace("old", "new")
    write_section(tmp_path / "page.md", "Other", ["more"])
    assert (tmp_path / "page.md").read_text().startswith(PAGE.replace("old", "new"))


@pytest.mark.parametrize(
    "page",
    [
        "<!-- stress: end -->\nA\n<!-- stress: begin -->\nB\n",
        "A\n<!-- stress: begin -->\nB\n",
        "A\n<!-- stress: end -->\nB\n",
    ],
)
def test_markers_that_are_no_pair_are_left_as_they_are(tmp_path, page):
    (tmp_path / "page.md").write_text(page)
    with pytest.raises(InputError, match=r"page.md: Stress: expected '<!-- stress: begin -->', then"):
        write_section(tmp_path / "page.md", "Stress", ["x"])
    assert (tmp_path / "page.md").read_text() == page
