"""How much time, memory and disk do many particles take? A built-in flow, errors, diffusion, wind;
in shards or in one piece.

    python benchmarks/scale.py --particles 1e8 --hours 24 --outputs 9 --memory "3 GB"
    python benchmarks/scale.py --current "norkyst/norkyst800*.nc" --wind "norkyst/arome*.nc"
        --start 2015-11-16T00:00Z --at 4.25 60

Prints seconds by phase, the peak of resident memory of the process, how it went over time, the most
that lay on disk, and the cost of a particle-step.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from datetime import datetime, timedelta
from pathlib import Path

import smallest

ISO = "%Y-%m-%dT%H:%MZ"
CASE = """
title = "scale"
start = "{start}"
duration = "{hours} h"
particles = {particles}
seed = 3
output = {{ every = "{every:.6f} h", trajectories = 100 }}
clock.step = "1 h"
coast.source = "none"
{forcing}
[uncertainty]
current = {{ std = "0.1 m/s", time = "36 h" }}
wind = {{ std = "2 m/s", time = "12 h" }}
diffusivity = "10 m2/s"
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-10"
position = {{ at = [{lon}, {lat}], error = "10 km", time = "+0 h" }}
"""
BUILT_IN = """[[current]]
analytic = "gulf"
[[wind]]
constant = { speed = "8 m/s", from = 250 }
"""
SORTIE = """[[sortie]]
name = "sortie {number}"
unit = "Aircraft"
start = "{start}"
speed = "150 kn"
sweep_width = "0.6 nmi"
pattern = {{ kind = "parallel", centre = [{lon}, {lat}], length = "30 nmi", width = "20 nmi", orientation = 150, spacing = "1 nmi" }}
"""
FILES = """[[current]]
files = '{current}'
[[wind]]
files = '{wind}'
"""


def measured(command: list[str], folder: Path) -> tuple[list[tuple[float, float]], float, float]:
    """Return memory over time [(s, GiB)], its peak [GiB], and the most on disk [GiB], of a command
    that is run.
    """
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    begin, line, disk, peak = time.monotonic(), [], [0.0], [0.0]

    def watch() -> None:
        while process.poll() is None:
            try:
                told = dict(
                    row.split(":", 1)
                    for row in Path(f"/proc/{process.pid}/status").read_text().splitlines()
                )
                line.append((time.monotonic() - begin, int(told["VmRSS"].split()[0]) / 2**20))
                peak[0] = max(peak[0], int(told["VmHWM"].split()[0]) / 2**20)
                disk[0] = max(
                    disk[0], sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 2**30
                )
            except (OSError, KeyError):
                pass
            time.sleep(0.5)

    watcher = threading.Thread(target=watch)
    watcher.start()
    out, _ = process.communicate()
    watcher.join()
    if process.returncode:
        sys.exit(out)
    return line, peak[0], disk[0]


def main() -> None:
    """Run, and print."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--particles", type=float, default=1e6)
    options.add_argument("--hours", type=int, default=24)
    options.add_argument("--outputs", type=int, default=9)
    options.add_argument("--memory")
    options.add_argument("--shards", type=int)
    options.add_argument("--threads", type=int, default=2)
    options.add_argument(
        "--workers", type=int, help="of one thread each; memory is that of the first process alone"
    )
    options.add_argument("--folder", type=Path, help="where files lie meanwhile (a real disk)")
    options.add_argument(
        "--sorties", type=int, default=0, help="that find nothing, one after another"
    )
    options.add_argument("--current", help="files of a current, instead of the built-in flow")
    options.add_argument("--wind", help="files of a wind")
    options.add_argument("--start", default="2026-06-01T00:00Z")
    options.add_argument("--at", type=float, nargs=2, metavar=("LON", "LAT"), default=(-88.0, 26.5))
    given = smallest.parse(options, particles=9000, hours=9, outputs=2, shards=2, sorties=1)
    particles, (lon, lat) = int(given.particles), given.at
    files = FILES.format(current=given.current, wind=given.wind)
    with tempfile.TemporaryDirectory(dir=given.folder) as name:
        folder = Path(name)
        text = CASE.format(
            hours=given.hours,
            particles=particles,
            every=given.hours / (given.outputs - 1),
            forcing=files if given.current else BUILT_IN,
            lon=lon,
            lat=lat,
            start=given.start,
        )
        first = datetime.strptime(given.start, ISO)
        text += "".join(
            SORTIE.format(
                number=k, lon=lon, lat=lat, start=f"{first + timedelta(hours=5 + 4 * k):{ISO}}"
            )
            for k in range(given.sorties)
        )
        (folder / "case.toml").write_text(text)
        command = [
            sys.executable,
            "-m",
            "drift",
            "run",
            str(folder / "case.toml"),
            "--out",
            str(folder / "out"),
            "--quiet",
        ]
        command += ["--threads", str(given.threads)]
        command += ["--memory", given.memory] if given.memory else []
        command += ["--shards", str(given.shards)] if given.shards else []
        command += ["--workers", str(given.workers)] if given.workers else []
        begin = time.perf_counter()
        line, peak, disk = measured(command, folder)
        wall = time.perf_counter() - begin
        seconds = json.loads((folder / "out" / "summary.json").read_text())["wall_time_s"]
    print(
        f"{particles:,} particles, {given.hours} h, {given.outputs} outputs, {given.sorties} sorties, {given.threads} threads, memory {given.memory}, shards {given.shards}, workers {given.workers}"
    )
    print(
        f"wall {wall:.1f} s; "
        + ", ".join(f"{phase} {value:.1f}" for phase, value in seconds.items())
    )
    print(
        f"a particle-step: drift {seconds['drift'] / particles / given.hours * 1e9:.0f} ns, all {wall / particles / given.hours * 1e9:.0f} ns"
    )
    print(
        f"peak memory {peak:.2f} GiB ({peak * 2**30 / particles:.0f} bytes a particle), disk {disk:.2f} GiB"
    )
    print(
        "over time: "
        + ", ".join(f"{when:.0f} s {held:.2f}" for when, held in line[:: max(len(line) // 16, 1)])
    )


if __name__ == "__main__":
    main()
