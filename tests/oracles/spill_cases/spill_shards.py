"""A spill with finds, of few worlds, in several shards."""

from pathlib import Path

import numpy as np
import shards as runs
import spills

import drift

BLOCKS = 5  # of 150 worlds
CASE = """
title = "Straight coast"
start = "2026-11-21T00:00Z"
duration = "40 h"
seed = 5
output = {{ every = "20 h", trajectories = 40 }}
clock.step = "auto"
max_lost = 0.5
domain = {{ west = -0.8, south = -0.8, east = 0.5, north = 0.8 }}
coast = {{ source = "land.geojson", behaviour = {behaviour} }}
[[current]]
{current}
[[wind]]
constant = {{ speed = "5 m/s", from = 250 }}
[uncertainty]
current = {{ std = "0.1 m/s", time = "12 h" }}
wind = {{ std = "1 m/s", time = "12 h" }}
diffusivity = "50 m2/s"
[spill]
objects = [40, 43]
worlds = 150
per_world = 70
redraws = {redraws}
{release}
release_std = "1 km"
destroyed = 0.1
windage_bias = 0.2
current_bias = "0.05 m/s"
stretches.length = "10 km"
[spill.reporting]
bias = 0.3
[[spill.class]]
name = "drum"
share = 0.6
object = {{ immersion = [0.6, 0.9] }}
sinking = {{ waterlogged = ["1 d", "6 d"], spread = 2 }}
[[spill.class]]
name = "box"
share = 0.36
object = {{ immersion = [0.3, 0.7] }}
sinking = {{ half_life = "2 d" }}
[[spill.class]]
name = "buoy"
object = "water"
{more}
"""
POSITION = """position = { at = [-0.15, 0.03], std = "6 km", until = "+3 h" }
release_duration = "2 h\""""
TRACK = """clock_error = "9 min"
track = [{ at = [-0.2, -0.14], time = "+0 h" }, { at = [-0.15, 0.05], time = "+3 h" }, { at = [-0.11, 0.2], time = "+7 h" }]
loss = [{ begin = ["+30 min", "+3 h"], length = ["20 min", "2 h"], share = 0.7 }, { begin = "+4 h", length = "1 h", share = 0.3 }]"""
REFLOAT = '"refloat", half_life = "6 h"'
CURRENT = 'constant = { speed = "0.25 m/s", toward = 85 }'
MEMBERS = """members = [{ constant = { speed = "0.2 m/s", toward = 80 } }, { constant = { speed = "0.3 m/s", toward = 95 } },
 { constant = { speed = "0.25 m/s", toward = 60 } }]"""
FINDS = """
[[find]]
name = "a drum"
at = [0.0, 0.12]
time = "+20 h"
class = "drum"
[[find]]
name = "adrift"
at = [-0.06, 0.06]
radius = "3 km"
at_sea = true
time = "+13 h"
false = 0.2
[[find]]
name = "another"
at = [0.0, 0.2]
by_time = "+30 h"
[[patrol]]
name = "walkers"
between = [[0.0, 0.3], [0.0, -0.1]]
time = "+26 h"
detection = 0.5
[[patrol_unit]]
name = "horse"
length = "30 km"
detection = 0.8
first = "+38 h"
"""


def case_of(folder: Path, more: str = FINDS, **changes: object) -> drift.Case:
    folder.mkdir(exist_ok=True)
    values = {"behaviour": REFLOAT, "current": CURRENT, "redraws": 1, "release": POSITION}
    values |= changes
    (folder / "land.geojson").write_text(spills.SHORE)
    (folder / "case.toml").write_text(CASE.format(more=more, **values))
    return drift.load(folder / "case.toml")


def same(one: drift.Result, other: drift.Result) -> None:
    """Hold two results of a spill against each other, down to each world."""
    runs.same(one, other)
    a, b = one.aftermath, other.aftermath
    assert a is not None
    assert b is not None
    assert a.washup.identical(b.washup)
    assert a.worlds.digest == b.worlds.digest
    assert a.rounds == b.rounds
    for name, values in vars(a.posterior).items():
        if isinstance(values, np.ndarray):
            assert np.array_equal(values, getattr(b.posterior, name)), name
