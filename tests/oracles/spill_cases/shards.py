"""A small case whose particles are of nine blocks, of four where it is searched, and the comparison
of two runs of it.
"""

import json
from pathlib import Path

import numpy as np

import drift

SHORE = """{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon",
"coordinates": [[[0, -2], [2, -2], [2, 2], [0, 2], [0, -2]]]}}]}"""
CASE = """
start = "2026-11-21T00:10Z"
duration = "5 h"
particles = 30000
seed = 77
output = { every = "150 min", trajectories = 50 }
clock.step = "auto"
domain = { west = -0.6, south = -0.6, east = 0.5, north = 0.6 }
coast = { source = "land.geojson", behaviour = "refloat", half_life = "1 h" }
[[current]]
constant = { speed = "0.6 m/s", toward = 70 }
[[wind]]
constant = { speed = "9 m/s", from = 250 }
[uncertainty]
current = { std = "0.2 m/s", time = "5 h", bias = "0.1 m/s" }
wind = { std = "2 m/s", time = "5 h" }
diffusivity = "40 m2/s"
[[scenario]]
name = "report"
weight = 0.5
object = "LIFE-RAFT-DB-10"
position = { at = [-0.02, 0.05], error = "4 km", time = "+10 min", until = "+2 h" }
[[scenario]]
name = "ground"
weight = 0.2
object = "PIW-1"
area = { polygon = [[-0.1, -0.1], [0.03, -0.08], [0.02, 0.1], [-0.09, 0.11]], time = "+0 h", until = "+1 h" }
[[scenario]]
name = "passage"
weight = 0.3
object = "SAILBOAT-2"
trackline = { waypoints = [[-0.3, -0.2], [-0.05, 0.2]], speed = "10 kn", cross_track = "2 km" }
"""


MEMBERS = """members = [{ constant = { speed = "0.4 m/s", toward = 60 } }, { constant = { speed = "0.6 m/s", toward = 70 } },
 { constant = { speed = "0.7 m/s", toward = 100 } }]"""

SEARCHED = """
[[sortie]]
name = "area"
start = "+70 min"
end = "+130 min"
law = "random"
pod = 0.6
area = { polygon = [[-0.1, 0.0], [0.05, 0.02], [0.06, 0.12], [-0.08, 0.1]] }
[[sortie]]
name = "legs"
unit = "Helicopter"
start = "+100 min"
speed = "60 kn"
sweep_width = "900 m"
sweep_width_uncertainty = "30 %"
pattern = { kind = "parallel", centre = [0.0, 0.04], length = "12 km", width = "9 km", orientation = 30, spacing = "1500 m" }
frame = "datum"
[[sortie]]
name = "more legs"
unit = "Helicopter"
start = "+200 min"
speed = "60 kn"
sweep_width = "700 m"
sweep_width_uncertainty = "30 %"
pattern = { kind = "parallel", centre = [0.02, 0.06], length = "12 km", width = "9 km", orientation = 120, spacing = "1500 m" }
[[contact]]
name = "seen"
time = "+185 min"
belief = 0.7
position = { at = [0.03, 0.05], std = "3 km" }
[[contact]]
name = "debris"
time = "+140 min"
belief = 0.8
of = "PIW-4"
position = { at = [0.0, 0.05], std = "5 km" }
"""


def case(folder: Path, *, members: bool = False) -> drift.Case:
    """Return the case, written into a folder; members: with a current of three members, dealt out
    within blocks.
    """
    (folder / "land.geojson").write_text(SHORE)
    text = (
        CASE.replace('constant = { speed = "0.6 m/s", toward = 70 }', MEMBERS) if members else CASE
    )
    (folder / "case.toml").write_text(text)
    return drift.load(folder / "case.toml")


FEWER = CASE.replace("particles = 30000", "particles = 9000")  # of four blocks


def searched(folder: Path) -> drift.Case:
    """Return the case of fewer particles with sorties that found nothing, and contacts."""
    (folder / "land.geojson").write_text(SHORE)
    (folder / "case.toml").write_text(FEWER + SEARCHED)
    return drift.load(folder / "case.toml")


def same(one: drift.Result, other: drift.Result) -> None:
    """Hold two results against each other: maps, numbers, outlines, tracks, warnings."""
    assert one.forecast.data.identical(other.forecast.data)
    assert all(
        a.polygon.equals_exact(b.polygon)
        for a, b in zip(one.forecast.contours, other.forecast.contours, strict=True)
    )
    assert all(
        np.array_equal(a, b)
        for a, b in zip(
            vars(one.trajectories).values(), vars(other.trajectories).values(), strict=True
        )
    )
    summaries = [
        {key: value for key, value in result.summary.items() if key != "wall_time_s"}
        for result in (one, other)
    ]
    assert json.dumps(summaries[0], default=str) == json.dumps(summaries[1], default=str)
