"""Does any particle end inland? A large, long run on a real coast; every position of every output
is tested.

    DRIFT_DATA=... python benchmarks/inland.py [PARTICLES] [HOURS]
    python benchmarks/inland.py medsearch_transit [PARTICLES]

A raft case on NorKyst and AROME, released all over the coastal sea, GSHHG at full resolution,
errors and diffusion on; or a shipped case in which all steer, at times inside its steps, whose
positions Shapely tests as well.
"""

import argparse
import tempfile
import time
from typing import Any

import numpy as np
import shapely
import smallest

import drift
from drift.engine.motion import simulate
from drift.engine.particles import ensemble as record
from drift.engine.particles.status import Status
from drift.pipeline import run_setup
from geo import sphere
from geo.coast import edges as shoreline
from kernels.runtime import runtime

CASE = """
start = "2015-11-16T00:00Z"
duration = "{hours} h"
particles = {particles}
max_lost = 1.0
output.every = "6 h"
[[current]]
name = "norkyst"
files = "${{DRIFT_DATA}}/norkyst/norkyst800*.nc"
fill = 20
[[wind]]
name = "arome"
files = "${{DRIFT_DATA}}/norkyst/arome*.nc"
[uncertainty]
current = {{ std = "0.15 m/s", time = "6 h" }}
wind = {{ std = "2 m/s", time = "6 h" }}
diffusivity = "10 m2/s"
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-11"
area.polygon = ["60 10N 004 30E", "60 10N 005 30E", "61 30N 005 30E", "61 30N 004 20E"]
"""


def measure(name: str, particles: int = 1_000_000, hours: int = 60) -> None:
    """Run, test every position against the exact coast and by Shapely, and print the account."""
    if name:
        # Outputs at 438 minutes lie inside steps of an hour.
        case = drift.vary(
            drift.load(name), {"particles": particles, "output": {"every": "438 min"}}
        )
    else:
        smallest.data()
        with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
            file.write(CASE.format(particles=particles, hours=hours))
            file.flush()
            case = drift.load(file.name)
    runtime.start()
    where = run_setup.open_for(case)
    coast = where.coast
    assert coast is not None
    run = run_setup.prepare(case, where)
    outputs = case.period.seconds(case.outputs)
    land = shapely.STRtree(coast.polygons)
    shapely.prepare(coast.polygons)
    begin, inland, tested, within = time.perf_counter(), 0, 0, 0
    for moment in simulate.run(run.ensemble, run.scene, run.clock, outputs):
        inland, tested = (
            inland + int(shoreline.is_land(coast, moment.lon, moment.lat).sum()),
            tested + moment.lon.size,
        )
        # what steers stays off the shore; what has come ashore lies on it, where Shapely's rounding
        # decides
        if name:
            lon, lat = (np.asarray(x, float) * 360 / 2**32 for x in (moment.lon, moment.lat))
            within += _within(
                coast.polygons,
                land,
                sphere.near_degrees(lon, (where.box.west + where.box.east) / 2),
                lat,
            )
    run.scene.forcing.close()
    account = np.bincount(moment.status, record.probability(run.ensemble), len(Status))
    told = ", ".join(
        f"{status.name.lower().replace('_', ' ')} {account[status]:.1%}"
        for status in Status
        if account[status] > 0
    )
    shapely_too = f" ({within} by Shapely)" if name else ""
    print(f"{case.particles:,} particles, {(case.end - case.start) / np.timedelta64(1, 'h'):g} h, step {run.clock.step} s, {time.perf_counter() - begin:.0f} s: "
          f"{inland} of {tested:,} positions inland{shapely_too}; {told}; prior on land {max(run.dry):.1%}; "
          f"grid cell {(1 << coast.shift) * sphere.UNIT * 6371:.2f} km")  # fmt: skip


def _within(polygons: Any, tree: Any, lon: Any, lat: Any) -> int:
    """Return how many of points [deg] lie in one of the polygons, which are prepared; tree: of
    them.
    """
    point, polygon = tree.query(shapely.points(lon, lat))
    order = np.argsort(polygon, kind="stable")
    point, polygon = point[order], polygon[order]
    inside = np.zeros(len(lon), bool)
    for some in np.split(np.arange(len(point)), np.flatnonzero(np.diff(polygon)) + 1):
        if some.size:
            these = point[some]
            inside[these] |= shapely.contains_xy(polygons[polygon[some[0]]], lon[these], lat[these])
    return int(inside.sum())


def main() -> None:
    """Measure the case that is asked for; in the smallest mode both kinds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("words", nargs="*", metavar="CASE, PARTICLES, HOURS")
    words = smallest.parse(parser).words
    if smallest.ASKED:
        measure("medsearch_transit", 500)
        measure("", 500, 12)
        return
    name = words.pop(0) if words and words[0].isidentifier() else ""
    measure(name, *(int(float(word)) for word in words))


if __name__ == "__main__":
    main()
