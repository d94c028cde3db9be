"""How fast a step is on a card, beside the processor; and on paper, where there is no card.

    python benchmarks/gpu.py [cpu cuda vulkan ...] [--most 1e7] [--whole N] [--rounds 5]
    python benchmarks/gpu.py --paper [CARD]
    python benchmarks/gpu.py [cpu ...] --smallest

The first form measures, each backend in a process of its own: the terms of a step for 10^5, 10^6,
... particles as far as --most and memory allow, then whole runs of the default case with their
files. A time is the least of the rounds, and their median, after a warm-up; the clock is read when
the device has done all. State counts the bytes of the columns that a step reads and writes,
forcing the bytes that its look-ups gather (benchmarks/traffic.py). The share of the bandwidth is
that of the state, and where the forcing lies in no cache also of one look-up a quantity: the
stages of a step mostly look into the same cell. The card's bandwidth stands in
benchmarks/cards.py, else it is measured by a copy of a large array.

--paper estimates: bytes from the source, registers and instructions from PTX (a stub of CUDA's
driver and ptxas: benchmarks/ptx.py), the host's time from driver_calls.py on the same stub.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "oracles"))
import cards
import cuda_stub
import instructions
import numpy as np
import ptx
import throughput
import traffic
from cards import Card

from geo import sphere
from geo.coast import edges as shoreline
from geo.coast import shore
from kernels.runtime import memory, runtime
from kernels.step import advance as kernel
from kernels.step import coast as device_coast
from kernels.step import velocity

CASE = "overdue_boat"
SMALL = ROOT / "docs" / "generate" / "small.toml"
FEWEST, WHOLE = 10**5, 10**6
DISTINCT = 10**6  # places that are drawn; more particles take them again, in the same random order
FINER = 20  # times as many nodes a side: 1.5 GB of current and wind, more than any cache
STEP = 600  # [s]
ROUND = 0.3  # [s] of steps are a round; a step that takes longer is one
MOST_STEPS = 40  # of a round: particles must not leave
COPIED = 2**28  # [bytes] of the array by whose copy the bandwidth is measured
SHARE = 0.8  # of free memory that is taken
STUBBED = 20_000  # particles of the run on the stub, whose host time does not depend on them
NONE = "-"
CACHED, FAR, SORTED = "in cache", "not in cache", "not in cache; particles along a Z-curve"


class Term(NamedTuple):
    """What a step computes."""

    name: str
    wind: bool = True
    physics: kernel.Physics = kernel.Physics()
    coast: bool = False
    everything: bool = False
    forcing: str = CACHED

    @property
    def ranges(self) -> dict[str, tuple[int, int]]:
        """First and last tile of each quantity."""
        return throughput.RANGES if self.wind else {"current": (0, 1)}

    def surroundings(self, coast: Any) -> kernel.Surroundings:
        """Return domain, coast and what else a step computes."""
        beach = kernel.Beach(stay=21_600.0, offing=50.0) if self.everything else kernel.Beach()
        return kernel.Surroundings(
            throughput.domain(),
            coast if self.coast else None,
            beach,
            bias=self.everything,
            sinks=self.everything,
        )

    @property
    def features(self) -> int:
        """What the kernel is compiled for."""
        return kernel.features(self.ranges, (self.physics,), self.surroundings(object()))


FULL = throughput.FULL
TERMS = (
    Term("RK4, current", wind=False),
    Term("+ wind and leeway"),
    Term("+ errors", physics=throughput.ERRORS),
    Term("+ diffusion", physics=FULL),
    Term("+ coast (open sea)", physics=FULL, coast=True),
    Term(
        "everything (+ jibes, bias, refloating, sinking)",
        True,
        FULL._replace(jibe_rate=1e-5),
        True,
        True,
    ),
    Term("RK4, current, wind and leeway", forcing=FAR),
    Term("RK4, current, wind and leeway", forcing=SORTED),
)


# What is measured.


def places(n: int, coast: shoreline.Coast) -> tuple[np.ndarray, np.ndarray]:
    """Return longitudes and latitudes [binary angle] of n particles in water."""
    few = throughput.particles(min(n, DISTINCT), coast)
    return np.resize(few.lon.to_numpy(), n), np.resize(few.lat.to_numpy(), n)


def scattered(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places of n particles, each its own, in no order."""
    rng = np.random.default_rng(2)
    lon, lat = rng.random(n, np.float32), rng.random(n, np.float32)
    return sphere.to_binary(-95 + 10 * lon), sphere.to_binary(20 + 10 * lat)


