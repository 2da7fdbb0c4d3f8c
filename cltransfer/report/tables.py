"""A table to be read, as Markdown and LaTeX: whatever a name holds stays text."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Cells of text under a header; ``bold`` are those to be seen first, by row and column."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    bold: frozenset[tuple[int, int]] = frozenset()


def to_markdown(table: Table) -> list[str]:
    """Lines of a Markdown table."""
    cells = [
        [f"**{_escape(c)}**" if (i, j) in table.bold else _escape(c) for j, c in enumerate(row)]
        for i, row in enumerate(table.rows)
    ]
    rule = ["---"] + ["--:"] * (len(table.header) - 1)
    return ["| " + " | ".join(line) + " |" for line in [map(_escape, table.header), rule, *cells]]


def _escape(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("*", "\\*").replace("<", "&lt;").replace("\n", " ")


def to_latex(table: Table) -> list[str]:
    """Lines of a tabular with booktabs' rules."""
    lines = [rf"\begin{{tabular}}{{l{'r' * (len(table.header) - 1)}}}", r"\toprule"]
    lines += [" & ".join(map(_tex, table.header)) + r" \\", r"\midrule"]
    for i, row in enumerate(table.rows):
        cells = [rf"\textbf{{{_tex(c)}}}" if (i, j) in table.bold else _tex(c) for j, c in enumerate(row)]
        lines.append(" & ".join(cells) + r" \\")
    return [*lines, r"\bottomrule", r"\end{tabular}"]


_TEX = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "–": "--", "\n": " "}
_TEX |= {"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"}  # other signs in TeX's oldest fonts
_TEX |= {character: f"\\{character}" for character in "&%$#_{}"}


def _tex(text: str) -> str:
    return "".join(_TEX.get(character, character) for character in text)
