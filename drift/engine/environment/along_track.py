"""Winds and currents along the track of something that drifts, sampled as for particles."""

from collections.abc import Sequence

import numpy as np

from drift.engine.motion.forcing import Forcing
from geo.array import Array

PIECE = 3600.0  # [s] longest piece of a track for one quadrature
# distance of the two quadrature points from the middle of a piece of length 1
GAUSS = 0.5 / np.sqrt(3.0)


def quadrature_points(time: Array) -> tuple[Array, Array, Array]:
    """Return (times, weights, fixes) of the points at which velocities between fixes are sampled.

    Two-point Gauss quadrature in pieces of an hour at most. Times are rounded to seconds [s since
    1970], weights are in [s]. Fixes are the numbers of the fixes at which the displacements end.

    Args:
        time: of the fixes [s since 1970], ascending, (n,).
    """
    steps = np.diff(time)
    count = np.maximum(np.ceil(steps / PIECE).astype(int), 1)
    owner = np.repeat(np.arange(1, time.size), count)
    number = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
    length = np.repeat(steps / count, count)
    middle = time[owner - 1] + (number + 0.5) * length
    points = np.stack([middle - GAUSS * length, middle + GAUSS * length], axis=1).ravel()
    return np.rint(points), np.repeat(length / 2, 2), np.repeat(owner, 2)


def sample_forcing(
    forcing: Forcing,
    scenario: int,
    quantities: Sequence[str],
    time: Array,
    lon: Array,
    lat: Array,
    member: int = 0,
) -> dict[str, Array]:
    """Return velocities east and north [m/s] at places and times, (points, 2), by quantity.

    They are NaN where the forcing has no value. Priorities, sums and filled coasts are those of
    particles.

    Args:
        forcing: of a run.
        scenario: number of the scenario whose sources are used.
        quantities: wanted.
        time: [s since 1970], whole seconds, (points,).
        lon: [binary angle], int32 (points,).
        lat: [binary angle], int32 (points,).
        member: number of the forcing ensemble's member.
    """
    sampled = {quantity: np.full((time.size, 2), np.nan) for quantity in quantities}
    order = np.argsort(time, kind="stable")
    moments, begins = np.unique(time[order], return_index=True)
    ends = [*begins[1:], time.size]
    for moment, begin, end in zip(moments.astype(int), begins, ends, strict=True):
        at_moment = order[begin:end]
        own = np.full(at_moment.size, member, np.int32)
        # A source's first moment can only begin a step, and its last only end one, so try both.
        for second, fraction in ((moment, 0.0), (moment - 1, 1.0)):
            forcing.set(int(second), int(second) + 1)
            for quantity in quantities:
                tiles = forcing.ranges[scenario][quantity]
                sample = forcing.tiles.at(*tiles, lon[at_moment], lat[at_moment], fraction, own)
                new = np.isnan(sampled[quantity][at_moment, 0]) & (sample[:, 2] > 0)
                sampled[quantity][at_moment[new]] = sample[new, :2]
            if all(np.isfinite(sampled[quantity][at_moment]).all() for quantity in quantities):
                break
    return sampled