def along_curve(lon: np.ndarray, lat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the same places in the order of a Z-curve (Morton 1966)."""
    key = np.zeros(lon.size, np.uint64)
    for bit in range(32):
        for place, values in enumerate((lon, lat)):
            own = (values.view(np.uint32).astype(np.uint64) >> np.uint64(bit)) & np.uint64(1)
            key |= own << np.uint64(2 * bit + place)
    order = np.argsort(key)
    return lon[order], lat[order]


def timed(move: kernel.Move, n: int, rounds: int) -> list[float]:
    """Return nanoseconds a particle-step of each round, after steps that compile and warm up."""
    number = 0

    def seconds(steps: int) -> float:
        nonlocal number
        runtime.wait()
        begin = time.perf_counter()
        for _ in range(steps):
            move(kernel.Step(number, STEP * number, STEP, 1))
            number += 1
        runtime.wait()
        return (time.perf_counter() - begin) / steps

    _, one = seconds(1), seconds(1)
    steps = max(1, min(int(ROUND / one), MOST_STEPS))
    return [seconds(steps) / n * 1e9 for _ in range(rounds)]


def measure_terms(sizes: list[int], rounds: int, finer: int) -> Iterator[dict[str, Any]]:
    """Yield what each term takes with each number of particles, on the running backend."""
    coast = shoreline.build_coast(shore.read_land("gshhg", throughput.BOX), throughput.BOX)
    device = device_coast.upload(coast)
    for far in (False, True):
        tiles = throughput.fields(finer if far else 1)
        for n in sizes:
            if n * throughput.BYTES > SHARE * min(runtime.room() or sys.maxsize, memory.free()):
                continue
            lon, lat = scattered(n) if far else places(n, coast)
            for number, term in enumerate(TERMS):
                if (term.forcing != CACHED) != far:
                    continue
                if term.forcing == SORTED:
                    lon, lat = along_curve(lon, lat)
                ensemble = throughput.ensemble_at(lon, lat)
                own = kernel.batch.batch_of((0, n), (0,), (0,))
                move = kernel.mover(
                    ensemble,
                    own,
                    tiles,
                    term.ranges,
                    (term.physics,),
                    term.surroundings(device),
                    direction=1,
                )
                yield {"term": number, "n": n, "ns": timed(move, n, rounds)}
                del ensemble, move


def copied() -> float:
    """Return bytes a second that a copy of a large device array reads and writes, the best of five."""
    values = runtime.empty(COPIED // 4)
    into = runtime.copy(values)
    cut = range(0, COPIED // 4, COPIED // 4 // runtime.threads())
    job: Callable[[], Any] = partial(runtime.copy, values, into)
    if runtime.backend() == "cpu":  # a copy of its own takes one core
        held, target = values.to_numpy(), np.empty(COPIED // 4, np.float32)
        pool = ThreadPoolExecutor(runtime.threads())
        job = partial(_copied_in_parts, pool, target, held, cut)
    return 2 * COPIED / throughput.best(lambda _: (job(), runtime.wait()), 5)


def _copied_in_parts(
    pool: ThreadPoolExecutor, target: np.ndarray, held: np.ndarray, cut: range
) -> None:
    """Copy an array, each part by a thread of its own."""
    width = cut.step
    list(pool.map(lambda a: np.copyto(target[a : a + width], held[a : a + width]), cut))


def inside(backend: str, given: argparse.Namespace) -> None:
    """Measure on a backend, and print JSON."""
    runtime.start(backend)
    device = runtime.about().get("device", f"{runtime.threads()} threads")
    card = cards.known(device)
    bandwidth = card.bandwidth if card else copied()
    rows = list(measure_terms(sizes_of(given), given.rounds, given.finer))
    print(json.dumps({"device": device, "known": bool(card), "bandwidth": bandwidth, "rows": rows}))


def sizes_of(given: argparse.Namespace) -> list[int]:
    """Return the numbers of particles, ascending: one where --most is below FEWEST."""
    most = int(given.most)
    sizes = [10**k for k in range(5, 9) if 10**k <= most]
    return sizes or [most]


# What is printed.


def row(cells: list[Any]) -> str:
    """Return a row of a table in Markdown."""
    return "| " + " | ".join(map(str, cells)) + " |"


def head(names: list[str], left: int = 1) -> str:
    """Return the first two rows of a table; left: columns of words."""
    return f"{row(names)}\n|{'---|' * left}{'--:|' * (len(names) - left)}"


def three(value: float) -> str:
    """Return a number to three digits, and never with an exponent."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def table_of_terms(found: dict[str, dict[str, Any]]) -> Iterator[str]:
    """Yield the rows of the table of terms; found: by backend."""
    names = ["step", "forcing", "particles", "state B", "forcing B"]
    for backend in found:
        names += [f"{backend}: ns, least (median)", "M/s", "of bandwidth"]
        names += ["times cpu"] if "cpu" in found and backend != "cpu" else []
    yield head(names, 2)
    times = {
        (backend, each["term"], each["n"]): each["ns"]
        for backend, one in found.items()
        for each in one["rows"]
    }
    for number, n in sorted({key[1:] for key in times}):
        term = TERMS[number]
        state, forcing = traffic.columns(term.features).bytes, traffic.gathered(term.features)
        moved = state + (forcing // traffic.stages(term.features) if term.forcing != CACHED else 0)
        cells = [term.name, term.forcing, f"{n:,}", state, forcing]
        for backend, one in found.items():
            own, cpu = times.get((backend, number, n)), times.get(("cpu", number, n))
            cells += [NONE] * 3 if own is None else [
                f"{three(min(own))} ({three(median(own))})",
                three(1e3 / min(own)),
                f"{100 * moved / min(own) * 1e9 / one['bandwidth']:.2g} %",
            ]  # fmt: skip
            if "cpu" in found and backend != "cpu":
                cells.append(f"{min(cpu) / min(own):.2g}" if own and cpu else NONE)
        yield row(cells)


def whole_run(case: str, backend: str, n: int) -> dict[str, float]:
    """Return seconds by phase of a run of a case with its files; empty where it fails."""
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "out"
        command = [sys.executable, "-m", "drift", "run", case, "--backend", backend, "--quiet"]
        command += ["--set", f"particles={n}", "--out", str(out)]
        begin = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, cwd=scratch)
        whole = time.perf_counter() - begin
        if not (out / "summary.json").exists():
            print(
                f"{backend}: {(done.stderr.strip().splitlines() or ['failed'])[-1]}",
                file=sys.stderr,
            )
            return {}
        phases: dict[str, float] = json.loads((out / "summary.json").read_text())["wall_time_s"]
    return phases | {"the whole command": whole}


def table_of_runs(found: dict[str, dict[str, float]]) -> Iterator[str]:
    """Yield the rows of the table of whole runs; found: seconds by phase, by backend."""
    yield head(["phase", *(f"{backend} s" for backend in found)])
    phases = dict.fromkeys(phase for one in found.values() for phase in one)
    for phase in phases:
        yield row(
            [phase, *(f"{one[phase]:.2f}" if phase in one else NONE for one in found.values())]
        )


def measure(given: argparse.Namespace) -> None:
    """Measure on each backend, and print the tables."""
    found, runs = {}, {}
    more = ["--most", str(given.most), "--rounds", str(given.rounds), "--finer", str(given.finer)]
    for backend in given.backends:
        command = [sys.executable, __file__, "--inside", backend, *more]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
        if done.returncode:
            print(f"{backend}: it does not run here", file=sys.stderr)
            continue
        found[backend] = json.loads(done.stdout.splitlines()[-1])
        one = found[backend]
        how = "as its maker states" if one["known"] else "measured by a copy"
        print(f"{backend}: {one['device']}; {one['bandwidth'] / 1e9:,.0f} GB/s, {how}")
    if not found:
        sys.exit("no backend runs here")
    print("\n" + "\n".join(table_of_terms(found)))
    whole = int(given.whole or min(given.most, WHOLE))
    for backend in found:
        runs[backend] = whole_run(given.case, backend, whole)
    print(f"\nA whole run of {Path(given.case).stem} with its files, {whole:,} particles:\n")
    print("\n".join(table_of_runs(runs)))


# On paper.


def write_ptx() -> None:
    """Make the PTX of each term: only on the stub. It prints the number of each term's file."""
    import os

    import variants

    runtime.start("cuda")
    folder = Path(os.environ["CUDA_STUB_OUT"])
    for number, term in enumerate(TERMS):
        if term.forcing != CACHED:
            continue
        there = set(folder.glob("*.ptx"))
        chosen = {"features": term.features, "listed": False, "velocity": velocity.drift}
        variants.compile_variant(kernel._advance, chosen, runs=True)
        for path in set(folder.glob("*.ptx")) - there:
            path.rename(path.with_name(f"term.{number}.ptx"))


def compiled(folder: Path) -> dict[int, tuple[ptx.Cost | None, instructions.Way]]:
    """Return what ptxas says of each term, and the instructions of its PTX."""
    driver = cuda_stub.compiled(folder)
    environment = cuda_stub.environment(driver, folder)
    environment["PYTHONPATH"] += f":{ROOT / 'benchmarks'}"
    subprocess.run(
        [sys.executable, __file__, "--ptx"], env=environment, check=True, stdout=subprocess.DEVNULL
    )
    program = ptx.find_ptxas()
    found = {}
    for number, term in enumerate(TERMS):
        path = folder / f"term.{number}.ptx"
        if path.exists():
            # the later ones are for few particles
            cost = ptx.measure(path, 90, program)[0] if program else None
            found[number] = (
                cost,
                instructions.shortest(path.read_text(), traffic.stages(term.features)),
            )
    return found


def host_time() -> tuple[float, int]:
    """Return what a step takes of the host [s], and its launches, on the stub: forcing and drift."""
    command = [
        sys.executable,
        str(ROOT / "benchmarks" / "driver_calls.py"),
        "stub",
        CASE,
        "--particles",
        f"{STUBBED}",
    ]
    told = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in told.splitlines()]
    parts = {cells[0]: cells[1:] for cells in rows}
    both = [parts[f"a plain step, {STUBBED:,}"], parts["interpolate the forcing at a step"]]
    us, launches = ([float(cells[k].replace(",", "")) for cells in both] for k in (1, 2))
    return 1e-6 * sum(us), int(sum(launches))


