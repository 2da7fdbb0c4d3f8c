"""A table to be read, as Markdown and LaTeX: whatever a name holds stays text."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Cells of text under a header; ``bold`` are those to be seen first, by row and column."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    bold: frozenset[tuple[int, int]] = frozenset()


def headed(name: str, units: Iterable[str]) -> str:
    """``name`` of a column, with the unit of its values where they have one.

    >>> headed("camera_angle", ["rad", "", "rad"]), headed("movement", ["px", "rad"]), headed("total", [""])
    ('camera_angle [rad]', 'movement', 'total')
    """
    known = set(units) - {""}
    return f"{name} [{known.pop()}]" if len(known) == 1 else name


def to_markdown(table: Table) -> list[str]:
    """Lines of a Markdown table."""
    cells = [
        [f"**{escape(c)}**" if (i, j) in table.bold else escape(c) for j, c in enumerate(row)]
        for i, row in enumerate(table.rows)
    ]
    return markdown_lines([escape(name) for name in table.header], cells, words=(0,))


def markdown_lines(header: Sequence[str], rows: Sequence[Sequence[str]], words: Collection[int]) -> list[str]:
    """Lines of a table whose cells are Markdown already; the columns ``words`` stand to the left, numbers to the right.

    >>> markdown_lines(["loss", "mean"], [["framing", "0.1"]], words=(0,))
    ['| loss | mean |', '| --- | --: |', '| framing | 0.1 |']
    """
    rule = ["---" if i in words else "--:" for i in range(len(header))]
    return ["| " + " | ".join(line) + " |" for line in [header, rule, *rows]]


_ACTS = re.compile(
    r"[\\|*`]"  # wherever it stands
    r"|~(?=.*~)"  # alone, or the last one, it strikes nothing out
    r"|(?<![^\W_])_|_(?![^\W_])"  # at the edge of a word; within one it is a sign like others
    r"|\](?=[(\[])"  # of a link or an image
)
_MARKUP = re.compile(r"&(?=#?\w+;)|<")  # of an entity or a tag


def escape(text: str) -> str:
    """``text`` on one line, with a backslash or an entity where Markdown would act on a sign."""
    line = re.sub(r"\r\n|[\r\n]", " ", text)
    return _MARKUP.sub(lambda sign: {"&": "&amp;", "<": "&lt;"}[sign[0]], _ACTS.sub(r"\\\g<0>", line))


def to_latex(table: Table) -> list[str]:
    """Lines of a tabular with booktabs' rules; numbers are mathematics, but in the first column, which has names."""
    lines = [rf"\begin{{tabular}}{{l{'r' * (len(table.header) - 1)}}}", r"\toprule"]
    lines += [_line([_tex(c) for c in table.header]), r"\midrule"]
    for i, row in enumerate(table.rows):
        cells = [_tex(c) if j == 0 else _tex_numbers(c) for j, c in enumerate(row)]
        lines.append(_line([_bold(c) if (i, j) in table.bold else c for j, c in enumerate(cells)]))
    return [*lines, r"\bottomrule", r"\end{tabular}"]


def _bold(cell: str) -> str:
    """A cell in bold type, with what is mathematics in it."""
    return rf"\textbf{{\boldmath {cell}}}" if "$" in cell.replace(r"\$", "") else rf"\textbf{{{cell}}}"


def _line(cells: Sequence[str]) -> str:
    r"""A row. One that begins with ``[`` or ``*`` would be read as an option of the ``\\`` or the rule before it."""
    guard = "{}" if cells[0].lstrip().startswith(("[", "*")) else ""
    return guard + " & ".join(cells) + r" \\"


_TEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "–": "--",
    "\n": " ",
    "\r": " ",
}
_TEX |= {"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"}  # other signs in TeX's oldest fonts
_TEX |= {character: f"\\{character}" for character in "&%$#_{}"}

_JOINED = re.compile(r"(?<=[-`',?!])(?=[-`',])")  # between signs of which TeX makes another: -- `` '' ,, ?` !`


def _tex(text: str) -> str:
    return "".join(_TEX.get(character, character) for character in _JOINED.sub("\0", text)).replace("\0", "{}")


# by itself, an end of an interval, or a part of a count
_NUMBER = re.compile(r"(?<![^\s\[(])([-+]?\d+(?:\.\d*)?)(?:e([-+]\d+))?(?![^\s\]),/])")


def _tex_numbers(text: str) -> str:
    """``text`` with a true minus and powers of ten: a hyphen is shorter, and an e is no mathematics."""
    parts, end = [], 0
    for found in _NUMBER.finditer(text):
        value, power = found.groups()
        if power is None and value[0] not in "-+":
            continue
        times = "" if power is None else rf"\times10^{{{int(power)}}}"
        parts += [_tex(text[end : found.start()]), f"${value}{times}$"]
        end = found.end()
    return "".join([*parts, _tex(text[end:])])
