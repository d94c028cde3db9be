"""The likelihood of a spread rate by neighbours: every second fix against the bridge between the
fixes beside it.

Horne, Garton, Krone and Lewis 2007, doi:10.1890/06-0957.1: of fixes 1, 2, 3, .. the second is
compared with the bridge from the first to the third, the fourth with that from the third to the
fifth, and so on, so that no fix is compared and compared with. Given the way points, what a bridge
strays by in one leg is independent of the others. Errors of the fixes enter by both ends, as in the
paper, and by the inner fix, which the paper leaves out; that neighbouring triples share an end,
whose error is then in both, stays disregarded, as there.
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
    """Inner fixes against their neighbours' bridges.

    name: number of the track of each, (m,). time: of the inner fix [s since 1970], (m,). away: of
    the inner fix from the bridge's mean [m], along the way and to its left, (m, 2). unit: variance
    of that for a spread rate of 1 [s], (m, 2). error: variance for an error of 1 m in each
    component of each fix, (m, 2).
    """

    name: Array
    time: Array
    away: Array
    unit: Array
    error: Array


def triples(stretches: Sequence[Stretch]) -> Triples:
    """Return every second inner fix of the stretches with its neighbours; (0, ..) where no stretch
    has three fixes.
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
    """Return the log likelihood by track, (tracks,).

    spread_rate: K [m/sqrt(s)]. error: standard deviation of a fix in each component [m]. One of
    them must be above 0.
    """
    variance = spread_rate**2 * of.unit + error**2 * of.error
    each = -0.5 * (np.log(2 * np.pi * variance) + of.away**2 / variance).sum(-1)
    return np.bincount(of.name, each, minlength=int(of.name.max(initial=-1)) + 1)
