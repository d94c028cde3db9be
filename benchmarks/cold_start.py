"""Wall time of the default case by phase: with empty caches (first run ever), then with full ones.

    python benchmarks/cold_start.py [CASE] [--json FILE]

Phases: import, taichi, read (forcing, coast), start (prior, choice of the step), drift, products,
write. Kernels compile where they are first called: what start, drift and products lose from the
first to the second run is compilation, what read loses is the decoding of GSHHG. Then comes the
processor time of all processes, which tells more where others use the machine too. Last are
`drift --help` and `import drift`, each in a process of its own, and the load of the machine (mean
number of processes that run or wait, over a minute) before each run: with a load above its number
of cores, wall times are of no use.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import smallest
from rich.console import Console
from rich.table import Table

PROGRAM = """
import json, os, sys, time
from pathlib import Path
begin = time.perf_counter()
import drift
from drift.pipeline import flow
imported = time.perf_counter() - begin
result = drift.run(drift.load(sys.argv[1]), Path(sys.argv[2]))
phases = {"import": imported, **result.summary["wall_time_s"]}
print(json.dumps({**phases, "whole": time.perf_counter() - begin, "processor": sum(os.times()[:4])}))
"""

SHORT = {"drift --help": ("-m", "drift", "--help"), "import drift": ("-c", "import drift")}


def timed(case: str, place: Path, number: int) -> dict[str, float]:
    """Return the phases [s] of one run in a fresh process, with its caches under `place`."""
    caches = {
        "DRIFT_CACHE": str(place / "drift"),
        "TI_OFFLINE_CACHE_FILE_PATH": str(place / "taichi"),
        "MPLCONFIGDIR": str(place / "mpl"),
    }
    command = [sys.executable, "-c", PROGRAM, case, str(place / f"out{number}")]
    load = os.getloadavg()[0]
    done = subprocess.run(
        command, env={**os.environ, **caches}, check=True, capture_output=True, text=True
    )
    phases: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    for name, arguments in SHORT.items():
        begin = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        phases[name] = time.perf_counter() - begin
    return {**phases, "load": load}


def main() -> None:
    """Run twice and print the phases."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("case", nargs="?", default="overdue_boat")
    given = smallest.parse(options, saves=True, case=str(smallest.CASE))
    with tempfile.TemporaryDirectory() as folder:
        runs = [timed(given.case, Path(folder), k) for k in range(2)]
    table = Table(title=f"{given.case}: seconds by phase")
    for heading in ("phase", "empty caches", "full caches"):
        table.add_column(heading, justify="left" if heading == "phase" else "right")
    for phase in runs[0]:
        table.add_row(phase, *(f"{run[phase]:.2f}" for run in runs))
    Console().print(table)
    smallest.save(given, {"case": given.case, "empty_caches": runs[0], "full_caches": runs[1]})


if __name__ == "__main__":
    main()
