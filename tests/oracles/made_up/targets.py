"""Targets that steer, moved by the kernel alone, and what NumPy makes of the same itineraries."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.engine.motion.period import Period
from drift.engine.motion.steering import itinerary_tables
from drift.engine.motion.steering.itinerary import Itinerary
from drift.engine.particles.status import Status
from geo import sphere
from geo.array import Array
from kernels.runtime import batch, rows, runtime
from kernels.steering import steer
from kernels.step.advance import Domain, Step

WORLD = Domain(-(2**31), -(2**30), 2**32 - 1, 2**31)
PERIOD = Period(np.datetime64("2026-03-05T00:00:00"), np.datetime64("2026-03-15T00:00:00"), 1)
KNOT, NMI = 1852 / 3600, 1852.0
HOUR = 3600


class Fleet:
    """Targets of one itinerary; `lon`, `lat` [deg] and other columns as NumPy arrays."""

    def __init__(
        self, itinerary: Itinerary, n: int, seed: int = 5, at: Any = (0.0, 0.0), begin: Any = 0
    ) -> None:
        """Draw them; at: (lon, lat) [deg] and begin [s], where the first phase has no way point to
        begin at.
        """
        self.n, self.seed = n, seed
        self.columns = {
            **{name: runtime.upload(np.zeros(n, np.int32)) for name in steer.CORE},
            **rows.stack(steer.WHOLE, np.zeros((len(steer.WHOLE), n), np.int32)),
            **rows.stack(steer.REAL, np.zeros((len(steer.REAL), n), np.float32)),
        }
        first: dict[str, npt.ArrayLike] = {
            "lon": sphere.to_binary(at[0]), "lat": sphere.to_binary(at[1]),
            "release": begin, "status": int(Status.PENDING), "edge": -1,
        }  # fmt: skip
        for name, value in first.items():
            self.columns[name].from_numpy(np.broadcast_to(np.asarray(value, np.int32), n).copy())
        self.plan = itinerary_tables.plan([itinerary], PERIOD)
        self.slots = batch.batch_of((0, n), (0,), (0,))
        tries = runtime.upload(np.zeros(2, np.int64))
        steer.born(self.columns, self.slots, self.plan, seed, WORLD, None, tries)
        self._move = steer.mover(self.columns, self.slots, self.plan, seed, WORLD, None)

    def go(self, until: float, step: int, since: float = 0) -> "Fleet":
        """Move all in steps [s] from a time to a time [s]."""
        for k in range(int(since) // step, int(until) // step):
            self._move(Step(k, k * step, step, 1))
        return self

    def within(
        self, step: Step, times: Sequence[int], chained: bool = False
    ) -> list[tuple[Array, Array]]:
        """Make a step; return positions (lon, lat) [deg] at times [s] inside it.

        They are asked of the step's begin, or, chained, each of the one before.
        """
        before = rows.rebuilt(self.columns, lambda _, array: runtime.copy(array))
        self._move(step)
        places = []
        at, since = (before["lon"], before["lat"]), step.elapsed
        for time in times:
            if not chained:
                at, since = (before["lon"], before["lat"]), step.elapsed
            at = runtime.copy(at[0]), runtime.copy(at[1])
            steer.inside(
                before, self.slots, self.plan, self.seed, WORLD, None, step, at, since, time, time
            )
            since = time
            places.append(tuple(sphere.to_degrees(x.to_numpy()) for x in at))
        return places

    def __getitem__(self, name: str) -> Array:
        values = self.columns[name].to_numpy()
        return sphere.to_degrees(values) if name in ("lon", "lat", "to_lon", "to_lat") else values


def triangle(
    rng: np.random.Generator, low: float, mode: float, high: float, ratio: float, n: int
) -> Array:
    """Draw from a truncated triangle: by rejection under its density, which is straight from the
    ends to the mode.
    """
    drawn = np.empty(0)
    while drawn.size < n:
        x, y = rng.uniform(low, high, 2 * n), rng.uniform(0, ratio, 2 * n)
        side = np.where(
            x < mode, (x - low) / max(mode - low, 1e-12), (high - x) / max(high - mode, 1e-12)
        )
        drawn = np.append(drawn, x[y < 1 + (ratio - 1) * side])
    return drawn[:n]
