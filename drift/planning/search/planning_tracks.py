"""Tracks of planning particles: positions at the edges of time bins, straight in between."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from geo import sphere
from geo.array import Array

LEVELS = 12  # of the space-filling curve: a side of 4096
MINUTE = 60.0  # [s]


@dataclass(frozen=True)
class Tracks:
    """Planning particles (m) at bin edges (b + 1), given everything known before the plan."""

    time: Array  # float64 [s since 1970] (b + 1,)
    lon: Array  # int32 binary angle (b + 1, m)
    lat: Array
    # bool (b + 1, m): the particle can be detected: it is adrift, under way, or at its last
    # position if the search covers those
    adrift: Array
    weight: Array  # float64 (m,), with the sum 1
    scenario: Array  # int32 (m,)
    release: Array  # float64 [s since 1970] (m,)
    # End of a particle's steering, when it goes adrift [s since 1970] (m,); -inf: it drifts all
    # along, inf: it never does; None: no particle steers.
    turn: Array | None = None
    # Mean velocity [m/s] east and north of the leg of a Brownian bridge, and its spread rate
    # [m/sqrt(s)], from each edge on, float32 (3, b + 1, m); NaN: not on a bridge, use the track;
    # None: no particle follows a bridge.
    flow: Array | None = None

    @cached_property
    def strata(self) -> Array:
        """The particles' order by strata: scenario, then a space-filling curve at half time."""
        x, y = plane(self).flat(*(v[self.bins // 2] * sphere.UNIT for v in (self.lon, self.lat)))
        return np.lexsort((_morton(x, y, *_square(x, y)), self.scenario))

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
    """The plane of a plan (azimuthal equidistant): true distances and bearings from its origin."""

    lon: float  # [rad] origin
    lat: float

    def flat(self, lon: npt.ArrayLike, lat: npt.ArrayLike) -> tuple[Array, Array]:
        """Return (x, y) [m] east and north of positions [rad]."""
        return sphere.offset(self.lon, self.lat, lon, lat)

    def round(self, x: npt.ArrayLike, y: npt.ArrayLike) -> tuple[Array, Array]:
        """Return positions (lon, lat) [rad] of (x, y) [m]."""
        return sphere.destination(self.lon, self.lat, x, y)


def plane(tracks: Tracks) -> Plane:
    """Return the plane about the mean of all positions.

    300 km from it, lengths across are 0.04 % too long.
    """
    lon, lat = tracks.lon * sphere.UNIT, tracks.lat * sphere.UNIT
    across = np.cos(lat)
    mean = [
        float(np.mean(v @ tracks.weight))
        for v in (across * np.cos(lon), across * np.sin(lon), np.sin(lat))
    ]
    return Plane(
        float(np.arctan2(mean[1], mean[0])), float(np.arctan2(mean[2], np.hypot(mean[0], mean[1])))
    )


def take(tracks: Tracks, index: Array, weight: Array) -> Tracks:
    """Return some of the particles with new weights, normalised to the sum 1."""
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


def sort(tracks: Tracks) -> Tracks:
    """Return the particles in the order of strata: neighbours at sea are neighbours in memory."""
    return take(tracks, tracks.strata, tracks.weight[tracks.strata])


def sample(tracks: Tracks, count: int) -> Tracks:
    """Return `count` particles of equal weight.

    Sampling is systematic along strata, in proportion to weight.
    """
    strata = tracks.strata
    cumulative = np.cumsum(tracks.weight[strata])
    ticks = (np.arange(count) + 0.5) / count * cumulative[-1]
    return take(
        tracks, strata[np.minimum(np.searchsorted(cumulative, ticks), tracks.m - 1)], np.ones(count)
    )


def coarser(tracks: Tracks, most: int) -> Tracks:
    """Return the tracks at the edges of at most `most` bins."""
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
    """Return the velocity (east, north) [m/s] from each edge on, shape (b + 1, m).

    Particles on a bridge have the mean velocity of their leg, all others that of their track.

    Args:
        tracks: planning particles.
        plane: of the plan.
        x: east of the particles on the plane [m], shape (b + 1, m).
        y: north of them [m], shape (b + 1, m).
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


def _square(x: Array, y: Array) -> tuple[float, float, float]:
    """Return (west, south, side) [m] of a square half as large again as the points' extent."""
    side = 1.5 * max(float(np.ptp(x)), float(np.ptp(y)), 1.0)
    return float(x.max() + x.min() - side) / 2, float(y.max() + y.min() - side) / 2, side


def _morton(x: Array, y: Array, west: float, south: float, side: float) -> Array:
    """Return positions (int64) of points [m] along Morton's curve of a square [m]."""
    code = np.zeros(np.shape(x), np.int64)
    for shift, share in enumerate(((x - west) / side, (y - south) / side)):
        spread = np.clip((share * 2**LEVELS).astype(np.int64), 0, 2**LEVELS - 1)
        for gap, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
            spread = (spread | (spread << gap)) & mask
        code |= spread << shift
    return code
