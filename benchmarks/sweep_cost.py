"""What a sortie costs: time per particle and leg, by law, for particles that drift amid a parallel
sweep.

    python benchmarks/sweep_cost.py [--particles 1e6] [--threads N] [--json FILE]

A leg is a straight one, cross legs counted. The best of several runs counts; nothing else should
run meanwhile.
"""

import argparse
import time

import numpy as np
import smallest
from rich.console import Console
from rich.table import Table

from drift.engine.motion.models.drift import COLUMNS
from drift.engine.particles import ensemble as record
from drift.evidence.filter import patterns
from drift.evidence.filter.detection import laws, sensor_path
from drift.evidence.filter.records import Law
from geo import sphere
from kernels.evidence import sweep
from kernels.runtime import runtime
from kernels.steering import pieces

NMI = 1852.0
HOUR = 3600
TIMES = 5


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--particles", type=float, default=1e6)
    options.add_argument("--threads", type=int)
    given = smallest.parse(options, saves=True, particles=1000)
    runtime.start("cpu", given.threads)
    n = int(given.particles)
    pattern = patterns.parallel((4.0, 58.0), 24 * NMI, 20 * NMI, 0.6, NMI, 0.0, 150 * NMI / HOUR)
    path = sensor_path.of_legs(pattern.legs, 0)
    legs, span = len(pattern.legs.time) - 1, int(np.ceil(path.time[-1]))
    random = np.random.default_rng(1)
    east, north = random.normal(0, 8 * NMI, (2, n))
    lon, lat = sphere.destination(np.radians(4.0), np.radians(58.0), east, north)
    later = sphere.destination(lon, lat, 500.0, 300.0)
    ensemble = record.empty(1, (0, n), COLUMNS)
    before = [runtime.upload(sphere.to_binary(np.degrees(x))) for x in (lon, lat)]
    ensemble.lon.from_numpy(sphere.to_binary(np.degrees(later[0])))
    ensemble.lat.from_numpy(sphere.to_binary(np.degrees(later[1])))
    ensemble.status.fill(0)
    track = path.between(0, span, 0, None, (0.0, 0.0))
    at_lon, at_lat, ring = sensor_path.ring(pattern.area)
    place = sensor_path.path_of_fixed_sensor(at_lon, at_lat, 0, span).between(
        0, span, 0, None, (0.0, 0.0)
    )
    curve = np.stack(laws.range_curve(Law("m_beta", 0.8)), axis=1).reshape(-1)
    exposure = runtime.empty(n)
    jobs = {
        "inverse cube": (sweep.CUBE, track, np.zeros(1), np.ones(1), legs),
        "M-beta": (sweep.ABEAM, track, curve, np.array([1 / NMI]), legs),
        "area": (sweep.INSIDE, place, ring, np.ones(1), 1),
    }
    after = ensemble.lon, ensemble.lat
    cost = {}
    paths = pieces.straight(ensemble, ensemble.batch([0]), tuple(before), after, 0, span)
    table = Table(
        "exposure", "legs", "pieces", "ms", "ns per particle and leg", title=f"{n:,} particles"
    )
    for name, (kind, way, numbers, scale, count) in jobs.items():
        best = np.inf
        for _ in range(TIMES):
            runtime.wait()
            begin = time.perf_counter()
            sweep.expose(ensemble, paths, kind, way, numbers, scale, exposure)
            runtime.wait()
            best = min(best, time.perf_counter() - begin)
        cost[name] = round(1e9 * best / n / count, 2)
        table.add_row(
            name,
            str(count),
            str(len(way.time) - 1),
            f"{1e3 * best:.0f}",
            f"{cost[name]:.2f}",
        )
    weight = runtime.empty(n)
    for factors in (1, laws.NODES):
        shared, chances = runtime.empty(n * factors), np.full(factors, 1 / factors, np.float32)
        best = np.inf
        for _ in range(TIMES):
            begin = time.perf_counter()
            sweep.fail(
                ensemble.scenario, sweep.HAZARD, exposure, np.ones(factors), chances, shared, weight
            )
            runtime.wait()
            best = min(best, time.perf_counter() - begin)
        table.add_row(f"weights, {factors} factors of W", "", "", f"{1e3 * best:.0f}", "")
    Console(width=110).print(table)
    smallest.save(given, {"particles": n, "ns_per_particle_and_leg": cost})


if __name__ == "__main__":
    main()
