"""Memory that this process may still allocate, within the machine and the limits on the process.

The limits are those of its container, its batch job, and its own resource limits.
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
# Linux control groups: folder of the memory groups, files of limit and use, prefix of the names in
# memory.stat
VERSIONS = (
    (CGROUPS, "memory.max", "memory.current", ""),
    (CGROUPS / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_"),
)
CACHED = ("inactive_file", "active_file")  # page cache of files, which is freed on demand
UNKNOWN = 16 * 2**30  # [bytes] if no source is available


def free() -> int:
    """Return how much memory this process may still allocate [bytes]."""
    return max(min([_machine(), *_granted(), *_limited()]), 0)


def _machine() -> int:
    """Return the machine's available memory [bytes]; its total memory if that is unknown."""
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
    """Yield the memory left by the process's own resource limits [bytes]."""
    if resource is None:
        return
    with contextlib.suppress(OSError, ValueError):
        told = dict(line.split(":", 1) for line in STATUS.read_text(encoding="utf-8").splitlines())
        for limit, use in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
            most, _ = resource.getrlimit(limit)
            if most != resource.RLIM_INFINITY and use in told:
                yield most - int(told[use].split()[0]) * 1024


def _granted() -> Iterator[int]:
    """Yield the memory left by each control group that contains this process [bytes]."""
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
            except (OSError, ValueError):  # the group is not visible here, or has no limit ("max")
                continue
