"""Likelihood of a spread rate by neighbours: every second fix against the bridge about it.

Horne, Garton, Krone and Lewis 2007, doi:10.1890/06-0957.1: of fixes 1, 2, 3, .. the second is
compared with the bridge from the first to the third, the fourth with that from the third to the
fifth, and so on. So no fix serves both as an inner fix and as an end. Given the way points,
deviations in different legs are independent. Errors of the fixes enter through both ends, as in the
paper, and through the inner fix, which the paper omits. Neighbouring triples share an end and its
error; that correlation is neglected, as in the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges.stretches import Stretch
from geo import sphere
from geo.array import Array


@dataclass(frozen=True)
class Triples:
    """Inner fixes compared with their neighbours' bridges.

    name: index of each one's track, (m,). time: of the inner fix [s since 1970], (m,). away:
    deviation of the inner fix from the bridge's mean [m], along the leg and to its left, (m, 2).
    unit: its variance for a spread rate of 1 [s], (m, 2). error: its variance for an error of 1 m
    in each component of each fix, (m, 2).
    """

    name: Array
    time: Array
    away: Array
    unit: Array
    error: Array


def triples(stretches: Sequence[Stretch]) -> Triples:
    """Return every second inner fix of the stretches with its neighbours.

    The result is empty if no stretch has three fixes.
    """
    names = {
        name: number
        for number, name in enumerate(dict.fromkeys(stretch.name for stretch in stretches))
    }
    index = [np.arange(1, stretch.time.size - 1, 2) for stretch in stretches]
    number = np.concatenate(
        [
            np.full(inner.size, names[stretch.name])
            for stretch, inner in zip(stretches, index, strict=True)
        ]
    )

    def fixes(shift: int) -> tuple[Array, Array, Array]:
        """Return time, lon and lat of all inner fixes shifted by some fixes."""
        columns = [
            (stretch.time[inner + shift], stretch.lon[inner + shift], stretch.lat[inner + shift])
            for stretch, inner in zip(stretches, index, strict=True)
        ]
        time, lon, lat = (np.concatenate(parts) for parts in zip(*columns, strict=True))
        return time, lon, lat

    (t0, x0, y0), (t, x, y), (t1, x1, y1) = fixes(-1), fixes(0), fixes(1)
    share = (t - t0) / (t1 - t0)
    east, north = sphere.offset(x0, y0, x1, y1)
    angle = np.hypot(east, north) / sphere.RADIUS
    mean = sphere.destination(x0, y0, east * share, north * share)
    ahead = np.stack(sphere.offset(*mean, x1, y1), -1)
    turn = bridges.turned(ahead)
    away = np.einsum("mai,mi->ma", turn, np.stack(sphere.offset(*mean, x, y), -1))
    unit = (t1 - t0)[:, None] * bridges.strayed(share, share, angle)
    across = bridges.across(1 - share, angle) ** 2 + bridges.across(share, angle) ** 2
    error = 1 + np.stack([(1 - share) ** 2 + share**2, across], -1)
    return Triples(number, t, away, unit, error)


def log_likelihood(of: Triples, spread_rate: float, error: float) -> Array:
    """Return the log likelihood by track, shape (tracks,).

    Args:
        of: inner fixes with their neighbours.
        spread_rate: K [m/sqrt(s)].
        error: standard deviation of a fix in each component [m]. One of the two must be above 0.
    """
    variance = spread_rate**2 * of.unit + error**2 * of.error
    each = -0.5 * (np.log(2 * np.pi * variance) + of.away**2 / variance).sum(-1)
    return np.bincount(of.name, each, minlength=int(of.name.max(initial=-1)) + 1)
