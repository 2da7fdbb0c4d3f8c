"""What a page of ours may run: its own script and style, by their hashes, and nothing else."""

from __future__ import annotations

import base64
import hashlib


def csp_hash(text: str) -> str:
    """What a page's content security policy calls an inline script or style ``text``: base64 of its sha256."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
