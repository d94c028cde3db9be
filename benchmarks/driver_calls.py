"""What each part of a run asks of the driver: launches, waits, memory and bytes copied.

    python benchmarks/driver_calls.py cpu [CASE] [--particles N]
    python benchmarks/driver_calls.py stub [CASE] [--particles N]

cpu: the case runs truly, and what goes through Taichi and kernels/runtime/runtime.py is counted.
stub: the case runs on a stub of CUDA's driver (tests/backends/cuda_stub.c, made by a C compiler),
which logs every call and computes nothing: particles stay at 0 N 0 E. So the case runs without a
coast there, and prints figures that depend on neither.

It prints a table in Markdown. Figures are medians of a part's calls, and a part is counted without
the parts inside it: a step begins with the interpolation of the forcing, which has its own row.
A kernel is one launch to Taichi and mostly two to the driver: the bound of its loop, and the loop.
Times are of the host, and on the stub leave out what a card would take.
"""

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "oracles"))
import cuda_stub
import numpy as np
import smallest

import drift
from drift.engine.environment import lost
from drift.engine.motion import simulate
from drift.engine.motion.forcing import Forcing
from drift.engine.motion.scene import Scene
from drift.evidence.filter.exposure import SortieExposure
from drift.evidence.filter.filter import SearchFilter
from kernels.runtime import runtime, taichi_inside
from kernels.runtime.dtypes import KINDS
from kernels.step.sample import Tiles

WHAT = (
    *("launch", "sync", "alloc", "alloc bytes"),
    *("up", "up bytes", "down", "down bytes", "within bytes"),
)
STUB = {"coast": {"source": "none"}, "max_lost": "100 %"}  # changes to a case that runs on the stub
STEPS = ("a plain step", "a step that keeps its begin (a sortie or output is inside)")
Counts = Counter[str]


class Meter:
    """Counts by part of a run: a part is a function, and what is counted in it is its own."""

    def __init__(self, read: Callable[[], Counts]) -> None:
        self._read, self._open = read, [Counter[str]()]
        self._last = self._now()
        self.parts: defaultdict[str, list[Counts]] = defaultdict(list)

    def _now(self) -> Counts:
        return Counter(self._read(), us=round(1e6 * time.perf_counter()))

    def _settle(self) -> None:
        """Give the part that is going on what has been counted since."""
        now = self._now()
        self._open[-1].update({what: now[what] - self._last[what] for what in now})
        self._last = now

    def part(self, owner: Any, method: str, name: Callable[..., str]) -> None:
        """Count each call of a function; name: gives the part from the function's arguments."""
        plain = getattr(owner, method)

        def counted(*args: Any, **more: Any) -> Any:
            self._settle()
            self._open.append(Counter())
            try:
                return plain(*args, **more)
            finally:
                self._settle()
                self.parts[name(*args, **more)].append(self._open.pop())

        setattr(owner, method, counted)


def observe(meter: Meter) -> None:
    """Count the parts of a run, by the number of particles: a run begins with small trials."""
    meter.part(Forcing, "set", lambda *_: "interpolate the forcing at a step")
    meter.part(Tiles, "place", lambda *_, **__: "one slice of forcing")
    meter.part(Scene, "advance", _advanced)
    meter.part(simulate, "_moment", lambda e, *_: f"an output, {e.n:,}")
    meter.part(SortieExposure, "expose", lambda _, e, *__, **___: f"a sortie over a step, {e.n:,}")
    meter.part(
        SearchFilter, "apply_evidence", lambda own, *_: f"the end of a sortie, {own.ensemble.n:,}"
    )


def _advanced(_: Scene, ensemble: Any, *_of_step: Any, keep: bool = False, count: int = 1) -> str:
    """Return what is said of steps that are made in one go."""
    return (
        f"{STEPS[keep]}, {ensemble.n:,}"
        if count == 1
        else f"{count} steps in one go, {ensemble.n:,}"
    )


