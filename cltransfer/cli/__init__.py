"""The command line: one module a family of verbs; nothing heavy is imported before a verb needs it."""

from __future__ import annotations

from typing import NoReturn


def main() -> NoReturn:
    """Run the command line ``sys.argv``; what the installed command calls."""
    from .app import main as run

    run()
