"""Drifters simulated in float64 in a current and a wind, with errors of known parameters."""

import math
from types import MappingProxyType

import numpy as np

from drift.assess.verify import along
from drift.assess.verify.error_law import Law
from drift.tracking.tracks.records import Track

TRUE = Law(std=0.23, time=4.3 * 3600, bias=0.19, diffusivity=9.0, noise=130.0)
WINDAGE, MEAN = 0.017, (0.06, -0.035)
RADIUS = 6_371_008.8  # [m] of the sphere


def current(lon, lat, time):
    """East and north [m/s]: a shear, a tide and a trend, nowhere the same in both components."""
    tide = 2 * np.pi * time / (12.42 * 3600)
    return 0.21 + 0.09 * np.sin(tide + 0.4) + 0.3 * (lat - 47.0), -0.13 + 0.06 * np.cos(
        tide
    ) + 0.2 * (lon + 6.0)


def wind(lon, lat, time):
    """East and north [m/s], turning in three days."""
    turn = 2 * np.pi * time / (71 * 3600)
    return 4.0 + 5.5 * np.cos(turn), -2.5 + 4.2 * np.sin(turn + 1.1)


def simulated(rng, drifters, days, law=TRUE, step=300.0, start=1.0e9):
    """Return tracks with columns of the model at the fixes:

    Euler steps of a known flow, exact ones of the errors.
    """
    n = round(days * 86_400 / step)
    lon, lat = rng.uniform(-6.2, -5.6, drifters), rng.uniform(46.7, 47.3, drifters)
    bias = rng.normal(0, law.bias, (2, drifters))
    error = rng.normal(0, law.std, (2, drifters))
    phi = math.exp(-step / law.time)
    path = [(lon, lat)]
    for k in range(n):
        t = start + (k + 0.5) * step
        new = phi * error + law.std * math.sqrt(1 - phi**2) * rng.standard_normal((2, drifters))
        walk = rng.normal(0, math.sqrt(2 * law.diffusivity * step), (2, drifters))
        velocity = np.add(current(lon, lat, t), WINDAGE * np.array(wind(lon, lat, t))[:, None])
        moved = (velocity + np.array(MEAN)[:, None] + bias + (error + new) / 2) * step + walk
        error = new
        middle = lat + np.degrees(moved[1] / 2 / RADIUS)
        lat = lat + np.degrees(moved[1] / RADIUS)
        lon = lon + np.degrees(moved[0] / RADIUS / np.cos(np.radians(middle)))
        path.append((lon, lat))
    lons, lats = np.array(path).transpose(1, 0, 2)
    tracks = []
    for d in range(drifters):
        gaps = rng.choice([2, 7, 13, 20], n)  # of 10 to 100 minutes
        at = np.concatenate([[0], np.cumsum(gaps)])
        at = at[at <= n]
        time = start + at * step
        north = rng.normal(0, law.noise, at.size)
        east = rng.normal(0, law.noise, at.size)
        y = lats[at, d] + np.degrees(north / RADIUS)
        x = lons[at, d] + np.degrees(east / RADIUS / np.cos(np.radians(y)))
        u, v = current(lons[at, d], lats[at, d], time)
        a, b = wind(lons[at, d], lats[at, d], time)
        tracks.append(Track(f"buoy {d}", time, x, y, {"u": u, "v": v, "a": a, "b": b}))
    return tracks


COLUMNS = {"current_east": "u", "current_north": "v", "wind_east": "a", "wind_north": "b"}


class Bare:
    """A case without sources: all forcing comes from columns."""

    forcing = MappingProxyType({})


def ways(tracks):
    return along.compare_displacements(Bare, tracks, COLUMNS, 3 * 3600.0, 3.0).ways