def paper(card: Card) -> None:
    """Print what bounds a step on a card that is not here."""
    with tempfile.TemporaryDirectory() as scratch:
        found = compiled(Path(scratch))
    host, launches = host_time()
    print(f"Estimates for {card.name}, which is not here. They rest on:\n")
    print(
        f"- memory: {card.bandwidth / 1e12:.4g} TB/s; the columns that kernels.step.advance reads and writes, and"
    )
    print("  forcing in cache, one look-up a quantity from memory, or every stage's")
    print(
        f"- issue: {card.issued / 1e12:.3g} x 10^12 instructions a second, the most it can issue; PTX of sm_90"
    )
    print(
        f"- host: {1e6 * host:,.0f} us a step of this machine, {launches} launches, on a stub of CUDA's driver,"
    )
    print("  which leaves out what the true driver takes\n")
    names = ["step", "state B", "forcing B", "registers", "occupancy", "instructions", "loads"]
    names += ["G/s: memory, cached", "one look-up", "every stage", "issue"]
    print(head(names))
    bounds: dict[tuple[str, str], dict[str, float]] = {}
    for number, (cost, way) in found.items():
        term = TERMS[number]
        state, forcing = traffic.columns(term.features).bytes, traffic.gathered(term.features)
        once = forcing // traffic.stages(term.features)
        by_memory = [card.bandwidth / moved for moved in (state, state + once, state + forcing)]
        issue = card.issued / way.instructions
        bounds[term.name, CACHED] = {"memory": by_memory[0], "issue": issue}
        bounds[term.name, FAR] = {"memory": by_memory[-1], "issue": issue}
        ptxas = (cost.registers, f"{cost.occupancy:.2f}") if cost else (NONE, NONE)
        cells = [term.name, state, forcing, *ptxas, way.instructions, way.loads]
        print(row([*cells, *(three(each / 1e9) for each in (*by_memory, issue))]))
    sizes = [10**k for k in range(5, 9)]
    print(
        "\nBounds in 10^9 particle-steps a second, by the number of particles: the least of memory (forcing"
    )
    print(
        "that is not in cache: every stage's look-ups), issue and host. Aims: above 5 for RK4 with wind and"
    )
    print("leeway, above 2 for everything.\n")
    print(head(["step", "forcing", *(f"{n:,}" for n in sizes)], 2))
    for names, bound in bounds.items():
        cells = []
        for n in sizes:
            whole = bound | {"host": n / host}
            least = min(whole, key=whole.__getitem__)
            cells.append(f"{whole[least] / 1e9:.2g} ({least})")
        print(row([*names, *cells]))


