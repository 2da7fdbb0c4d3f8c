"""How much memory this process may still take, before it asks for it."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

from ..errors import ResourceError, UsageError

VARIABLE = "CLTRANSFER_MEMORY"
LITTLE = 2**26  # bytes that are taken without asking: a look at what is free takes 0.1 ms
THREAD = 80 * 2**20  # bytes that its stack and heap reserve, which `ulimit -v` counts
GROWTH = 48  # bytes of memory for one of JSON at most; lists of nothing but lists take 44
_CGROUP = Path("/sys/fs/cgroup")


def free_bytes() -> int | None:
    """The least of what the machine has left, what limits (ulimit, container) and ``CLTRANSFER_MEMORY`` leave.

    Returns:
        Bytes, >= 0; None where the system does not say and nobody set the variable, which holds the MB that the whole
        process may use.

    Raises:
        UsageError: the variable is not a positive whole number.
    """
    process = _sizes(Path("/proc/self/status"))
    limits = [*_of_machine(), *_of_container(), *_of_process(process)]
    if named := os.environ.get(VARIABLE):
        if not named.isdecimal() or int(named) < 1:
            raise UsageError("", VARIABLE, f"expected a positive whole number of MB, got {named!r}")
        limits.append(int(named) * 2**20 - process.get("VmRSS", 0))
    return max(0, min(limits)) if limits else None


def require_free(need: int, where: str | Path, what: str, hint: str) -> None:
    """Refuse what takes more memory than there is, before it is begun.

    Args:
        need: bytes it takes at its peak.
        where: the file it is read from, for the error line.
        what: it, as a plural.
        hint: what else than more memory would help.

    Raises:
        ResourceError: less is free.
    """
    free = free_bytes()
    if free is not None and need > free:
        reason = f"{what} need {need / 2**20:.0f} MB, {free / 2**20:.0f} MB are free"
        raise ResourceError(where, "memory", reason, f"raise the limit of the system or of {VARIABLE}, or {hint}")


def require_parsed(size: int, where: str | Path) -> None:
    """Refuse JSON of ``size`` bytes whose values would take more memory than there is, if they are the worst.

    Raises:
        ResourceError: less is free.
    """
    require_free(GROWTH * size, where, f"values of {size} bytes of JSON", "make the file smaller")


def affordable(workers: int, each: int, beside: int = 0) -> int:
    """How many of ``workers`` there is memory for at once; one at least.

    Args:
        workers: threads that there are.
        each: bytes that one takes, beside its stack and heap.
        beside: bytes that all together take, however many there are.
    """
    if workers * each <= LITTLE:
        return workers
    free = free_bytes()
    return workers if free is None else max(1, min(workers, (free - beside) // (each + THREAD)))


def _of_machine() -> list[int]:
    available = _sizes(Path("/proc/meminfo")).get("MemAvailable")
    return [] if available is None else [available]


def _of_container() -> list[int]:
    """What the control group leaves; its cache of files can be taken back."""
    pairs = (("memory.max", "memory.current"), ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"))
    for most, used in pairs:
        try:
            limit, usage = ((_CGROUP / name).read_text().strip() for name in (most, used))
        except OSError:
            continue
        if limit.isdecimal():
            return [int(limit) - int(usage) + _file_cache(_CGROUP / Path(most).parent / "memory.stat")]
    return []


def _file_cache(path: Path) -> int:
    try:
        found = re.search(r"^(?:total_)?inactive_file (\d+)$", path.read_text(), re.MULTILINE)
    except OSError:
        return 0
    return int(found[1]) if found else 0


def _of_process(sizes: dict[str, int]) -> list[int]:
    """What ``ulimit -v`` and ``ulimit -d`` leave."""
    if sys.platform == "win32":
        return []
    import resource

    limits = []
    for limit, used in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
        soft, _ = resource.getrlimit(limit)
        if soft != resource.RLIM_INFINITY:
            limits.append(soft - sizes.get(used, 0))
    return limits


def _sizes(path: Path) -> dict[str, int]:
    """Bytes by name, as /proc tells them in kB; empty where there is no such file."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return {}
    found = (re.fullmatch(r"(\w+):\s+(\d+) kB", line) for line in lines)
    return {match[1]: int(match[2]) * 1024 for match in found if match}
