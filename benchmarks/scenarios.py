"""What do hundreds of scenarios cost? The wall time of a run with its files, beside one scenario of
as many particles.

    python benchmarks/scenarios.py [--scenarios 300] [--particles 1e6] [--duration "48 h"]
    [--threads 2] [--only steer] [--keep FOLDER]

The many are reports scattered as the one is: normal, 25 nmi, in the Gulf of Mexico, south of its
coast; they differ in place, time, weight and object, and every other one sees another current.
`drift`: nothing but the drift; `search`: four sorties (legs, an area, a pattern on a drifting
datum, a curve with an unknown factor) and a contact, with resampling; `steer`: the same of voyages,
until a distress at an unknown time; `family`: the same of a `[[family]]` of voyages, by ten routes,
ten ranges of speed and as many of departure as it takes. Each runs in a process of its own after
one that compiles its kernels. A row is a phase of the run by the clock [s]; `whole` is all of it,
from the case file to the last file, `processor` the time that all its threads took together, which
tells more where other programs share the machine.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import smallest

import drift

HEAD = """
title = "{count} scenarios"
start = "2026-11-21T18:30Z"
duration = "{duration}"
particles = {particles}
seed = 3
output.every = "6 h"
coast.source = "gshhg"
uncertainty.current = {{ std = "0.31 m/s", time = "11 h", bias = "0.08 m/s" }}
uncertainty.wind = {{ std = "2 m/s", time = "12 h" }}
uncertainty.diffusivity = "10 m2/s"
[[current]]
name = "gulf"
analytic = "gulf"
[[current]]
name = "set"
constant = {{ speed = "0.4 kn", toward = 70 }}
[[wind]]
name = "breeze"
analytic = "breeze"
"""
SEARCH = """
resampling.below = 0.5
"""
SORTIES = """
[[sortie]]
name = "track"
start = "+13 h"
speed = "90 kn"
sweep_width = "1.3 nmi"
sweep_width_uncertainty = "30 %"
pattern = { kind = "parallel", centre = "27 50N 088 36W", length = "30 nmi", width = "18 nmi", orientation = 150, spacing = "1.5 nmi" }
[[sortie]]
name = "vessels"
start = "+15 h"
end = "+21 h"
law = "random"
pod = 0.25
area = { polygon = ["28 20N 089 00W", "28 20N 088 20W", "27 55N 088 20W", "27 55N 089 00W"] }
[[sortie]]
name = "sectors"
start = "+17 h"
speed = "90 kn"
sweep_width = "0.9 nmi"
frame = "datum"
pattern = { kind = "sector", datum = "27 52N 088 34W", radius = "8 nmi" }
[[sortie]]
name = "curve"
start = "+19 h"
speed = "150 kn"
sweep_width = "2.1 nmi"
sweep_width_uncertainty = "20 %"
law = { curve = [["0 nmi", 0.9], ["2.3 nmi", 0]] }
pattern = { kind = "creeping", centre = "27 36N 088 40W", length = "36 nmi", width = "16 nmi", orientation = 170, spacing = "1.5 nmi" }
[[contact]]
name = "flare"
time = "+26 h"
position = { at = "27 45N 088 20W", error = "15 nmi" }
belief = 0.6
"""
STORY = """
[[scenario]]
name = "{name}"
weight = {weight}
object = "{object}"
currents = ["{current}"]
position = {{ at = [{lon:.6f}, {lat:.6f}], std = "{std} nmi", time = "+{first} min", until = "+{last} min" }}
"""
UNDER_WAY = """
[[scenario]]
name = "{name}"
weight = {weight}
object = "{object}"
currents = ["{current}"]
distress = {{ rate = "0.03/h" }}
[[scenario.phase]]
[scenario.phase.voyage]
waypoints = [[{west:.6f}, {lat:.6f}], [{lon:.6f}, {lat:.6f}], [{east:.6f}, {north:.6f}]]
departure = ["+{first} min", "+{last} min"]
speed = ["4 kn", "9 kn"]
cross_track = "{std} nmi"
"""
ROUTE = """
[voyage.route{number}]
waypoints = [[{west:.6f}, {lat:.6f}], [{lon:.6f}, {lat:.6f}], [{east:.6f}, {north:.6f}]]
speed = "6 kn"
"""
FAMILY = """
[[family]]
name = "voyage"
scenario.object = "LIFE-RAFT-DB-10"
scenario.currents = ["gulf"]
scenario.distress = {{ rate = "0.03/h" }}
scenario.phase = [{{ voyage = {{ cross_track = "{std} nmi" }} }}]
axis.route = {{ key = "phase.1.voyage.like", values = [{routes}] }}
axis.speed = {{ key = "phase.1.voyage.speed", from = "4 kn", to = "9 kn", ranges = {ranges} }}
axis.departure = {{ key = "phase.1.voyage.departure", from = "+0 min", to = "+180 min", ranges = {departures} }}
"""
ROUTES = 2 if smallest.ASKED else 10  # of a family, and its ranges of speed
KINDS = ("drift", "search", "steer", "family")
RUN = ("drift",)  # in the smallest mode; of the others the cases are read
OBJECTS = ("LIFE-RAFT-DB-10", "PIW-1", "SKIFF-1")
LON, LAT, SPREAD, OWN = (
    -88.6,
    27.8,
    25.0,
    4.0,
)  # [deg], [nmi]: where; how far reports are scattered, and how far each errs


def story(kind: str, lon: float, lat: float, **keys: object) -> str:
    """Return a scenario about a place [deg]: a report of it, or a voyage through it."""
    return (UNDER_WAY if kind in ("steer", "family") else STORY).format(
        lon=lon, lat=lat, west=lon - 1.5, east=lon + 1.5, north=lat + 0.4, **keys
    )


def written(count: int, particles: int, duration: str, kind: str) -> str:
    """Return a case of so many scenarios."""
    search = kind != "drift"
    random = np.random.default_rng(5)
    head = HEAD.format(count=count, particles=particles, duration=duration)
    head = (SEARCH + head if search else head) + (SORTIES if search else "")
    if count == 1:
        return head + story(
            kind,
            LON,
            LAT,
            name="a",
            weight=1,
            object=OBJECTS[0],
            current="gulf",
            std=12 if kind in ("steer", "family") else SPREAD,
            first=0,
            last=180,
        )
    scatter = np.sqrt(SPREAD**2 - OWN**2)
    east, north = random.normal(0, scatter / 60, (2, count))
    if kind == "family":
        routes = [
            ROUTE.format(
                number=k, lon=LON + east[k], lat=LAT - 0.7 + north[k], west=LON + east[k] - 1.5, east=LON + east[k] + 1.5,
                north=LAT - 0.3 + north[k],
            )
            for k in range(ROUTES)
        ]  # fmt: skip
        names = ", ".join(f'"route{k}"' for k in range(ROUTES))
        return (
            head
            + "".join(routes)
            + FAMILY.format(std=OWN, routes=names, ranges=ROUTES, departures=count // ROUTES**2)
        )
    weight = random.gamma(0.7, size=count)
    weight = np.maximum(weight / weight.sum(), 1e-5)
    weight = np.round(weight / weight.sum(), 8)
    weight[-1] += round(1 - weight.sum(), 8)
    stories = [
        story(
            kind,
            LON + east[k] / np.cos(np.radians(LAT)),
            LAT + north[k],
            name=f"story {k + 1}",
            weight=f"{weight[k]:.8f}",
            object=OBJECTS[k % 3],
            current=("gulf", "set")[k % 2],
            std=OWN,
            first=k % 60,
            last=k % 60 + 120,
        )
        for k in range(count)
    ]
    return head + "".join(stories)


def run(case: Path, out: Path, threads: int) -> dict[str, float]:
    """Return the wall time [s] of a run by phase, and what all of it took."""
    begin, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    words = ["run", str(case), "--out", str(out), "--overwrite", "--threads", str(threads)]
    subprocess.run([sys.executable, "-m", "drift", *words], check=True, capture_output=True)
    whole, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime
    phases = json.loads((out / "summary.json").read_text())["wall_time_s"]
    size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file()) / 1e6
    return {**phases, "whole": whole, "processor": processor, "files [MB]": size}


def main() -> None:
    """Run both cases of each kind and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", type=int, default=300)
    parser.add_argument("--particles", type=float, default=1e6)
    parser.add_argument("--duration", default="48 h")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--only", default="", choices=("", *KINDS))
    parser.add_argument("--keep", type=Path, help="folder for the cases and their files")
    asked = smallest.parse(parser, scenarios=4, particles=1000, duration="27 h")
    if asked.only in ("", "family") and asked.scenarios % ROUTES**2:
        parser.error(f"--scenarios {asked.scenarios}: a family has a multiple of {ROUTES**2}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = asked.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for kind in KINDS:
            if asked.only not in ("", kind):
                continue
            if smallest.ASKED and kind not in RUN:
                path = folder / f"{kind}.toml"
                path.write_text(
                    written(asked.scenarios, int(asked.particles), asked.duration, kind),
                    encoding="utf-8",
                )
                print(f"{kind}: {len(drift.load(path).scenarios)} scenarios are read")
                continue
            found = []
            for count in (1, asked.scenarios):
                path = folder / f"{kind}-{count}.toml"
                # the first one compiles kernels
                sizes = (count * 10, int(asked.particles) // count * count)
                for particles in sizes[smallest.ASKED :]:
                    path.write_text(
                        written(count, particles, asked.duration, kind), encoding="utf-8"
                    )
                    times = run(path, folder / f"{kind}-{count}", asked.threads)
                found.append(times)
            print(
                f"{kind}: {int(asked.particles):,} particles, {asked.duration}\n{'':12}{'1':>10}{asked.scenarios:>10}{'ratio':>10}"
            )
            for phase in dict.fromkeys([*found[0], *found[1]]):
                one, many = (times.get(phase, 0.0) for times in found)
                print(f"{phase:12}{one:10.2f}{many:10.2f}{many / max(one, 1e-9):10.2f}", flush=True)


if __name__ == "__main__":
    main()
