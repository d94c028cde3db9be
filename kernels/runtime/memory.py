"""How much memory this process may still take: what its machine has left, and what its container,
batch job and own limits grant.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

try:
    import resource
except ImportError:  # Windows knows no such limits
    resource = None  # type: ignore[assignment]

MEMINFO, STATUS = Path("/proc/meminfo"), Path("/proc/self/status")
MEMBERSHIP, CGROUPS = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")
# of Linux control groups: where the memory's lie, the files of their limit and their use, what it
# is told of first
VERSIONS = (
    (CGROUPS, "memory.max", "memory.current", ""),
    (CGROUPS / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_"),
)
CACHED = ("inactive_file", "active_file")  # of files: it goes when memory is wanted
UNKNOWN = 16 * 2**30  # [bytes] where nobody says


def free() -> int:
    """Return how much memory this process may still take [bytes]."""
    return max(min([_machine(), *_granted(), *_limited()]), 0)


def _machine() -> int:
    """Return how much the machine has left; where that is not told, how much it has."""
    try:
        told = MEMINFO.read_text(encoding="ascii")
        return next(
            int(line.split()[1]) * 1024
            for line in told.splitlines()
            if line.startswith("MemAvailable")
        )
    except (OSError, StopIteration):
        return (
            os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
            if hasattr(os, "sysconf")
            else UNKNOWN
        )


def _limited() -> Iterator[int]:
    """Yield what this process's own limits leave it [bytes]."""
    if resource is None:
        return
    with contextlib.suppress(OSError, ValueError):
        told = dict(line.split(":", 1) for line in STATUS.read_text(encoding="utf-8").splitlines())
        for limit, use in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
            most, _ = resource.getrlimit(limit)
            if most != resource.RLIM_INFINITY and use in told:
                yield most - int(told[use].split()[0]) * 1024


def _granted() -> Iterator[int]:
    """Yield what each control group that holds this process has left of its limit [bytes]."""
    try:
        rows = [line.split(":", 2) for line in MEMBERSHIP.read_text(encoding="utf-8").splitlines()]
    except OSError:
        return
    for _, kinds, path in rows:
        if kinds and "memory" not in kinds.split(","):
            continue
        top, limit, use, told_as = VERSIONS[bool(kinds)]
        own = top / path.lstrip("/")
        for group in [own, *own.parents]:
            if group == top.parent:
                break
            try:
                most, used = (int((group / name).read_text()) for name in (limit, use))
                stat = dict(
                    line.split() for line in (group / "memory.stat").read_text().splitlines()
                )
                yield most - used + sum(int(stat.get(told_as + name, 0)) for name in CACHED)
            except (OSError, ValueError):  # it is not seen from here, or has no limit ("max")
                continue
