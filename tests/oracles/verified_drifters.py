"""Drifters carried by a uniform current, simulated in float64, and their case."""

import math

import numpy as np

import drift
from drift.tracking.tracks.records import Track

RADIUS = 6_371_008.8  # [m] of the sphere
EAST, NORTH = 0.31, -0.17  # [m/s] a current that is the same everywhere
CASE = """
title = "Simulated drifters"
start = "2021-03-01T00:00Z"
duration = "24 h"
clock.step = "30 min"
coast.source = "none"
current = [{{ name = "known", constant = {{ east = {east}, north = {north} }} }}]
[uncertainty]
current = {{ std = "{std} m/s", time = "{time} h" }}
diffusivity = "{diffusivity} m2/s"
[[scenario]]
name = "drifter"
object = "water"
position = {{ at = [1.0, 45.0], std = "1 nmi" }}
"""


def case(tmp_path, std=0.26, time=7.0, diffusivity=25.0, east=EAST, north=NORTH):
    file = tmp_path / "case.toml"
    file.write_text(
        CASE.format(std=std, time=time, diffusivity=diffusivity, east=east, north=north)
    )
    return drift.load(file)


def carried(lon, lat, seconds, east=EAST, north=NORTH):
    """Return where a steady east and north [m/s] lead [deg]: a rhumb line on the sphere, in closed
    form.
    """
    begin, end = np.radians(lat), np.radians(lat) + north * seconds / RADIUS
    stretched = np.arcsinh(np.tan(end)) - np.arcsinh(np.tan(begin))
    return lon + np.degrees(east / north * stretched), np.degrees(end)


def simulated(count, seed, std=0.26, time=7.0, diffusivity=25.0, error=600.0, hours=24):
    """Return tracks with hourly fixes of what drifts in the known current with errors; the first
    fix alone is in error.

    The errors' displacements are drawn hour by hour from their exact joint law (Uhlenbeck and
    Ornstein 1930).
    """
    rng = np.random.default_rng(seed)
    dt, memory = 3600.0, time * 3600
    fall = math.exp(-dt / memory)
    var_x = std**2 * memory**2 * (2 * dt / memory - 3 + 4 * fall - fall**2) + 2 * diffusivity * dt
    cov = np.array([[var_x, std**2 * memory * (1 - fall) ** 2], [0, std**2 * (1 - fall**2)]])
    cov[1, 0] = cov[0, 1]
    factor = np.linalg.cholesky(cov)
    velocity = rng.normal(0, std, (2, count))
    moved = np.zeros((hours + 1, 2, count))
    for k in range(hours):
        noise = np.einsum("ij,jcn->icn", factor, rng.standard_normal((2, 2, count)))
        moved[k + 1] = moved[k] + memory * (1 - fall) * velocity + noise[0]
        velocity = fall * velocity + noise[1]
    tracks = []
    start = np.datetime64("2021-03-01T05:00", "s").astype(int)
    scatter = rng.normal(0, error / math.sqrt(2 * math.log(2)), (2, count))
    for n in range(count):
        times = start + 3 * 86_400 * n + dt * np.arange(hours + 1)  # each on days of its own
        lon, lat = carried(
            -30.0 + rng.uniform(0, 50), rng.uniform(-58, 58), times - times[0] + 1e-9
        )
        lat = lat + np.degrees(moved[:, 1, n] / RADIUS)
        lon = lon + np.degrees(moved[:, 0, n] / RADIUS / np.cos(np.radians(lat)))
        lat[0] += np.degrees(scatter[1, n] / RADIUS)
        lon[0] += np.degrees(scatter[0, n] / RADIUS / np.cos(np.radians(lat[0])))
        tracks.append(Track(f"buoy {n}", times, lon, lat))
    return tracks
