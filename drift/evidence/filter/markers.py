"""Datum markers: the position over time of a pattern that drifts with the water.

If the track of a marker is not known, the marker drifts with the water from the pattern's datum on.
It drifts in the scenario's own forcing, without errors; in an ensemble of currents there is one
marker per member. Each step of the run is one Runge-Kutta step on the host, in three dimensions, so
that a pole is not a special case.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from drift.engine.motion.forcing import Forcing
from geo import sphere
from geo.array import Array
from geo.polyline import Legs

# [s] at most between stored positions, which are joined by straight lines in lon and lat. The error
# is 0.2 m in a strong tide, and 12 m in the minute of passing 20 m from a pole.
NODE = 60.0


@dataclass
class Marker:
    """The track of one marker in the current of one scenario, which others may share."""

    lon: float  # [deg] starting position
    lat: float
    begin: float  # [s after the run's start]
    scenario: int
    member: int | None = None  # ensemble member in whose current it drifts; None: mean of all
    _time: list[float] = field(default_factory=list)
    _place: list[Array] = field(default_factory=list)  # lon without jumps, lat [rad]

    def where(self, time: Array) -> tuple[Array, Array]:
        """Return (lon, lat) [rad] at times [s after the run's start]."""
        if not self._time:
            return np.full(time.shape, np.radians(self.lon)), np.full(
                time.shape, np.radians(self.lat)
            )
        lon, lat = np.array(self._place).T
        return np.interp(time, self._time, lon), np.interp(time, self._time, lat)

    def legs(self, start: int) -> Legs | None:
        """Return the track, None if the marker has not drifted.

        start: of the run [s since 1970].
        """
        if not self._time:
            return None
        lon, lat = np.degrees(np.array(self._place)).T
        time = tuple(start + t for t in self._time)
        return Legs(time, tuple(lon.tolist()), tuple(lat.tolist()), (True,) * (len(time) - 1))

    @property
    def way(self) -> Array:
        """The track so far: time [s after the run's start], lon, lat [rad], (k, 3)."""
        return np.column_stack([self._time, np.reshape(self._place, (-1, 2))])

    def go_on(self, way: Array) -> None:
        """Restore a track so far, as `way` returns it."""
        self._time, self._place = way[:, 0].tolist(), list(way[:, 1:])

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Move the marker over the step from `elapsed` on; the forcing must be set for the step."""
        begin, end = float(max(elapsed, self.begin)), float(elapsed + duration)
        if end <= begin:
            return
        if not self._time:
            self._time, self._place = [begin], [np.radians([self.lon, self.lat])]
        dt, place = end - begin, _vector(*self._place[-1])
        first, middle, last = (np.array([begin, 0.5 * (begin + end), end]) - elapsed) / duration
        k1 = self._rate(forcing, place, first)
        k2 = self._rate(forcing, place + 0.5 * dt * k1, middle)
        k3 = self._rate(forcing, place + 0.5 * dt * k2, middle)
        k4 = self._rate(forcing, place + dt * k3, last)
        there = place + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        # Inside the step the track is Hermite's cubic, as for particles: the chord of an hour may
        # be half a kilometre off.
        nodes = max(math.ceil(dt / NODE), 1)
        u = (np.arange(nodes) + 1)[:, None] / nodes
        way = (1 + 2 * u) * (1 - u) ** 2 * place + u**2 * (3 - 2 * u) * there
        way += dt * u * (1 - u) * ((1 - u) * k1 - u * self._rate(forcing, there, last))
        lon, lat = (
            np.arctan2(way[:, 1], way[:, 0]),
            np.arctan2(way[:, 2], np.hypot(way[:, 0], way[:, 1])),
        )
        lon = np.unwrap([self._place[-1][0], *lon])[1:]
        self._time += np.linspace(begin, end, nodes + 1)[1:].tolist()
        self._place += list(np.column_stack([lon, lat]))

    def _rate(self, forcing: Forcing, place: Array, share: float) -> Array:
        """Return the rate [1/s] of a position, a vector on the unit sphere, in the current.

        It is 0 where there is no forcing: there the marker stays.
        """
        lon, lat = (
            np.arctan2(place[1], place[0]),
            np.arctan2(place[2], np.hypot(place[0], place[1])),
        )
        tiles = forcing.ranges[self.scenario]["current"]
        several = forcing.members(self.scenario, "current") if self.member is None else 1
        every = np.arange(several, dtype=np.int32) + (self.member or 0)
        at = (sphere.to_binary(np.degrees(np.full(every.size, angle))) for angle in (lon, lat))
        sampled = forcing.tiles.at(*tiles, *at, float(share), every)
        known = sampled[sampled[:, 2] > 0.5, :2]
        if not known.size:
            return np.zeros(3)
        east, north = known.mean(axis=0).astype(np.float64) / sphere.RADIUS
        to_east, to_north = _vector(lon + np.pi / 2, 0.0), _vector(lon + np.pi, np.pi / 2 - lat)
        return np.asarray(east * to_east + north * to_north)


def _vector(lon: float, lat: float) -> Array:
    """Return a position [rad] as a unit vector (3,)."""
    return np.array(sphere.vector(lon, lat))


@dataclass(frozen=True)
class Tracked:
    """A marker with a known track, such as a buoy's: it is the same in every scenario."""

    time: Array  # [s after the run's start]
    lon: Array  # [rad] without jumps
    lat: Array

    def where(self, time: Array) -> tuple[Array, Array]:
        """Return (lon, lat) [rad] at times [s after the run's start]."""
        return np.interp(time, self.time, self.lon), np.interp(time, self.time, self.lat)


def marker_of_track(track: Legs, start: int) -> Tracked:
    """Return the marker of a known track.

    Args:
        track: positions of the marker over time.
        start: of the run [s since 1970].
    """
    return Tracked(
        np.array(track.time) - start, np.unwrap(np.radians(track.lon)), np.radians(track.lat)
    )
