"""The default errors reach the particles of searches, plans and paths in port."""

import json

import numpy as np
import pytest
import writers
import xarray as xr
from silent_case import HEAD, RAFT, load

import drift
from drift.engine.motion import simulate
from drift.pipeline.run_options import open_job
from drift.planning.search import follow
from geo import sphere

PAINTS = False
HOURS = 12
EVEN = (
    HEAD.replace("3 h", f"{HOURS} h")
    + 'seed = 7\ncoast.source = "none"\n[[current]]\nfiles = "even.nc"\n'
)
AT = (4.0, 59.0)
THERE = RAFT.replace('{ windage = "3 %" }', '"water"').replace(
    '"59 00N 004 00E", std = "1 nmi"', '[4.0, 59.0], std = "1 m"'
)
UNITS = """
[[unit]]
name = "plane"
kind = "Aircraft"
base = [4.5, 59.2]
search_speed = "120 kn"
endurance = "3 h"
sweep_width = "1 nmi"
[plan]
begin = "+0 h"
until = "+12 h"
particles = 20_000
"""
LOST = """
[spill]
objects = 20
worlds = 400
per_world = 50
windage_bias = 0
release_std = "1 m"
position = { at = [4.0, 59.0], std = "1 m" }
class = [{ name = "drum", object = "water" }]
"""
SEEN = """
[[find]]
at = [4.0, 59.0]
time = "+12 h"
at_sea = true
radius = "2 m"
class = "drum"
"""


def spread(time: float, std: float, fold: float) -> float:
    """Return the variance [m2] after a time [s] of a way whose speed is an Ornstein-Uhlenbeck
    process (Taylor 1922).
    """
    t = time / fold
    return 2 * (std * fold) ** 2 * (t - 1 + np.exp(-t))


JOBS = {
    "run": "particles = 20_000\n" + EVEN + THERE,
    "plan": "particles = 500\n" + EVEN + THERE + UNITS,
    "spill": EVEN.replace("none", "isle.geojson") + LOST,
    "origin": EVEN.replace("none", "isle.geojson") + LOST + SEEN,
}


@pytest.mark.parametrize(
    "job", ["run", "plan", "spill", pytest.param("origin", marks=pytest.mark.thorough)]
)
def test_the_default_errors_reach_what_drifts(tmp_path, monkeypatch, job) -> None:
    """A case that is silent, in an even current read from a file: its particles spread by the law
    of docs/errors.md.

    The first 12 h; each particle of a search has a bias of its own, those of a spill's world share
    one, forward and back. North is a straight line on the sphere; a step of half an hour errs by
    (0.5 / 11)^2 / 12 of the variance, which is nothing beside chance.
    """
    times = np.datetime64("2024-03-05", "ns") + np.arange(0, HOURS + 1, 3) * np.timedelta64(1, "h")
    lon, lat = np.arange(1.0, 7.0, 0.25), np.arange(57.5, 60.6, 0.25)
    shape = (len(times), len(lat), len(lon))
    dims = ("time", "lat", "lon")
    values = {
        "uo": (dims, np.full(shape, 0.21), writers.EAST),
        "vo": (dims, np.full(shape, -0.13), writers.NORTH),
    }
    xr.Dataset(values, {"time": times, "lat": lat, "lon": lon}).to_netcdf(tmp_path / "even.nc")
    # a spill must have a coast: far away
    ring = [[6.0, 60.2], [6.1, 60.2], [6.1, 60.3], [6.0, 60.2]]
    (tmp_path / "isle.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    seen: list[tuple[int, np.ndarray, np.ndarray]] = []
    whole = simulate.run

    def watched(ensemble, *args, **more):
        for moment in whole(ensemble, *args, **more):
            seen.append(
                (abs(moment.elapsed), np.array(moment.lat) * sphere.UNIT, ensemble.world.to_numpy())
            )
            yield moment

    monkeypatch.setattr(simulate, "run", watched)
    case = load(tmp_path, JOBS[job])
    if job == "plan":
        follow.follow(case, open_job(case).where)
    else:
        {"run": drift.run, "spill": drift.run, "origin": drift.trace}[job](case)
    time, lat, world = seen[-1]
    assert time == HOURS * 3600
    way = (lat - np.radians(AT[1])) * sphere.RADIUS
    walk, lasting = spread(time, 0.31, 39_600.0), (0.08 * time) ** 2
    n = len(way)
    mean = way.mean() - (-0.13 * time) * (-1 if job == "origin" else 1)
    if job in ("run", "plan"):
        assert n == 20_000
        assert abs(mean) < 4.5 * np.sqrt((walk + lasting) / n)
        assert abs(way.var() / (walk + lasting) - 1) < 4.5 * np.sqrt(2 / n)
        return
    count = np.bincount(world)
    each = count[0]
    assert (count == each).all()
    means = np.bincount(world, way) / each
    within = np.bincount(world, (way - means[world]) ** 2).sum() / (n - len(count))
    between = lasting + walk / each
    assert abs(mean) < 4.5 * np.sqrt(between / len(count))
    assert abs(within / walk - 1) < 4.5 * np.sqrt(2 / (n - len(count)))
    assert abs(means.var(ddof=1) / between - 1) < 4.5 * np.sqrt(2 / (len(count) - 1))
