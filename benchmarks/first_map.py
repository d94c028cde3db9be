"""How long the first map of a case takes, as the page of `drift serve` asks for it; prints one table.

    python benchmarks/first_map.py [CASE ...] [--times 3]

Each case is that of a file, or a shipped one. It is asked of the page's own process, in its fence.
*First*: the process has just started, and compiles what it needs. *Warm*: it is ready, as after a
case has been opened. The first map of a case whose kind was not made before may still compile. The
last columns divide the last warm map by its phases; the answer travels in the rest.
"""

import argparse
import asyncio
import os
import statistics
import time
from importlib import resources
from pathlib import Path

import smallest
from rich.console import Console
from rich.table import Table

from drift.apps.serve import server
from drift.apps.serve.answers import process
from drift.apps.serve.jobs import Limits
from drift.apps.serve.warm import Warm
from drift.case import file as case_file

CASES = ("overdue_boat", "norkyst_raft", "washington_piw")


async def asked(path: Path, times: int) -> tuple[float, float, list[float]]:
    """Return the seconds of a first map without and with a warm process.

    Args:
        path: the case.
        times: number of warm maps.

    Returns:
        Of the first map of a process that starts, of the first one of a warm process, and of those
        after it.
    """
    allowed = server._fence(path.parent.resolve(), [], [])
    request = {"text": path.read_text(encoding="utf-8"), "path": str(path)}
    took = []
    for ready in (False, True):
        warm = Warm(path.parent.resolve(), allowed, Limits())
        try:
            if ready:
                await warm.ask("warm")
            for _ in range(1 + times * ready):
                begun = time.perf_counter()
                await warm.ask("sketch", **request)
                took.append(time.perf_counter() - begun)
        finally:
            await warm.close()
    return took[0], took[1], took[2:]


def phases(path: Path) -> dict[str, float]:
    """Return the seconds of each phase of a warm first map, made in this process."""
    request = {"text": path.read_text(encoding="utf-8"), "path": str(path)}
    process.ANSWERS["sketch"](request, lambda phase, share: None)
    spent: dict[str, float] = {}
    last, begun = "begin", time.perf_counter()

    def tell(phase: str, share: float) -> None:
        nonlocal last, begun
        now = time.perf_counter()
        spent[last] = spent.get(last, 0.0) + now - begun
        last, begun = phase, now

    process.ANSWERS["sketch"](request, tell)
    tell("end", 1.0)
    return spent


def main() -> None:
    """Time the first maps and print the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("cases", nargs="*", default=list(CASES))
    options.add_argument("--times", type=int, default=3)
    given = smallest.parse(options, cases=[str(smallest.CASE)], times=1)
    table = Table(
        "case", "first [s]", "first of a warm process [s]", "warm [s]", "where it goes [s]"
    )
    for name in given.cases:
        path = (
            Path(name)
            if os.path.exists(name)
            else Path(str(resources.files("cases"))) / f"{name}.toml"
        )
        if not path.exists():
            smallest.lack(f"no case {name}; there are {', '.join(dict(case_file.shipped()))}")
        cold, first, rest = asyncio.run(asked(path, given.times))
        spent = ", ".join(f"{phase} {seconds:.2f}" for phase, seconds in phases(path).items())
        table.add_row(
            path.stem, f"{cold:.1f}", f"{first:.1f}", f"{statistics.median(rest):.1f}", spent
        )
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
