"""Does any particle end inland? A large, long run on a real coast; every position of every output is tested.

    DRIFT_DATA=... python benchmarks/inland.py [PARTICLES] [HOURS]

A raft case on NorKyst and AROME, released all over the coastal sea, GSHHG at full resolution, errors and diffusion on.
"""

import sys
import tempfile
import time

import drift
from drift import start
from drift.motion import simulate
from drift.particles import ensemble as record
from geo import sphere
from geo.coast import edges as shoreline
from kernels import runtime

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


def main(particles: int = 1_000_000, hours: int = 60) -> None:
    """Run, test every position against the exact coast, and print the account."""
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(CASE.format(particles=particles, hours=hours))
        file.flush()
        case = drift.load(file.name)
    runtime.start()
    where = start.open_for(case)
    coast = where.coast
    assert coast is not None
    run = start.prepare(case, where)
    outputs = case.period.seconds(case.outputs)
    begin, inland, tested = time.perf_counter(), 0, 0
    for moment in simulate.run(run.ensemble, run.scene, run.clock, outputs):
        land = shoreline.is_land(coast, moment.lon, moment.lat)
        inland, tested = inland + int(land.sum()), tested + land.size
    run.scene.forcing.close()
    account = record.account(run.ensemble, moment.status).by_status.sum(axis=0)
    print(f"{particles:,} particles, {hours} h, step {run.clock.step} s, {time.perf_counter() - begin:.0f} s: {inland} of "
          f"{tested:,} positions inland; adrift {account[0]:.1%}, ashore {account[1]:.1%}, without forcing {account[2]:.1%}, "
          f"left {account[3]:.1%}; prior on land {run.dry[0]:.1%}; grid cell {(1 << coast.shift) * sphere.UNIT * 6371:.2f} km")  # fmt: skip


if __name__ == "__main__":
    main(*(int(float(x)) for x in sys.argv[1:]))
