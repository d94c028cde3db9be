"""Spills for tests: fates made by hand, a whole case on a straight coast, and an independent
sampler of its closed form.
"""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats

import drift
from drift.spills.worlds.fates import FOREVER, Adrift, Fates, Stays
from geo import sphere

DAY = 86_400
METRE = 1 / np.radians(1) / sphere.RADIUS  # [deg] on the equator
CASE = """
title = "Straight coast"
start = "2026-11-21T00:00Z"
duration = "{duration}"
seed = {seed}
output.every = "12 h"
clock.step = "30 min"
domain = {{ west = -1.2, south = -1.2, east = 0.8, north = 1.2 }}
coast = {{ source = "land.geojson" }}
[[current]]
constant = {{ speed = "0.25 m/s", toward = 90 }}
[uncertainty]
diffusivity = "50 m2/s"
[spill]
objects = {objects}
worlds = {worlds}
per_world = {per_world}
position = {{ at = [-0.25, 0.03], std = "4 km" }}
destroyed = [0, 0.2]
current_bias = "0.04 m/s"
stretches.length = "10 km"
{more}
[[spill.class]]
name = "drum"
object = "water"
sinking = {{ half_life = "2 d" }}
"""
SHORE = """{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon",
"coordinates": [[[0, -2], [2, -2], [2, 2], [0, 2], [0, -2]]]}}]}"""


def case_of(folder: Path, more: str = "", **changes: object) -> drift.Case:
    values = {
        "duration": "3 d",
        "objects": 60,
        "worlds": 1500,
        "per_world": 60,
        "seed": 3,
        **changes,
    }
    (folder / "land.geojson").write_text(SHORE)
    (folder / "case.toml").write_text(CASE.format(more=more, **values))
    return drift.load(folder / "case.toml")


def sampled(worlds: int, objects: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return (arrival [s], inf: never; place north [m]) of every object of simulated spills,
    (worlds, objects).

    Brownian motion with drift u from a distance a meets the line after an inverse Gaussian time;
    meanwhile it moves north with the drift and spreads as 2 D T; it has sunk before with
    probability 1 - 2^(-T / 2 d).
    """
    u = 0.25 + 0.04 * rng.standard_normal((worlds, 1))
    v = 0.04 * rng.standard_normal((worlds, 1))
    away = 0.25 / METRE + 4000 * rng.standard_normal((worlds, 1))
    north = 0.03 / METRE + 4000 * rng.standard_normal((worlds, 1))
    mean, shape = away / u, away**2 / (2 * 50.0)
    time = stats.invgauss.rvs(mean / shape, scale=shape, size=(worlds, objects), random_state=rng)
    place = north + v * time + np.sqrt(2 * 50.0 * time) * rng.standard_normal((worlds, objects))
    sunk = rng.exponential(2 * DAY / np.log(2), (worlds, objects)) < time
    lost = rng.random((worlds, objects)) < rng.uniform(0, 0.2, (worlds, 1))
    return np.where(sunk | lost, np.inf, time), place


def spill(worlds: int, n: list[int], stays: list[tuple[int, int, int, int]]) -> Fates:
    """Return fates of classes of n[c] particles a world; stays: (slot, segment, arrival, leave), in
    any order.
    """
    rows = (
        np.array(sorted(stays, key=lambda s: (s[0], s[2])), np.int64)
        .reshape(-1, 4)
        .T.astype(np.int32)
    )
    kind = np.repeat(np.arange(len(n)), [worlds * k for k in n]).astype(np.int32)
    world = np.concatenate([np.repeat(np.arange(worlds), k) for k in n]).astype(np.int32)
    nothing = np.full(kind.size, FOREVER, np.int32)
    return Fates(
        worlds,
        world,
        kind,
        np.zeros(kind.size, np.int32),
        nothing,
        np.zeros(kind.size, np.int32),
        Stays(*rows),
    )


def scattered(worlds: int, n: list[int], seed: int = 3) -> Fates:
    """Return worlds whose particles lie on three stretches, some twice, in shares that differ
    between worlds.
    """
    rng = np.random.default_rng(seed)
    stays = []
    for slot in range(worlds * sum(n)):
        segment = int(rng.integers(0, 4))  # 3: never ashore
        if segment < 3:
            arrival = int(rng.integers(0, 6 * DAY))
            again = rng.random() < 0.3
            leave = arrival + int(rng.integers(1, 3 * DAY)) if again else FOREVER
            stays.append((slot, segment, arrival, leave))
            if again:
                stays.append((slot, int(rng.integers(0, 3)), leave + 7200, FOREVER))
    return spill(worlds, n, stays)


class Cut:
    """Fates in parts, from one number of a world to the next: a drift.spills.worlds.fates.FatesSource."""

    def __init__(self, fates: Fates, *edges: int) -> None:
        self._fates, self._edges = fates, edges
        self.worlds, self.counts = fates.worlds, fates.counts

    def parts(self) -> Iterator[Fates]:
        for first, last in itertools.pairwise(self._edges):
            whole, stays = self._fates, self._fates.stays
            slots = np.flatnonzero((whole.world >= first) & (whole.world < last))
            row = np.isin(stays.slot, slots)
            yield replace(
                whole,
                **{
                    name: getattr(whole, name)[slots]
                    for name in ("world", "kind", "release", "ended", "ending")
                },
                stays=Stays(
                    np.searchsorted(slots, stays.slot[row]).astype(np.int32),
                    *(getattr(stays, name)[row] for name in ("segment", "arrival", "leave")),
                ),
                adrift={
                    k: Adrift(at.lon[slots], at.lat[slots], at.status[slots])
                    for k, at in whole.adrift.items()
                },
                some=(first, last),
            )
