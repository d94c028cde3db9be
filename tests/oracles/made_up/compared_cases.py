"""A search that is compared with changed ones."""

from pathlib import Path

import small_case

import drift

SEARCH = (
    small_case.STEADY.replace('object = "PIW-1"', 'object = "PIW-1"\nweight = 0.7')
    + """
[[scenario]]
name = "raft"
weight = 0.3
object = "LIFE-RAFT-DB-11"
position = { at = "27 35N 087 56W", std = "2 nmi" }
[[sortie]]
name = "first"
start = "+2 h"
end = "+4 h"
sweep_width = "0.5 nmi"
speed = "60 kn"
area = { centre = "27 31N 087 55W", length = "6 nmi", width = "6 nmi", orientation = 90 }
[uncertainty]
current = { std = "0.1 m/s", time = "3 h" }
"""
)
HOURS = 6


def case_of(folder: Path, text: str, name: str = "trial", **changes: object) -> drift.Case:
    path = folder / f"{name}.toml"
    path.write_text(text)
    return drift.vary(
        drift.load(path), {key.replace("__", "."): value for key, value in changes.items()}
    )
