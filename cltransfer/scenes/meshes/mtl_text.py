"""What an MTL says of its materials, as trimesh reads it."""

from __future__ import annotations

from collections.abc import Sequence


def blocks(text: str) -> list[list[str]]:
    """The lines of each material, after those of none; ``newmtl`` without a name begins none."""
    found = [list[str]()]
    for line in text.splitlines():
        if "newmtl" in said([line]):
            found.append([])
        found[-1].append(line)
    return found


def materials(text: str) -> dict[str, list[str]]:
    """The lines of each material by its name: of one name the last counts."""
    return {" ".join(block[0].split()[1:]): block for block in blocks(text)[1:]}


def key_of(line: str) -> str:
    """Its first word, in small letters; empty where it has none."""
    return "".join(line.split(maxsplit=1)[:1]).lower()


def said(block: Sequence[str]) -> dict[str, str]:
    """What follows the keys of a material: of one that is there twice the last counts."""
    return {key_of(line): words[1].strip() for line in block if len(words := line.split(maxsplit=1)) == 2}


def with_whole_colors(text: str) -> str:
    """An MTL with each ``Kd`` as three words: one alone is a grey, and what follows three is none of it.

    trimesh drops every material of a file where one of them has another colour, or a highlight, that is none; ``Ka``,
    ``Ks`` and ``Ns``, which are not drawn, are left out.
    """
    lines = list[str]()
    for line in text.splitlines():
        key, words = key_of(line), line.split()[1:]
        if key == "kd":
            whole = words * 3 if len(words) == 1 else words[:3]
            lines += [f"Kd {' '.join(whole)}"] if len(whole) == 3 else []
        elif key not in ("ka", "ks", "ns"):
            lines.append(line)
    return "\n".join([*lines, ""])