def through_taichi() -> Counts:
    """Count what goes through Taichi and kernels/runtime/runtime.py from now on, in what is
    returned.
    """
    counts = Counter[str]()

    def count(owner: Any, method: str, what: str, size: Callable[..., int] = lambda *_: 0) -> None:
        plain = getattr(owner, method)

        def counted(*args: Any, **more: Any) -> Any:
            counts[what] += 1
            counts[f"{what} bytes"] += size(*args)
            return plain(*args, **more)

        setattr(owner, method, counted)

    def size_of(kind: Any) -> int:
        return np.dtype(KINDS[kind]).itemsize

    def width(column: Any, *_: Any) -> int:
        return column.shape[0] * size_of(column.dtype)

    def handed(_self: Any, _t: Any, _compiled: Any, *args: Any) -> int:
        return sum(array.nbytes for array in args if isinstance(array, np.ndarray))

    count(taichi_inside.core.Program, "launch_kernel", "launch")
    count(taichi_inside.ti, "sync", "sync")
    count(taichi_inside.Column, "__init__", "alloc", lambda _, kind, n, *__: n * size_of(kind))
    count(taichi_inside.Column, "to_numpy", "down", width)
    count(taichi_inside.Column, "from_numpy", "up", width)
    count(runtime, "copy", "within", width)
    for way in ("up", "down"):  # NumPy's arrays that are handed to a kernel go both ways
        count(taichi_inside.kernel_impl.Kernel, "launch_kernel", way, handed)
    return counts


def through_driver(file: Path) -> Callable[[], Counts]:
    """Return a function that counts the calls of the stub, which writes them to a file."""
    counts, place = Counter[str](), 0

    def read() -> Counts:
        nonlocal place
        with contextlib.suppress(FileNotFoundError), file.open() as lines:
            lines.seek(place)
            for line in lines:
                what, *more = line.split()
                counts[what] += 1
                if what not in ("launch", "sync", "free"):
                    counts[f"{what} bytes"] += int(more[0])
            place = lines.tell()
        return counts.copy()

    return read


def table(parts: dict[str, list[Counts]]) -> Iterator[str]:
    """Yield the lines of a table in Markdown: a row for each part, medians of its calls."""
    yield "| part, particles | calls | us | " + " | ".join(WHAT) + " |"
    yield "|---|" + "--:|" * (len(WHAT) + 2)
    for name, calls in sorted(parts.items()):
        middle = [median(call[what] for call in calls) for what in ("us", *WHAT)]
        cells = [name, f"{len(calls):,}", *(f"{value:,.0f}" for value in middle)]
        yield "| " + " | ".join(cells) + " |"


def on_stub() -> None:
    """Run this script again in an environment where CUDA's driver is the stub."""
    if cuda_stub.why_not():
        sys.exit(cuda_stub.why_not())
    with tempfile.TemporaryDirectory() as scratch:
        driver = cuda_stub.compiled(Path(scratch))
        environment = cuda_stub.environment(driver, Path(scratch))
        done = subprocess.run([sys.executable, *sys.argv, "--inside"], env=environment)
    sys.exit(done.returncode)


def main() -> None:
    """Run a case, and print what its parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("how", choices=("cpu", "stub"), nargs="?" if smallest.ASKED else None)
    parser.add_argument("case", nargs="?", default="overdue_boat")
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = smallest.parse(parser, how="cpu", case=str(smallest.CASE), particles=500)
    if options.how == "stub" and not options.inside:
        on_stub()
    changes = {"particles": options.particles} | (STUB if options.inside else {})
    case = drift.vary(drift.load(options.case), changes)
    runtime.start("cuda" if options.inside else "cpu")
    read = through_taichi().copy
    if options.inside:
        read = through_driver(Path(os.environ["CUDA_STUB_OUT"]) / "calls.txt")
        lost.check_prior = lambda *_: None  # all particles stay at 0 N 0 E, outside of the domain
    meter = Meter(read)
    observe(meter)
    drift.run(case, backend=runtime.backend())
    print("\n".join(table(meter.parts)))


if __name__ == "__main__":
    main()
