"""Finished runs, small and across the antimeridian, whose files are read by other programs."""

from pathlib import Path

import drift

CASE = """
title = "Raft <A & B> on the line"
start = "2026-06-01T20:00Z"
duration = "12 h"
particles = 4000
[output]
every = "4 h"
about = { creator_name = "MRCC <test>", license = "CC BY 4.0", naming_authority = "org.example" }
[clock]
step = "30 min"
[coast]
source = "none"
[[current]]
constant = { speed = "1.2 kn", toward = 70 }
[uncertainty]
diffusivity = "60 m2/s"
[[scenario]]
name = "last call"
object = "water"
position = { at = [179.9, -41.0], std = "2 nmi" }
[[scenario]]
name = "drift, of a raft"
object = "water"
weight = 0.5
position = { at = [179.98, -41.1], std = "1 nmi" }
[[sortie]]
name = "Orion <1>"
start = "+2 h"
speed = "160 kn"
sweep_width = "1 nmi"
pattern = { kind = "parallel", centre = [180.0, -41.0], length = "10 nmi", width = "8 nmi", orientation = 20, spacing = "2 nmi" }
[plan]
particles = 1000
[[unit]]
name = "plane"
kind = "Aircraft"
base = [179.2, -40.6]
search_speed = "120 kn"
endurance = "0.5 h"
daylight = false
sweep_width = "0.5 nmi"
[[unit]]
name = "boat"
kind = "Boat"
base = [-179.8, -41.2]
search_speed = "12 kn"
transit_speed = "20 kn"
endurance = "3 h"
daylight = false
sweep_width = "0.5 nmi"
"""  # fmt: skip


def plan(folder: Path) -> Path:
    """Return the folder of a plan, which holds the files of its forecast and of its search too."""
    (folder / "raft.toml").write_text(CASE, encoding="utf-8")
    drift.plan(drift.load(folder / "raft.toml"), folder / "raft-plan")
    return folder / "raft-plan"