def main() -> None:
    """Measure or estimate, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("backends", nargs="*", default=["cpu"], help="cpu, cuda, vulkan, metal")
    parser.add_argument("--most", type=float, default=1e7, help="particles")
    parser.add_argument(
        "--whole", type=float, help="particles of the whole runs; the least of --most and 1e6"
    )
    parser.add_argument("--case", default=CASE, help="of the whole runs")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--finer", type=int, default=FINER, help="how much finer the forcing is that no cache holds"
    )
    parser.add_argument(
        "--paper", nargs="?", const="H100", metavar="CARD", help="estimate, for a card of cards.py"
    )
    parser.add_argument("--smallest", action="store_true", help="tiny sizes: does it run?")
    parser.add_argument("--inside", metavar="BACKEND", help=argparse.SUPPRESS)
    parser.add_argument("--ptx", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.smallest:
        given.most, given.finer, given.case = 2_000, 2, str(SMALL)
    if given.ptx:
        write_ptx()
    elif given.inside:
        inside(given.inside, given)
    elif given.paper:
        card = cards.known(given.paper)
        if card is None:
            sys.exit(
                f"no card {given.paper!r}; known: {', '.join(each.name for each in cards.CARDS)}"
            )
        if cuda_stub.why_not():
            sys.exit(cuda_stub.why_not())
        paper(card)
    else:
        measure(given)


if __name__ == "__main__":
    main()
