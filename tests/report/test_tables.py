"""Tables: whatever a name holds stays text."""

from __future__ import annotations

import pytest

from cltransfer.report.tables import Table, headed, to_latex, to_markdown


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


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("-2.79e-05 n=2", r"$-2.79\times10^{-5}$ n=2"),
        ("+1.00 [-1.00, 2.00e-12] n=6", r"$+1.00$ [$-1.00$, $2.00\times10^{-12}$] n=6"),
        ("0.1 [0.00, –] (4/8)", "0.1 [0.00, --] (4/8)"),
        ("-0.50 (2/4 frames)", "$-0.50$ (2/4 frames)"),
        ("a-1 -b 3-4 $-1 -1.5x", r"a-1 -b 3-4 \$-1 -1.5x"),
    ],
)
def test_numbers_in_latex_have_a_true_minus_and_powers_of_ten(text: str, shown: str) -> None:
    table = Table(("row", "x"), (("-1", text), ("a", text)), frozenset({(1, 1)}))
    lines = to_latex(table)
    assert lines[4] == rf"-1 & {shown} \\"  # a name is no number
    bold = rf"\boldmath {shown}" if shown.startswith("$") else shown
    assert lines[5] == rf"a & \textbf{{{bold}}} \\"
    assert to_markdown(table)[2] == f"| -1 | {text} |"


def test_a_column_of_one_unit_has_it_in_its_head() -> None:
    assert headed("angle", ["", "rad", "rad"]) == "angle [rad]"
    assert [headed("total", units) for units in ([], [""], ["px", "rad"])] == ["total"] * 3
