from __future__ import annotations

import pytest

from cltransfer.bench.rows import kept_rows
from cltransfer.bench.section import machine, table, write_section
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


def test_a_page_tells_the_load_that_its_rows_were_measured_under_and_not_its_own(tmp_path, monkeypatch):
    tasks = {}
    for key, load in (("a", 3.7), ("b", 4.2), ("c", 1.7)):
        monkeypatch.setattr("os.getloadavg", lambda load=load: (0.0, load, 0.0))
        tasks[key] = None
        rows = kept_rows(tasks if key != "c" else {"a": None, "b": None}, lambda key, task: {}, tmp_path)
    assert "load average 3.7 to 4.2 while measured;" in machine(rows)[0]
    assert "load average 3.7 while measured;" in machine(rows[:1])[0]
    assert "load average 3.7 while 1 of 2 rows were measured;" in machine([rows[0], {"key": "old"}])[0]
    assert "load average" not in machine([{"key": "old"}])[0]
    assert "load average 1.7 while measured;" in machine()[0]


def test_a_page_names_every_machine_that_its_rows_were_measured_on(tmp_path, monkeypatch):
    for key, name in (("a", "A, 2 logical cores"), ("b", "B, 4 logical cores")):
        monkeypatch.setattr("cltransfer.bench.rows.processor", lambda name=name: name)
        kept_rows({key: None}, lambda key, task: {}, tmp_path)
    rows = kept_rows({"a": None, "b": None}, lambda key, task: {}, tmp_path)
    assert machine(rows)[0].startswith("Machine: A, 2 logical cores and B, 4 logical cores, load")
    older = {key: value for key, value in rows[1].items() if key != "machine"}
    assert "A, 2 logical cores and one that older rows do not tell" in machine([rows[0], older])[0]
    assert "A, 2" not in machine([older])[0]


def test_what_a_cell_holds_stays_text():
    assert table(("a", "b|c"), [["x*", "1"]]) == ["| a | b\\|c |", "| --- | --- |", "| x\\* | 1 |"]
