"""How many small forecasts a second does one process make? In a loop of runs, and by
drift.run_many; and what does a map cost?

    python benchmarks/many.py [--forecasts 40] [--particles 4000] [--case CASE] [--json FILE]

Without CASE: 24 h of a raft in a made-up 3-hourly current and wind on regular grids off Norway,
with errors and diffusion, in the open sea without a coast and along the Norwegian one. Forecasts
differ in start, place and seed. `a second` is by the clock; `own` is what the main thread computed
for a forecast, `all` what all threads did, Taichi's and those of the maps among them: they tell
more where other programs share the machine.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import smallest
import xarray as xr

import drift
from drift.engine.motion import prior, step_size
from drift.forecast import build as forecast_build
from drift.pipeline import run_setup

CASE = """
start = "2026-11-21T00:00Z"
duration = "24 h"
particles = {particles}
output.every = "6 h"
coast = {{ source = "{coast}" }}
current = [{{ files = "{folder}/current.nc" }}]
wind = [{{ files = "{folder}/wind.nc" }}]
uncertainty.current = {{ std = "0.2 m/s", time = "10 h" }}
uncertainty.wind = {{ std = "1.5 m/s", time = "6 h" }}
uncertainty.diffusivity = "10 m2/s"
[[scenario]]
name = "raft"
object = "LIFE-RAFT-DB-11"
position = {{ at = [{lon}, {lat}], error = "1 nmi" }}
"""
PLACES = {"open sea, no coast": (1.0, 61.0, "none"), "Norwegian coast": (4.55, 60.9, "gshhg")}
MAPS: dict[str, Any] = {"no map": False, "one map": "last", "all maps": True}
PHASES = (
    (run_setup, "open_for"),
    (run_setup, "prepare"),
    (step_size, "choose_step"),
    (prior, "draw_ensemble"),
    (forecast_build, "begin"),
)


def write(folder: Path) -> None:
    """Write a current and a wind that turn in time and differ in space."""
    lon, lat = np.arange(-8.0, 14.0, 0.1), np.arange(55.0, 67.0, 0.05)
    when = np.datetime64("2026-11-20T21:00", "ns") + np.arange(24) * np.timedelta64(3, "h")
    x, y = np.meshgrid(lon, lat)
    for name, size, keys in (
        ("current", 0.5, ("eastward_sea_water_velocity", "northward_sea_water_velocity")),
        ("wind", 9.0, ("eastward_wind", "northward_wind")),
    ):
        phase = [0.4 * k + 0.9 * x - 1.3 * y for k in range(when.size)]
        parts = {
            "u": [size * np.cos(p) for p in phase],
            "v": [0.8 * size * np.sin(p + 0.5) for p in phase],
        }
        data = {
            part: (
                ("time", "lat", "lon"),
                np.array(values, np.float32),
                {"standard_name": key, "units": "m s-1"},
            )
            for (part, values), key in zip(parts.items(), keys, strict=True)
        }
        xr.Dataset(data, {"time": when, "lat": lat, "lon": lon}).to_netcdf(folder / f"{name}.nc")


def varied(base: drift.Case, count: int) -> list[drift.Case]:
    """Return cases that begin up to 12 h later and up to 20 km away."""
    first = base.scenarios[0].prior
    lon, lat = (float(np.degrees(np.mean(angle))) for angle in (first.lon, first.lat))
    rng = np.random.default_rng(1)
    return [
        drift.vary(
            base,
            {
                "start": base.start + np.timedelta64(int(rng.integers(0, 12 * 3600)), "s"),
                "seed": k,
                "scenario.0.position.at": [lon - 0.2 * rng.random(), lat + 0.15 * rng.random()],
            },
        )
        for k in range(count)
    ]


def timed(spent: dict[str, float]) -> None:
    """Add up what the main thread computes in each phase."""
    for module, name in PHASES:
        setattr(module, name, _measured(getattr(module, name), name, spent))


def _measured(inner: Callable[..., Any], name: str, spent: dict[str, float]) -> Callable[..., Any]:
    def measured(*given: Any, **more: Any) -> Any:
        begin = time.thread_time()
        try:
            return inner(*given, **more)
        finally:
            spent[name] = spent.get(name, 0.0) + time.thread_time() - begin

    return measured


def told(title: str, made: Iterable[Any], count: int, spent: dict[str, float]) -> dict[str, float]:
    """Print and return how fast forecasts come, and print what of it is spent where."""
    spent.clear()
    clocks = time.perf_counter, time.thread_time, time.process_time
    begun = [clock() for clock in clocks]
    refused = [one.error for one in made if getattr(one, "error", None)]
    wall, own, total = (clock() - begin for clock, begin in zip(clocks, begun, strict=True))
    parts = "  ".join(f"{name} {1000 * spent.get(name, 0.0) / count:5.1f}" for _, name in PHASES)
    print(
        f"{title:46} {count / wall:6.1f} a second  own {1000 * own / count:6.1f} all {1000 * total / count:6.1f} ms   {parts}  {refused[:1] or ''}"
    )
    return {"a_second": round(count / wall, 2), "processor_ms": round(1000 * total / count, 1)}


def main() -> None:
    """Forecast the same cases in three ways, with and without a coast."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--forecasts", type=int, default=40)
    options.add_argument("--particles", type=int, default=4000)
    options.add_argument("--case", type=Path)
    given = smallest.parse(options, saves=True, forecasts=2, particles=200)
    spent: dict[str, float] = {}
    found = {}
    timed(spent)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(folder)
        cases = {str(given.case): given.case}
        if given.case is None:
            cases = {}
            for place, (lon, lat, coast) in PLACES.items():
                cases[place] = folder / f"{len(cases)}.toml"
                text = CASE.format(
                    particles=given.particles, folder=folder, lon=lon, lat=lat, coast=coast
                )
                cases[place].write_text(text)
        print(
            "[ms] of the main thread by phase; open_for: files and coast, prepare: all of the start, begin: of the maps what needs the device"
        )
        for place, path in cases.items():
            some = varied(drift.load(path), given.forecasts)
            few = max(given.forecasts // 8, 1)
            drift.run(some[0])  # compiles
            list(drift.run_many(some[:1], maps="last"))
            title = f"{place}: drift.run in a loop"
            found[title] = told(title, map(drift.run, some[:few]), few, spent)
            for kind, maps in MAPS.items():
                title = f"{place}: run_many, {kind}"
                made = drift.run_many(some, maps=maps)
                found[title] = told(title, made, given.forecasts, spent)
    smallest.save(given, {"particles": given.particles, "forecasts": found})


if __name__ == "__main__":
    main()
