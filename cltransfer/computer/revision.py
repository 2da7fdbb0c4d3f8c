"""Which state of the code is running, for what is measured with it."""

from __future__ import annotations

import subprocess
from pathlib import Path

from .. import __version__


def commit(root: Path | None = None) -> str:
    """Commit of the checkout at ``root``, this one where it is None; else the version of the package.

    ``-dirty`` if code or configs have changed since: figures and pages, which a benchmark writes itself, do not count.
    """
    git = ["git", "-C", str(root or Path(__file__).parents[2])]
    try:
        at = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
        changed = subprocess.run(
            [*git, "status", "--porcelain", "--", "cltransfer", "configs", "plugins"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    except FileNotFoundError:
        return f"cltransfer {__version__}"
    if not at.stdout.strip():
        return f"cltransfer {__version__}"
    return at.stdout.strip() + ("-dirty" if changed.stdout.strip() else "")
