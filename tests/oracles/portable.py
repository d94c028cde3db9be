"""Some of all that the program does, small, on the backend that is named: what comes of it is
written as arrays.

    python portable.py BACKEND FILE.npz

A process keeps the backend that it started with, so `test_gpu` starts one for each.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import drift
from drift.forecast import build

SMALL = Path(__file__).parents[2] / "docs" / "generate"
SEARCH = {
    "particles": "4000",
    "duration": "'30 h'",
    "output.every": "'10 h'",
    "plan": "{}",
    "unit": "[]",
}
RUNS: dict[str, tuple[str, dict[str, str], dict[str, Any]]] = {
    "search": ("overdue_boat", SEARCH, {}),
    "search again": ("overdue_boat", SEARCH, {}),
    "search in shards": ("overdue_boat", SEARCH, {"shards": 3}),
    "steered": ("medsearch_transit", {"particles": "4000"}, {}),
    "heard": ("convergence_zones", {"particles": "2000"}, {}),
    "members": (str(SMALL / "small.toml"), {}, {}),
    "spill": (str(SMALL / "small_spill.toml"), {"find": "[]"}, {}),
}


def figures(summary: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield what is told of evidence, weights and what became of all, by name."""
    parts = {name: summary.get(name) for name in ("search", "account", "scenario_weights")}
    stack: list[tuple[str, Any]] = list(parts.items())
    while stack:
        path, value = stack.pop()
        if isinstance(value, dict):
            stack += [(f"{path}.{key}", each) for key, each in value.items()]
        elif isinstance(value, list):
            stack += [(f"{path}.{k}", each) for k, each in enumerate(value)]
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield path, float(value)


def main(backend: str, file: str) -> None:
    """Run all, and write arrays by the name of what was run and of what they are."""
    build.ACROSS, build.ACROSS_ONE = 120, 240  # small maps, in a tenth of the time
    kept: dict[str, np.ndarray] = {}
    for name, (case, changes, options) in RUNS.items():
        result = drift.run(drift.load(case, changes), backend=backend, **options)
        tracks = result.particles
        kept |= {f"{name}/{column}": tracks[column].values for column in ("lon", "lat", "status")}
        kept[f"{name}/areas"] = result.tables["track"].filter(like="area").to_numpy(float)
        kept[f"{name}/figures"] = np.array(json.dumps(dict(figures(result.summary))))
    track = drift.track("lost_contact", changes={"particles": "600"}, backend=backend)
    kept["track/place"] = track.held.place
    proposed, _result = drift.plan(
        drift.load("overdue_boat", {"particles": "1500", "plan.particles": "1000"}), backend=backend
    )
    kept["plan/pos"] = np.array([proposed.pos, proposed.seen, len(proposed.taskings)])
    np.savez(file, **kept)


if __name__ == "__main__":
    main(*sys.argv[1:])
