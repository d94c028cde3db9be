"""Probability and time of a bridge's first crossing of a line: a full great circle.

Distances from a great circle are exact on the sphere. If all way points are known and each leg is
shorter than PART, the closed forms of drift.tracking.bridges.line hold leg by leg: the mean path
bends relative to the line by at most 0.1 % of its distance. If a leg is longer, or way points are
uncertain, the joint distribution of positions at way points and at times between
(drift.tracking.bridges.bridge.joint) is sampled by a scrambled Sobol sequence with a fixed seed.
The closed forms are then averaged over the draws. Only positions at a few times are sampled, never
the path, so no crossing between two times is missed. `error` is the standard error over independent
scramblings.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize, special

from drift.tracking.bridges import bridge as bridges
from drift.tracking.bridges import line as plane
from drift.tracking.bridges.bridge import Bridge
from geo import sphere
from geo.array import Array
from geo.notation import NMI

# [m] longest piece of a leg that is treated as straight beside a line, and its largest spread
PART = 300 * NMI
SCRAMBLES, POWER = 8, 12  # independent scramblings of 2^12 draws each
SEED = 2020  # of the scramblings, fixed so that results are reproducible
SMALLEST = 2.0**-40  # lower limit of draws: a scrambled sequence may contain 0
NEGLIGIBLE = 1e-12  # share of the largest variance below which a direction counts as fixed


@dataclass(frozen=True)
class Line:
    """A great circle, by its name and two positions on it: lon, lat [rad], (2,)."""

    name: str
    lon: Array
    lat: Array


@dataclass(frozen=True)
class Crossing:
    """Distance of a bridge from a line at some times, in draws.

    time: [s], (m,), including the way points. distance: [m], positive to the left of the line as
    seen from its first position towards the second, (scramblings, draws, m); one draw if nothing is
    uncertain. untouched: probability that the line has not been crossed by each of these times,
    shape as `distance`. spread_rate: K [m/sqrt(s)].
    """

    time: Array
    distance: Array
    untouched: Array
    spread_rate: float


@dataclass(frozen=True)
class Chance:
    """A probability and its standard error of integration; 0 for a closed form."""

    value: float
    error: float


def through(name: str, lon_deg: npt.ArrayLike, lat_deg: npt.ArrayLike) -> Line:
    """Return the great circle through two positions.

    Args:
        name: of the line.
        lon_deg: of the positions [deg], shape (2,).
        lat_deg: of the positions [deg], shape (2,).

    Raises:
        ValueError: the positions are equal or antipodal, so that no great circle is defined.
    """
    lon, lat = (np.radians(np.asarray(x, np.float64)) for x in (lon_deg, lat_deg))
    if lon.shape != (2,) or lat.shape != (2,):
        raise ValueError(f'line "{name}" goes through two positions; given {lon.size}')
    if not np.isfinite([lon, lat]).all() or np.abs(lat).max() > np.pi / 2:
        raise ValueError(
            f'line "{name}": a position is not finite, or its latitude outside -90 to 90'
        )
    apart = float(sphere.distance(lon[0], lat[0], lon[1], lat[1]))
    if not 1.0 < apart < np.pi * sphere.RADIUS - 1.0:
        raise ValueError(
            f'line "{name}": its positions are {"one place" if apart < PART else "opposite each other"}; '
            "give two positions that are neither the same nor opposite"
        )
    return Line(name, lon, lat)


def _unit(lon: Array, lat: Array) -> Array:
    """Return unit vectors (..., 3) of positions [rad]."""
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)


def distance(line: Line, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
    """Return distances [m] of positions from a line, positive to its left.

    Args:
        line: a great circle.
        lon: of the positions [rad], any shape.
        lat: of the positions [rad], the same shape.
    """
    pole = np.cross(*_unit(line.lon, line.lat))
    pole = pole / np.linalg.norm(pole)
    return np.asarray(
        sphere.RADIUS * np.arcsin(np.clip(_unit(np.asarray(lon), np.asarray(lat)) @ pole, -1, 1))
    )


def crossing(bridge: Bridge, line: Line) -> Crossing:
    """Return the distances and crossing probabilities of a bridge relative to a line."""
    time = _times(bridge)
    place, covariance = bridges.joint(bridge, time)
    value, vector = np.linalg.eigh(covariance)
    varies = value > NEGLIGIBLE * max(value.max(initial=0.0), 1e-12)
    if not varies.any():
        return _crossing(bridge, time, distance(line, place.lon, place.lat)[None, None])
    # the first dimensions of a Sobol sequence are the most uniform
    largest_first = np.flatnonzero(varies)[::-1]
    axes = vector[:, largest_first] * np.sqrt(value[largest_first])
    from scipy.stats import qmc  # imported here, for SciPy's statistics take a second

    uniform = np.stack(
        [
            qmc.Sobol(largest_first.size, rng=np.random.default_rng([SEED, k])).random_base2(POWER)
            for k in range(SCRAMBLES)
        ]
    )
    draws = special.ndtri(uniform.clip(SMALLEST, 1 - SMALLEST))
    strays = (draws @ axes.T).reshape(SCRAMBLES, 2**POWER, time.size, 2)
    lon, lat = sphere.destination(place.lon, place.lat, strays[..., 0], strays[..., 1])
    return _crossing(bridge, time, distance(line, lon, lat))


def _crossing(bridge: Bridge, time: Array, distance: Array) -> Crossing:
    """Return a crossing from distances [m] at times."""
    crossed = plane.crossed(
        distance[..., :-1], distance[..., 1:], bridge.spread_rate, np.diff(time)
    )
    not_crossed = np.concatenate([distance[..., :1] != 0, 1 - crossed], axis=-1)
    return Crossing(time, distance, np.cumprod(not_crossed, axis=-1), bridge.spread_rate)


def _times(bridge: Bridge) -> Array:
    """Return the way points' times, and times that divide long or wide legs into parts."""
    way = bridges.ways(bridge).angle * sphere.RADIUS
    widest = bridge.spread_rate * np.sqrt(np.diff(bridge.time)) / 2  # standard deviation midway
    parts = np.maximum(np.ceil(way / PART), np.ceil((widest / PART) ** 2)).astype(int).clip(1)
    legs = [
        np.linspace(begin, end, count, endpoint=False)
        for begin, end, count in zip(bridge.time[:-1], bridge.time[1:], parts, strict=True)
    ]
    return np.concatenate([*legs, bridge.time[-1:]])


