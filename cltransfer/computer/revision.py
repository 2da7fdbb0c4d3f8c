"""Which state of the code is running, for what is measured with it."""

from __future__ import annotations

import subprocess
from pathlib import Path

from .. import __version__


def commit(root: Path | None = None) -> str:
    """Commit of the checkout at ``root``, this one where it is None; else the version of the package.

    ``-dirty`` if code or configs have changed since: figures and pages, which a benchmark writes itself, do not count.
    """
    root = root or Path(__file__).parents[2]
    git = ["git", "-C", str(root)]
    try:
        top = subprocess.run([*git, "rev-parse", "--show-toplevel"], capture_output=True, text=True, check=False)
        at = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
        changed = subprocess.run(
            [*git, "status", "--porcelain", "--", "cltransfer", "configs", "plugins"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    except FileNotFoundError:
        return f"cltransfer {__version__}"
    own = bool(top.stdout.strip()) and Path(top.stdout.strip()).resolve() == root.resolve()  # not one that it lies in
    if not (own and at.stdout.strip()):
        return f"cltransfer {__version__}"
    return at.stdout.strip() + ("-dirty" if changed.stdout.strip() else "")
