"""Registers, spills, stack and occupancy of every kernel on NVIDIA's cards, as ptxas has them.

    python benchmarks/ptx.py [--keep FOLDER] [--arch 80 90]

It needs no card: Taichi compiles on a stub of CUDA's driver (tests/backends/cuda_stub.c, made by a
C compiler), and ptxas assembles. It prints a table in Markdown, with the best and the worst variant
of each kernel: a variant is a kernel with one set of compile-time arguments
(tests/oracles/variants.py).

Occupancy is theoretical: the share of a multiprocessor's 64 warps that registers leave room for.
"""

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "oracles"))
import cuda_stub
import smallest

NO_PTXAS = "no ptxas: pip install nvidia-cuda-nvcc-cu12"
REGISTERS, WARPS, BLOCKS = 65_536, 64, 32  # of a multiprocessor, of sm_80 and sm_90
UNIT = 256  # registers are given to a warp in such lots
THREADS = 128  # in a block, where PTX does not say


class Cost(NamedTuple):
    """What one loop of a variant of a kernel takes, with spills of all of its functions."""

    occupancy: float
    registers: int
    stack: int  # [bytes] a thread
    spilled: int  # [bytes] stored and loaded again, a thread


def find_ptxas() -> str | None:
    """Return where ptxas is: on the path, or in one of NVIDIA's packages from PyPI."""
    packages = (path for folder in sys.path for path in Path(folder).glob("nvidia/*/bin/ptxas"))
    return shutil.which("ptxas") or next((str(path) for path in packages), None)


def make_ptx(driver: Path, out: Path, arch: int) -> None:
    """Have every variant of every kernel compiled, in the smallest mode of few: files
    KERNEL.NUMBER.ptx in a folder.
    """
    command = [sys.executable, ROOT / "tests" / "oracles" / "variants.py", "cuda", "--ptx", out]
    command += ["--part", "0", "40"] if smallest.ASKED else []
    environment = cuda_stub.environment(driver, out, arch)
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)


def measure(path: Path, arch: int, program: str) -> list[Cost]:
    """Return what ptxas says of each loop in a file of PTX, which a card takes one after the other."""
    command = [program, f"-arch=sm_{arch}", "-v", str(path), "-o", "/dev/null"]
    told = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    found = dict(tasks(told, path.read_text()))
    order = sorted(found, key=lambda name: int(re.search(r"kernel_(\d+)_", name)[1]))
    return [found[name] for name in order if "range_for" in name] or list(found.values())


def tasks(told: str, text: str) -> Iterator[tuple[str, Cost]]:
    """Yield what each task of a kernel takes, by name: a loop, or the finding of its bounds."""
    for part in told.split("Compiling entry function")[1:]:
        name = part.split("'")[1]
        registers = int(re.search(r"Used (\d+) registers", part)[1])
        stack = max(map(int, re.findall(r"(\d+) bytes (?:cumulative )?stack", part)), default=0)
        limit = re.search(rf"\.entry {re.escape(name)}\([^)]*\)\s*\.maxntid (\d+)", text)
        warps = -(-int(limit[1] if limit else THREADS) // 32)
        lot = -(-registers * 32 // UNIT) * UNIT
        blocks = min(REGISTERS // (lot * warps), BLOCKS, WARPS // warps)
        spills = re.findall(r"(\d+) bytes spill stores, (\d+) bytes spill loads", part)
        spilled = sum(int(stored) + int(loaded) for stored, loaded in spills)
        yield name, Cost(blocks * warps / WARPS, registers, stack, spilled)


def worst(costs: list[Cost]) -> Cost:
    """Return the one with the most registers; of equals, with the most spilled."""
    return max(costs, key=lambda cost: (cost.registers, -cost.occupancy, cost.spilled, cost.stack))


def best(costs: list[Cost]) -> Cost:
    """Return the one with the fewest registers; of equals, with the least spilled."""
    return min(costs, key=lambda cost: (cost.registers, cost.spilled, cost.stack))


def table(found: dict[str, dict[int, list[Cost]]], archs: list[int]) -> Iterator[str]:
    """Yield the lines of a table in Markdown: `best - worst`, or one figure where both agree."""
    heads = [f"{what} sm_{arch}" for arch in archs for what in ("reg.", "spilled", "stack", "occ.")]
    yield "| kernel | variants | " + " | ".join(heads) + " |"
    yield "|---|" + "--:|" * (len(heads) + 1)
    for kernel, each in sorted(found.items()):
        cells = []
        for arch in archs:
            low, high = best(each[arch]), worst(each[arch])
            cells += [
                span(low.registers, high.registers),
                span(low.spilled, high.spilled),
                span(low.stack, high.stack),
                span(f"{low.occupancy:.2f}", f"{high.occupancy:.2f}"),
            ]
        yield f"| {kernel} | {len(each[archs[0]])} | " + " | ".join(cells) + " |"


def span(low: object, high: object) -> str:
    """Return two figures, or one where they agree."""
    return f"{low}" if low == high else f"{low} - {high}"


def main() -> None:
    """Make PTX, assemble it, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep the PTX there")
    parser.add_argument("--arch", type=int, nargs="+", default=[80, 90], help="90 for sm_90")
    options = smallest.parse(parser, arch=[90])
    if cuda_stub.why_not():
        smallest.lack(cuda_stub.why_not())
    program, found = find_ptxas() or smallest.lack(NO_PTXAS), defaultdict(dict)
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor() as pool:
        driver = cuda_stub.compiled(Path(scratch))
        for arch in options.arch:
            out = (options.keep or Path(scratch)) / f"sm_{arch}"
            out.mkdir(parents=True, exist_ok=True)
            make_ptx(driver, out, arch)
            files = sorted(out.glob("*.*.*.ptx"))
            costs = pool.map(measure, files, [arch] * len(files), [program] * len(files))
            for path, each in zip(files, costs, strict=True):
                for loop, cost in enumerate(each):
                    name = path.name.rsplit(".", 2)[0] + f", loop {loop + 1}" * (loop > 0)
                    found[name].setdefault(arch, []).append(cost)
    print("\n".join(table(found, options.arch)))


if __name__ == "__main__":
    main()
