"""Tracks of particles for which a plan is made: positions at the edges of time bins, straight in
between.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from geo import sphere
from geo.array import Array

LEVELS = 12  # of the space-filling curve: a side of 4096
MINUTE = 60.0  # [s]


@dataclass(frozen=True)
class Tracks:
    """Particles (m) at bin edges (b + 1), given all that was found and not found before the plan
    begins.
    """

    time: Array  # float64 [s since 1970] (b + 1,)
    lon: Array  # int32 binary angle (b + 1, m)
    lat: Array
    # bool (b + 1, m): the particle can be detected (it is adrift, under way, or where it has
    # stopped, if that is looked for)
    adrift: Array
    weight: Array  # float64 (m,), with the sum 1
    scenario: Array  # int32 (m,)
    release: Array  # float64 [s since 1970] (m,)
    # When a particle goes adrift that is under way until then [s since 1970] (m,); -inf: it drifts
    # all along, inf: it never does; None: nothing steers.
    turn: Array | None = None
    # Mean velocity [m/s] east and north of the leg of a Brownian bridge, and its spread rate
    # [m/sqrt(s)], from each edge on, float32 (3, b + 1, m); NaN where the track itself tells them;
    # None: nothing follows a bridge.
    flow: Array | None = None

    @property
    def bins(self) -> int:
        """Number of time bins."""
        return len(self.time) - 1

    @property
    def m(self) -> int:
        """Number of particles."""
        return len(self.weight)


@dataclass(frozen=True)
class Plane:
    """The azimuthal equidistant plane on which a plan is computed: true distances and bearings from
    its origin.
    """

    lon: float  # [rad] origin
    lat: float

    def flat(self, lon: npt.ArrayLike, lat: npt.ArrayLike) -> tuple[Array, Array]:
        """Return (x, y) [m] east and north of positions [rad]."""
        return sphere.offset(self.lon, self.lat, lon, lat)

    def round(self, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[Array, Array]:
        """Return positions (lon, lat) [rad] of (x, y) [m]."""
        return sphere.destination(self.lon, self.lat, x, y)


def plane(tracks: Tracks) -> Plane:
    """Return the plane round the mean of all positions.

    300 km from it, lengths across are 0.04 % too long.
    """
    lon, lat = tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT
    mean = [
        float(np.mean(v @ tracks.weight))
        for v in (np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat))
    ]
    return Plane(
        float(np.arctan2(mean[1], mean[0])), float(np.arctan2(mean[2], np.hypot(mean[0], mean[1])))
    )


def take(tracks: Tracks, index: Array, weight: Array) -> Tracks:
    """Return some of the particles with new weights, which are scaled to the sum 1."""
    lon, lat, adrift = (
        np.ascontiguousarray(v[:, index]) for v in (tracks.lon, tracks.lat, tracks.adrift)
    )
    return replace(
        tracks,
        lon=lon,
        lat=lat,
        adrift=adrift,
        weight=weight / weight.sum(),
        scenario=tracks.scenario[index],
        release=tracks.release[index],
        turn=None if tracks.turn is None else tracks.turn[index],
        flow=None if tracks.flow is None else np.ascontiguousarray(tracks.flow[:, :, index]),
    )


def order(tracks: Tracks) -> Array:
    """Return the particles' order by strata: by scenario, then along a space-filling curve at half
    time.
    """
    x, y = plane(tracks).flat(
        *(v[tracks.bins // 2] * sphere.UNIT for v in (tracks.lon, tracks.lat))
    )
    return np.lexsort((morton(x, y, *square(x, y)), tracks.scenario))


def sort(tracks: Tracks) -> Tracks:
    """Return the same particles in the order of strata, so that neighbours in memory are neighbours
    at sea.
    """
    strata = order(tracks)
    return take(tracks, strata, tracks.weight[strata])


def sample(tracks: Tracks, count: int) -> Tracks:
    """Return `count` particles of equal weight, drawn systematically in proportion to weight along
    strata.
    """
    strata = order(tracks)
    cumulative = np.cumsum(tracks.weight[strata])
    ticks = (np.arange(count) + 0.5) / count * cumulative[-1]
    return take(
        tracks, strata[np.minimum(np.searchsorted(cumulative, ticks), tracks.m - 1)], np.ones(count)
    )


def coarser(tracks: Tracks, most: int) -> Tracks:
    """Return the same tracks at the edges of at most so many bins."""
    edge = np.unique(np.rint(np.linspace(0, tracks.bins, min(tracks.bins, most) + 1)).astype(int))
    return replace(
        tracks,
        time=tracks.time[edge],
        lon=tracks.lon[edge],
        lat=tracks.lat[edge],
        adrift=tracks.adrift[edge],
        flow=None if tracks.flow is None else tracks.flow[:, edge],
    )


def velocity(tracks: Tracks, plane: Plane, x: Array, y: Array) -> tuple[Array, Array]:
    """Return how fast (east, north) [m/s] particles go on the plane from each edge on, (b + 1, m).

    x, y: where they are on the plane [m]. What follows a bridge goes as its leg does on average,
    all else as its track.
    """
    along = []
    for v in (x, y):
        pace = np.diff(v, axis=0) / np.diff(tracks.time)[:, None]
        along.append(np.concatenate([pace, pace[-1:]]))
    if tracks.flow is None:
        return along[0], along[1]
    there = sphere.destination(
        tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT, *(MINUTE * v for v in tracks.flow[:2])
    )
    further = zip(plane.flat(*there), (x, y), along, strict=True)
    east, north = (np.where(np.isnan(end), own, (end - v) / MINUTE) for end, v, own in further)
    return east, north


def square(x: Array, y: Array) -> tuple[float, float, float]:
    """Return (west, south, side) [m] of a square that holds all points and half as much again."""
    side = 1.5 * max(float(np.ptp(x)), float(np.ptp(y)), 1.0)
    return float(x.max() + x.min() - side) / 2, float(y.max() + y.min() - side) / 2, side


def morton(x: Array, y: Array, west: float, south: float, side: float) -> Array:
    """Return the positions, int64, of points [m] along Morton's curve of 4^LEVELS cells in a square
    [m].
    """
    code = np.zeros(np.shape(x), np.int64)
    for shift, share in enumerate(((x - west) / side, (y - south) / side)):
        spread = np.clip((share * 2**LEVELS).astype(np.int64), 0, 2**LEVELS - 1)
        for gap, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
            spread = (spread | (spread << gap)) & mask
        code |= spread << shift
    return code
