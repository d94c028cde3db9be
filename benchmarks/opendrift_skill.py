"""Clouds of OpenDrift's OceanDrift for the forecasts of benchmarks/skill.py, which runs this file.

It runs in an environment of OpenDrift's own (it is no dependency of ours), and takes and gives
arrays:

    python benchmarks/opendrift_skill.py FORECASTS.npz CLOUDS.npz

Each forecast has a current by time that is the same everywhere, and starts of particles. Everything
that SETTINGS does not name is OpenDrift's default: Euler steps of an hour, no error of the current
and no diffusivity. There is no wind of its own (the current holds the windage), no waves, no coast.
"""

import argparse
import multiprocessing
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import smallest

smallest.need("opendrift")  # whose environment need not hold ours
import numpy as np
from opendrift import __version__
from opendrift.models.oceandrift import OceanDrift
from opendrift.readers import reader_timeseries

HOURS = 48
OUTPUT = 3  # [h]
NONE = dict.fromkeys(
    (
        "land_binary_mask",
        "x_wind",
        "y_wind",
        "sea_surface_wave_stokes_drift_x_velocity",
        "sea_surface_wave_stokes_drift_y_velocity",
    ),
    0,
)


def drifted(task: tuple[Any, ...]) -> np.ndarray:
    """Return lon and lat [deg] of the particles every OUTPUT hours, (2, particles, times).

    task: start [s since 1970], current east and north [m/s] each hour, lon and lat of the starts,
    current_uncertainty [m/s], horizontal_diffusivity [m2/s], seed.
    """
    start, east, north, lon, lat, std, diffusivity, seed = task
    begin = datetime(1970, 1, 1) + timedelta(seconds=int(start))
    times = [begin + timedelta(hours=k) for k in range(HOURS + 1)]
    model = OceanDrift(loglevel=50)
    current = {"time": times, "x_sea_water_velocity": east, "y_sea_water_velocity": north}
    model.add_reader(reader_timeseries.Reader(current))
    for name, value in NONE.items():
        model.set_config(f"environment:constant:{name}", value)
    if diffusivity > 0:
        model.set_config("environment:constant:horizontal_diffusivity", diffusivity)
    model.set_config("drift:current_uncertainty", std)
    np.random.seed(seed)  # noqa: NPY002 (OpenDrift draws from it)
    model.seed_elements(lon=lon, lat=lat, time=begin)
    step = timedelta(hours=1)
    model.run(duration=HOURS * step, time_step=step, time_step_output=OUTPUT * step)
    found = model.result
    return np.stack([found.lon.values, found.lat.values]).astype(float)


def example() -> dict[str, np.ndarray]:
    """Return one forecast of few particles."""
    hours = np.arange(HOURS + 1)
    start = np.array([datetime(2020, 9, 1).timestamp()])
    east, north = 0.3 * np.sin(hours / 5)[None], 0.2 * np.cos(hours / 5)[None]
    lon, lat = np.full((1, 20), -60.3), np.full((1, 20), 44.7)
    return {"start": start, "east": east, "north": north, "lon": lon, "lat": lat,
            "std": np.array([0.3]), "diffusivity": np.array([0.0])}  # fmt: skip


def main() -> None:
    """Write the clouds of all forecasts: lon, lat (forecasts, particles, times), and the version."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", nargs="?", type=Path)
    parser.add_argument("target", nargs="?", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    given = smallest.parse(parser, workers=1)
    asked = dict(np.load(given.source)) if given.source else example()
    names = ("start", "east", "north", "lon", "lat", "std", "diffusivity")
    tasks = [(*row, k) for k, row in enumerate(zip(*(asked[name] for name in names), strict=True))]
    if given.workers > 1:
        with multiprocessing.Pool(given.workers) as pool:
            clouds = pool.map(drifted, tasks, chunksize=1)
    else:
        clouds = [drifted(task) for task in tasks]
    lon, lat = np.stack(clouds, axis=1)
    if given.target:
        np.savez_compressed(given.target, lon=lon, lat=lat, version=__version__)
    print(f"OpenDrift {__version__}: {len(tasks)} forecasts of {lon.shape[1]} particles")


if __name__ == "__main__":
    main()
