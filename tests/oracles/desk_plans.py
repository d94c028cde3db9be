"""A written plan of two units for the tests of the desk, and its POS by brute force."""

import json
from pathlib import Path
from typing import Any

import desks
import numpy as np
import plans

import drift
from drift.case import file as case_file
from drift.pipeline import flow
from drift.planning.search.products import files as plan_files
from drift.products.files import formats
from geo import sphere
from geo.array import Array

NMI, STEP = 1852.0, 4.0  # [m], [s] of the integral
METRES = sphere.RADIUS * np.pi / 180  # of a degree of latitude
PARTICLES = 2000
RUN = "overdue-plan"
CASE = f"""
title = "overdue"
start = "2026-11-21T06:00Z"
duration = "20 h"
particles = {PARTICLES}
[output]
every = "4 h"
[clock]
step = "30 min"
[coast]
source = "none"
[[current]]
constant = {{ speed = "0.6 kn", toward = 70 }}
[uncertainty]
diffusivity = "2 m2/s"
[[scenario]]
name = "raft"
object = "water"
position = {{ at = "41 12S 179 50E", error = "2 nmi" }}
[[unit]]
name = "cutter"
base = "41 30S 179 30E"
search_speed = "14 kn"
endurance = "4 h"
sweep_width = "0.7 nmi"
[[unit]]
name = "aircraft"
base = "41 00S 179 10E"
search_speed = "110 kn"
endurance = "2 h"
sweep_width = "0.5 nmi"
daylight = false
[plan]
begin = "+13 h"
until = "+20 h"
particles = 2000
"""


def write_plan(folder: Path) -> None:
    """Lay the plan of the case into a folder, after few trials: those of its files that are read."""
    with plans.after_few_trials():
        made, _ = drift.plan(plans.loaded(folder, CASE))
    desks.finished(
        folder / RUN,
        plan_json=json.dumps(formats.plain(plan_files.plan_as_json(made))),
        plan_toml=plan_files.toml(made),
        plan_geojson=json.dumps({"case": CASE}),
    )


def positions(folder: Path) -> tuple[Array, Array, Array]:
    """Return times [s since 1970] and positions [deg] (particles, times), every ten minutes."""
    more = f'every = "10 min"\ntrajectories = {PARTICLES}'
    case = case_file.load_text(folder / "case.toml", CASE.replace('every = "4 h"', more))
    found = flow.run(case).trajectories
    times = found.time.astype("datetime64[s]").astype(np.float64)
    return times, *(sphere.to_degrees(one) for one in (found.lon, found.lat))


def missed(area: dict[str, Any], width: float, times: Array, lon: Array, lat: Array) -> Array:
    """Return the probability that the legs of a sub-area miss each particle.

    The hazard of the inverse cube law, W^2 / (4 pi) v / (2 r^3), is integrated in small steps in
    float64, in a plane about the sub-area: within 40 nmi of it lengths are 0.01 % off.

    Args:
        area: as the page gets it: its legs [deg], start and end.
        width: sweep width [m].
        times: of the positions [s since 1970].
        lon: of the particles [deg], (particles, times).
        lat: of them [deg].
    """
    (line,) = area["legs"]
    middle, level = np.array(area["centre"])

    def flat(x: Array, y: Array) -> Array:
        east = (x - middle + 180) % 360 - 180
        return np.stack([east * METRES * np.cos(np.radians(level)), (y - level) * METRES], axis=-1)

    nodes = flat(*np.array(line["points"]).T)
    begin, end = (
        float(np.datetime64(area[key].rstrip("Z"), "s").astype(np.int64))
        for key in ("start", "end")
    )
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(nodes, axis=0).T))])
    clock = np.arange(begin, end, STEP) + STEP / 2
    way = (clock - begin) / (end - begin) * along[-1]
    unit = np.stack([np.interp(way, along, nodes[:, k]) for k in (0, 1)], axis=-1)
    hazard = []
    for one in flat(lon, lat):
        away = unit - np.stack([np.interp(clock, times, one[:, k]) for k in (0, 1)], axis=-1)
        pace = np.hypot(*np.gradient(away, STEP, axis=0).T)
        hazard.append(np.sum(pace * STEP / (2 * np.hypot(*away.T) ** 3)))
    return np.exp(-(width**2) / (4 * np.pi) * np.array(hazard))
