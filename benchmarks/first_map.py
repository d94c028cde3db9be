"""How long the first map of a case takes, as the page of `drift serve` asks for it; prints one table.

    python benchmarks/first_map.py [CASE ...] [--times 3]

Each case is that of a file, or a shipped one; `wide` is norkyst_raft in a domain of 40 by 20
degrees. It is asked of the page's own process, in its fence. *At once*: the process has just
started, and compiles what it needs. *Ready*: it has compiled that, as after the page has been
opened. *Prepared*: it has also read the case, as while its text is typed; `preparing` is what that
takes. The second map follows the first. The last column divides a second map by its phases; the
answer travels in the rest.
"""

import argparse
import asyncio
import os
import statistics
import tempfile
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

CASES = ("overdue_boat", "norkyst_raft", "washington_drums", "wide")
WIDE = """
[domain]
west = "020W"
east = "020E"
south = "50N"
north = "70N"
"""


async def asked(path: Path, ready: tuple[str, ...], times: int) -> tuple[float, float, float]:
    """Return the seconds of the first maps of a process.

    Args:
        path: the case.
        ready: what the process is asked before.
        times: number of maps after the first.

    Returns:
        Of the last request before, 0 without any, of the first map, and of those after it (median).
    """
    allowed = server._fence(path.parent.resolve(), [], [])
    request = {"text": path.read_text(encoding="utf-8"), "path": str(path)}
    warm = Warm(path.parent.resolve(), allowed, Limits())
    took = [0.0]
    try:
        for do in (*ready, *["sketch"] * (1 + times)):
            begun = time.perf_counter()
            await warm._ask(do, {} if do == "warm" else request)
            took.append(time.perf_counter() - begun)
    finally:
        await warm.close()
    first = 1 + len(ready)
    return took[first - 1], took[first], statistics.median(took[first + 1 :])


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
        "case",
        "at once [s]",
        "ready",
        "second",
        "preparing",
        "prepared",
        "second",
        "where it goes [s]",
    )
    with tempfile.TemporaryDirectory() as folder:
        for name in given.cases:
            path = path_of(name, Path(folder))
            at_once = asyncio.run(asked(path, (), 1))
            ready = asyncio.run(asked(path, ("warm",), given.times))
            prepared = asyncio.run(asked(path, ("warm", "prepare"), given.times))
            spent = ", ".join(f"{phase} {seconds:.2f}" for phase, seconds in phases(path).items())
            seconds = (at_once[1], *ready[1:], *prepared)
            table.add_row(path.stem, *(f"{one:.1f}" for one in seconds), spent)
    Console(width=140).print(table)


def path_of(name: str, folder: Path) -> Path:
    """Return the path of a case by its name; that of the wide one is written to a folder."""
    if os.path.exists(name):
        return Path(name)
    cases = Path(str(resources.files("cases")))
    path = cases / f"{name}.toml"
    if name == "wide":
        path = folder / "wide.toml"
        text = (cases / "norkyst_raft.toml").read_text(encoding="utf-8")
        path.write_text(text + WIDE, encoding="utf-8")
    if not path.exists():
        smallest.lack(f"no case {name}; there are {', '.join(dict(case_file.shipped()))}")
    return path


if __name__ == "__main__":
    main()
