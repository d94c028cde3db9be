"""Cases for the particle filter, still and in a current, and the weights and offsets of its
particles.
"""

import dataclasses
import math

import numpy as np

from drift.case import file as case_file
from drift.engine.motion import simulate
from drift.evidence.filter.filter import SearchFilter
from drift.evidence.filter.records import (
    Sortie,
)
from drift.pipeline import run_setup
from geo import sphere
from geo.polyline import Legs
from kernels.runtime import runtime

NMI = 1852.0
METRES = sphere.RADIUS * np.pi / 180  # [m] per degree of latitude
STILL = """
start = "2026-11-21T00:00Z"
duration = "6 h"
particles = 1000
[clock]
step = "30 min"
[coast]
source = "none"
[[current]]
constant = { speed = "0 kn", toward = 0 }
"""
BOX = """
[[scenario]]
name = "box"
object = "water"
[scenario.area]
polygon = [[179.84, -0.2], [-179.84, -0.2], [-179.84, 0.2], [179.84, 0.2]]
"""
NORMAL = """
[uncertainty]
diffusivity = "{d} m2/s"
[[scenario]]
name = "normal"
object = "water"
[scenario.position]
at = [-179.99, 30.0]
std = ["4000 m", "2500 m"]
orientation = 30
"""


def load(tmp_path, text, **changes):
    """Return a case of a text, with fields replaced."""
    path = tmp_path / "case.toml"
    path.write_text(text)
    return dataclasses.replace(case_file.load(path), **changes)


def filter_of(case, begin):
    """Return a case's filter, also of a case in which nothing was searched or seen."""
    spec = run_setup.ensemble_spec(case)
    return SearchFilter(
        spec,
        case.sorties,
        case.contacts,
        case.resampling,
        begin.ensemble,
        begin.scene,
        case.sensors,
    )


def run(case, outputs=()):
    """Run a case's filter and return it, its ensemble at the end, and the moments at output times
    [s].
    """
    runtime.start()
    where = run_setup.open_for(case)
    begin = run_setup.prepare(case, where)
    search = filter_of(case, begin)
    moments = list(
        simulate.run(begin.ensemble, begin.scene, begin.clock, np.array(outputs), search=search)
    )
    begin.scene.forcing.close()
    return search, begin.ensemble, moments


def hours(h):
    """Return a time after the cases' start."""
    return np.datetime64("2026-11-21T00:00:00") + np.timedelta64(round(3600 * h), "s")


def seconds(h):
    """Return it in seconds since 1970."""
    return float(hours(h).astype("datetime64[s]").astype(np.int64))


def weights(ensemble):
    """Return normalised weights."""
    w = np.exp(ensemble.log_weight.to_numpy().astype(np.float64))
    return w / w.sum()


def offsets(ensemble, lon, lat):
    """Return particles' places [m] east and north of a position [deg]."""
    x, y = (column.to_numpy() * sphere.UNIT for column in (ensemble.lon, ensemble.lat))
    return sphere.offset(math.radians(lon), math.radians(lat), x, y)


# Detection along legs: what a moving field and its sorties give, by brute force in fine steps.

FLOW = """
start = "2026-11-21T00:00Z"
duration = "3 h"
particles = 400
[clock]
step = "30 min"
[coast]
source = "none"
[[current]]
constant = { speed = "2 kn", toward = 60 }
[[scenario]]
name = "field"
object = "water"
[scenario.area]
polygon = [[179.9, 59.95], [-179.9, 59.95], [-179.9, 60.05], [179.9, 60.05]]
time = "+0 h"
until = "+1 h"
"""


def legs(points, begin, speed):
    """Return legs through points [m] east and north of 60 N 180 E, at a speed [m/s]."""
    lon, lat = sphere.destination(math.pi, math.radians(60), *np.array(points, float).T)
    lon = np.degrees(np.unwrap(lon))
    time = [seconds(begin)]
    for k in range(len(points) - 1):
        time.append(
            time[-1]
            + float(
                sphere.distance(
                    *np.radians(
                        [lon[k], lat[k] * 180 / np.pi, lon[k + 1], lat[k + 1] * 180 / np.pi]
                    )
                )
            )
            / speed
        )
    return Legs(
        tuple(time),
        tuple(lon.tolist()),
        tuple(np.degrees(lat).tolist()),
        (True,) * (len(points) - 1),
    )


def flown(name, track, law, width):
    """Return the sortie of a track."""
    begin, end = (np.datetime64(round(t), "s") for t in (track.time[0], math.ceil(track.time[-1])))
    return Sortie(name, "", begin, end, law, (width,), legs=track)


SQUARE = """
[[scenario]]
name = "square"
object = "water"
[scenario.area]
polygon = [[179.9, 59.95], [-179.9, 59.95], [-179.9, 60.05], [179.9, 60.05]]
"""
