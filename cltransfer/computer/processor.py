"""What computes, for what is measured on it."""

from __future__ import annotations

import os
import platform
from pathlib import Path


def load_average() -> float | None:
    """How many programs wanted a core over the last five minutes; None where the system does not count them."""
    return round(os.getloadavg()[1], 2) if hasattr(os, "getloadavg") else None


def processor() -> str:
    """The processor's name, where the system tells it, and how many logical cores there are."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    name = names[0] if names else platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} logical cores"
