"""A plan among the skerries off Bergen: an aircraft, a helicopter, two boats, after two sorties, a
beacon, a flare, debris.

Prints the metres of the boats' ways that lie on land (must be 0), their lengths by sea and
straight, the share of the way that is near land, and what computing them cost. Made up but for the
coast. With a folder, all files of the plan are written there.

    python benchmarks/plan_skerries.py [FOLDER]
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import smallest

import drift
from drift.planning.search import planner
from drift.planning.search.boats import courses
from drift.planning.search.products import subareas
from geo.box import Box
from geo.coast import shore

CASE = """
title = "Skiff missing in the skerries north-west of Bergen (synthetic wind and current)"
start = "2026-06-16T00:00Z"
duration = "20 h"
particles = 40_000
max_lost = 1
seed = 3

[output]
every = "4 h"

[[current]]
constant = { speed = "0.35 kn", toward = 10 }

[[wind]]
constant = { speed = "9 kn", from = 95 }

[uncertainty]
current = { std = "0.15 m/s", time = "6 h" }
wind = { std = "1.5 m/s", time = "6 h" }
diffusivity = "10 m2/s"

[[scenario]]
name = "engine failure"
weight = 0.6
object = "SKIFF-1"
search_object = "Power Boat 20ft"
position = { at = "60 41.0N 004 46.0E", error = "2 nmi" }

[[scenario]]
name = "raft"
weight = 0.4
object = "LIFE-RAFT-NB-1"
search_object = "Raft 4 person"
position = { at = "60 37.0N 004 43.0E", error = "2 nmi" }

[[sortie]]
name = "Sea King, square"
unit = "Helicopter"
start = "2026-06-16T02:00Z"
end = "2026-06-16T03:30Z"
speed = "80 kn"
sweep_width = { visibility = "5 nmi", altitude = "300 ft", wind = "11 kn", seas = "3 ft" }
pattern = { kind = "square", datum = "60 40N 004 35E", spacing = "0.7 nmi", orientation = 20 }

[[sortie]]
name = "lifeboat, first"
unit = "Boat"
start = "2026-06-16T02:30Z"
speed = "16 kn"
sweep_width = { visibility = "5 nmi", altitude = "14 ft", wind = "11 kn", seas = "3 ft" }
waypoints = ["60 38N 004 30E", "60 46N 004 32E", "60 46N 004 36E", "60 38N 004 34E"]

[[contact]]
name = "beacon"
time = "2026-06-16T04:00Z"
belief = 0.5
position = { fixes = [["60 41.5N 004 44.0E", 0.65], ["60 52N 004 20E", 0.35]], error = "2.5 nmi" }

[[contact]]
name = "flare"
time = "2026-06-16T05:00Z"
belief = 0.7
bearing = { from = "60 36.0N 004 56.0E", bearing = 320, std = "6 deg", far = "14 nmi" }

[[contact]]
name = "fender"
time = "2026-06-16T06:00Z"
belief = 0.5
position = { at = "60 42.0N 004 46.0E", error = "1 nmi" }
of = { windage = "3 %", spread = "1 %" }

[plan]
begin = "2026-06-16T07:00Z"
until = "2026-06-16T16:00Z"
separation = "1 nmi"
particles = 20_000

[[unit]]
name = "P-3 Andoya"
kind = "Aircraft"
base = "60 17.6N 005 13.1E"
search_speed = "150 kn"
transit_speed = "200 kn"
endurance = "2.5 h"
altitude = "500 ft"
sweep_width = { visibility = "5 nmi", altitude = "500 ft", wind = "11 kn", seas = "3 ft" }
sweep_width_uncertainty = "30 %"

[[unit]]
name = "Sea King Floro"
kind = "Helicopter"
base = "61 35.0N 005 01.5E"
search_speed = "80 kn"
transit_speed = "110 kn"
endurance = "2 h"
altitude = "300 ft"
sweep_width = { visibility = "5 nmi", altitude = "300 ft", wind = "11 kn", seas = "3 ft" }
sweep_width_uncertainty = "30 %"

[[unit]]
name = "RS Bergen"
kind = "Boat"
base = "60 23.9N 005 18.7E"
search_speed = "16 kn"
transit_speed = "25 kn"
endurance = "6 h"
sweep_width = { visibility = "5 nmi", altitude = "14 ft", wind = "11 kn", seas = "3 ft" }
sweep_width_uncertainty = "30 %"

[[unit]]
name = "RS Fedje"
kind = "Boat"
base = "60 46.8N 004 43.0E"
search_speed = "14 kn"
transit_speed = "20 kn"
endurance = "5 h"
clear_of_land = "0.1 nmi"
sweep_width = { visibility = "5 nmi", altitude = "14 ft", wind = "11 kn", seas = "3 ft" }
sweep_width_uncertainty = "30 %"
"""


def main() -> None:
    """Plan, and check each boat's way."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?")
    parser.add_argument(
        "--particles", type=int, default=40_000, help="of the run; the plan takes half as many"
    )
    given = smallest.parse(parser, particles=2000)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "skerries.toml"
        top, *units = CASE.split("[[unit]]")
        path.write_text("[[unit]]".join([top, *units[:: 3 if smallest.ASKED else 1]]))
        case = drift.load(
            path, {"particles": f"{given.particles}", "plan.particles": f"{given.particles // 2}"}
        )
        made, result = planner.plan(case, given.folder, overwrite=True)
    land = shore.read_land("gshhg", Box(3.5, 59.5, 6.5, 61.5)).polygons
    print(f"POS {made.pos:.3f}; {'; '.join(made.said) or 'nothing to say of boats'}")
    for one in made.taskings:
        if not one.out:
            print(f"{one.unit.name:16} straight")
            continue
        legs = one.sortie.legs
        assert legs is not None
        ways = (one.out, tuple(zip(legs.lon, legs.lat, strict=True)), one.back)
        dry = sum(courses.on_land(land, *np.array(way).T) for way in ways)
        told = ", ".join(
            f"{name.lower()} {way / 1852:.1f} nmi ({straight / 1852:.1f} straight)"
            for name, way, straight in subareas.by_sea(one)
        )
        print(
            f"{one.unit.name:16} {dry:.1f} m on land; {told}; legs cut: {list(one.cut)}, {subareas.round_length(one) / 1852:.1f} nmi round"
        )
    seconds = result.summary["wall_time_s"]
    print(
        f"ways {seconds['ways']:.1f} s, plan {seconds['plan']:.1f} s, of {sum(seconds.values()):.1f} s"
    )


if __name__ == "__main__":
    main()
