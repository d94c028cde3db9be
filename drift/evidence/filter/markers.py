"""Datum markers: where a pattern that drifts with the water has got to.

A marker whose track is not known drifts with the water from the pattern's datum on, in the
scenario's own forcing and without errors, and in each member by itself where that is an ensemble:
by Runge-Kutta steps on the host, one for each step of the run, in three dimensions, so that a pole
is a place like others.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from drift.engine.motion.forcing import Forcing
from geo import sphere
from geo.array import Array
from geo.polyline import Legs

# [s] at most between places that are kept, and joined by straight lines in lon and lat: 0.2 m off
# in a strong tide, 12 m in the minute of passing 20 m from a pole
NODE = 60.0


@dataclass
class Marker:
    """The way of one marker in the current that one scenario sees, and perhaps others."""

    lon: float  # [deg], where it began
    lat: float
    begin: float  # [s after the run's start]
    scenario: int
    member: int | None = None  # of an ensemble in which it drifts; None: in the mean of all
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
        """Return its track, None if it has not drifted; start: of the run [s since 1970]."""
        if not self._time:
            return None
        lon, lat = np.degrees(np.array(self._place)).T
        time = tuple(start + t for t in self._time)
        return Legs(time, tuple(lon.tolist()), tuple(lat.tolist()), (True,) * (len(time) - 1))

    @property
    def way(self) -> Array:
        """Its way so far: time [s after the run's start], lon, lat [rad], (k, 3)."""
        return np.column_stack([self._time, np.reshape(self._place, (-1, 2))])

    def go_on(self, way: Array) -> None:
        """Take up a way so far."""
        self._time, self._place = way[:, 0].tolist(), list(way[:, 1:])

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Move it over the step from `elapsed` on, for which the forcing is set."""
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
        # Inside the step it is on Hermite's cubic, as particles are: the chord of an hour may be
        # half a kilometre off.
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
        """Return the change [1/s] of a place (a vector as long as the Earth's radius is 1) in the
        current.

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
        told = forcing.tiles.at(*tiles, *at, float(share), every)
        known = told[told[:, 2] > 0.5, :2]
        if not known.size:
            return np.zeros(3)
        east, north = known.mean(axis=0).astype(np.float64) / sphere.RADIUS
        to_east, to_north = _vector(lon + np.pi / 2, 0.0), _vector(lon + np.pi, np.pi / 2 - lat)
        return np.asarray(east * to_east + north * to_north)


def _vector(lon: float, lat: float) -> Array:
    """Return a place [rad] as a unit vector (3,)."""
    return np.array(sphere.vector(lon, lat))


@dataclass(frozen=True)
class Tracked:
    """A marker whose track is known, such as a buoy's: it is the same in every scenario."""

    time: Array  # [s after the run's start]
    lon: Array  # [rad] without jumps
    lat: Array

    def where(self, time: Array) -> tuple[Array, Array]:
        """Return (lon, lat) [rad] at times [s after the run's start]."""
        return np.interp(time, self.time, self.lon), np.interp(time, self.time, self.lat)


def tracked(track: Legs, start: int) -> Tracked:
    """Return the marker of a known track; start: of the run [s since 1970]."""
    return Tracked(
        np.array(track.time) - start, np.unwrap(np.radians(track.lon)), np.radians(track.lat)
    )
