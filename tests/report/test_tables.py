"""Tables: whatever a name holds stays text."""

from __future__ import annotations

import pytest

from cltransfer.report.tables import Table, to_latex, to_markdown


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a\rb\r\nc\nd", "a b c d"),
        ("[a](b)", r"[a\](b)"),
        ("![a](b)", r"![a\](b)"),
        ("[a [b] c](d)", r"[a [b] c\](d)"),
        ("[a][b]", r"[a\][b]"),
        ("[0.1, 0.2]", "[0.1, 0.2]"),
        ("_a_ shot_size", r"\_a\_ shot_size"),
        ("`a` ~~b~~", r"\`a\` \~\~b\~~"),
        ("a & b &lt; &#124; & c;", "a & b &amp;lt; &amp;#124; & c;"),
        (r"<i> \* |", r"&lt;i> \\\* \|"),
        ("a~b", "a~b"),
        ("a! [b] & 50 %", "a! [b] & 50 %"),
    ],
)
def test_markdown_acts_on_nothing_in_a_cell(text: str, shown: str) -> None:
    assert to_markdown(Table((text, "x"), ((text, "y"),)))[::2] == [f"| {shown} | x |", f"| {shown} | y |"]


@pytest.mark.parametrize("text", ["[1em]", "*", " [a"])
def test_a_first_cell_is_no_option_of_the_line_before(text: str) -> None:
    lines = to_latex(Table((text, "[x]"), ((text, "*"), ("a", "b")), frozenset({(1, 0)})))
    assert lines[2] == rf"{{}}{text} & [x] \\"
    assert lines[4] == rf"{{}}{text} & * \\"
    assert lines[5] == r"\textbf{a} & b \\"


def test_latex_joins_no_signs() -> None:
    text = "\n".join(to_latex(Table(("row", "x"), (("--fast ?` ``a'' ,,", "1"),))))
    assert r"-{}-fast ?{}` `{}`a'{}' ,{}," in text


def test_every_line_of_a_table_has_as_many_cells_as_its_header() -> None:
    lines = to_markdown(Table(("row", "x", "y"), (("a", "1", "2"), ("b", "3", "4"))))
    assert [line.count("|") for line in lines] == [4] * 4