def by(crossing: Crossing, time: float) -> Chance:
    """Return the probability that the line has been crossed by a time [s].

    After the end of the bridge it is that of the whole bridge.
    """
    if time >= crossing.time[-1]:
        return _chance(1 - crossing.untouched[..., -1])
    part = int(np.searchsorted(crossing.time, time, "right")) - 1
    if part < 0:
        return Chance(0.0, 0.0)
    begin, end = crossing.time[part : part + 2]
    a, b = crossing.distance[..., part], crossing.distance[..., part + 1]
    within = plane.touched(a, b, crossing.spread_rate, end - begin, time - begin)
    return _chance(1 - crossing.untouched[..., part] * (1 - within))


def _chance(touched: Array) -> Chance:
    """Return the mean over draws (scramblings, draws) and its standard error."""
    means = touched.mean(axis=1)
    error = float(means.std(ddof=1) / np.sqrt(means.size)) if means.size > 1 else 0.0
    return Chance(float(means.mean()), error)


def at_all(crossing: Crossing) -> Chance:
    """Return the probability that the line is crossed at all."""
    return by(crossing, float(crossing.time[-1]))


def percentile(crossing: Crossing, share: float) -> float:
    """Return a percentile of the crossing time [s], given that the line is crossed.

    Args:
        crossing: of a bridge and a line.
        share: 0 to 1.

    Returns:
        NaN if the line is not crossed.

    Raises:
        ValueError: `share` is outside 0 to 1.
    """
    if not 0 < share < 1:
        raise ValueError(f"percentile {100 * share:g} must lie between 0 and 100")
    total = at_all(crossing).value
    begin, end = float(crossing.time[0]), float(crossing.time[-1])
    if total <= 0:
        return float("nan")
    if by(crossing, begin).value >= share * total:
        return begin
    return float(
        optimize.brentq(
            lambda time: by(crossing, time).value - share * total, begin, end, xtol=1e-3, rtol=1e-15
        )
    )
