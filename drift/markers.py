"""Datum markers: where a pattern that drifts with the water has got to.

A marker whose track is not known drifts as water does, from the pattern's datum on, in the scenario's own forcing and
without its errors: by Runge-Kutta steps on the host, one a stretch.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from drift.forcing import Forcing
from drift.sortie import Legs
from geo import sphere

Array = npt.NDArray[Any]


@dataclass
class Marker:
    """The way of one marker in one scenario: how far it has drifted, by time."""

    lon: float  # [deg] where it began
    lat: float
    begin: float  # [s after the run's start]
    scenario: int
    _time: list[float] = field(default_factory=list)
    _east: list[float] = field(default_factory=list)  # [m] from where it began
    _north: list[float] = field(default_factory=list)

    def shift(self, time: Array) -> tuple[Array, Array]:
        """Return how far it has drifted [m] east and north, at times [s after the run's start]."""
        if not self._time:
            return np.zeros_like(time), np.zeros_like(time)
        return np.interp(time, self._time, self._east), np.interp(time, self._time, self._north)

    def legs(self, start: int) -> Legs | None:
        """Return its way; start: of the run [s since 1970]. None if it has not drifted."""
        if not self._time:
            return None
        lon, lat = sphere.destination(np.radians(self.lon), np.radians(self.lat), self._east, self._north)
        time = tuple(start + t for t in self._time)
        return Legs(
            time, tuple(np.degrees(np.unwrap(lon)).tolist()), tuple(np.degrees(lat).tolist()), (True,) * (len(time) - 1)
        )

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Take it over the step from `elapsed` on, for which the forcing is set."""
        begin, end = max(float(elapsed), self.begin), float(elapsed + duration)
        if end <= begin:
            return
        if not self._time:
            self._time, self._east, self._north = [begin], [0.0], [0.0]
        dt, x, y = end - begin, self._east[-1], self._north[-1]
        shares = (np.array([begin, 0.5 * (begin + end), end]) - elapsed) / duration
        k1 = self._velocity(forcing, x, y, shares[0])
        k2 = self._velocity(forcing, x + 0.5 * dt * k1[0], y + 0.5 * dt * k1[1], shares[1])
        k3 = self._velocity(forcing, x + 0.5 * dt * k2[0], y + 0.5 * dt * k2[1], shares[1])
        k4 = self._velocity(forcing, x + dt * k3[0], y + dt * k3[1], shares[2])
        east, north = dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        self._time.append(end)
        self._east.append(x + east)
        self._north.append(y + north)

    def _velocity(self, forcing: Forcing, east: float, north: float, share: float) -> Array:
        """Return the current [m/s] where it is; none where there is no forcing, so that it stays."""
        ranges = forcing.ranges[self.scenario]
        lon, lat = sphere.destination(np.radians(self.lon), np.radians(self.lat), east, north)
        place = (sphere.to_binary(np.degrees([float(x)])) for x in (lon, lat))
        found = forcing.tiles.at(ranges[0], ranges[1], *place, float(share))[0]
        return np.asarray(found[:2] if found[2] > 0.5 else np.zeros(2), np.float64)


@dataclass(frozen=True)
class Tracked:
    """A marker whose track is known, a buoy's: the same in every scenario."""

    time: Array  # [s after the run's start]
    east: Array  # [m] from where the pattern's datum is
    north: Array

    def shift(self, time: Array) -> tuple[Array, Array]:
        """Return how far it has drifted [m] east and north, at times [s after the run's start]."""
        return np.interp(time, self.time, self.east), np.interp(time, self.time, self.north)

    def drift(self, forcing: Forcing, elapsed: int, duration: int) -> None:
        """Do nothing: its track is known."""


def tracked(track: Legs, datum: tuple[float, float], start: int) -> Tracked:
    """Return a marker by its track; datum: (lon, lat) [deg] of the pattern; start: of the run [s since 1970]."""
    lon, lat = np.radians(track.lon), np.radians(track.lat)
    east, north = sphere.offset(np.radians(datum[0]), np.radians(datum[1]), lon, lat)
    return Tracked(np.array(track.time) - start, east, north)
