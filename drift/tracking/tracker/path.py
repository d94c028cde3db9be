"""Timed paths on the sphere: great circles between vertices, at constant speed on each."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from geo import sphere
from geo.array import Array

# [m] parts of a rhumb line laid as great circles: the error is 0.5 m at 60 degrees of latitude
LONGEST = 5000.0


class Leg(NamedTuple):
    """A rhumb line."""

    course: float  # [rad] true
    speed: float  # [m/s]
    lasting: float  # [s]


class Frame(NamedTuple):
    """East and north at positions: unit vectors, each (n, 3)."""

    east: Array
    north: Array


@dataclass(frozen=True)
class Path:
    """Position at any time; constant before the first vertex and after the last."""

    time: Array  # [s] (n + 1,), ascending
    place: Array  # unit vectors (n + 1, 3)

    @cached_property
    def rate(self) -> Array:
        """Angular speed on each part [rad/s], shape (n,)."""
        return arc(self.place[1:], self.place[:-1]) / np.diff(self.time)

    @cached_property
    def way(self) -> Array:
        """Unit tangent at the begin of each part, (n, 3); north if it does not move."""
        across = self.place[1:] - self.place[:-1] * np.sum(
            self.place[1:] * self.place[:-1], axis=1, keepdims=True
        )
        size = np.linalg.norm(across, axis=1, keepdims=True)
        return np.where(
            size > 1e-13, across / np.maximum(size, 1e-300), frame(self.place[:-1]).north
        )

    def at(self, time: npt.ArrayLike) -> tuple[Array, Array]:
        """Return positions and velocities at times.

        Args:
            time: [s], shape (m,).

        Returns:
            Unit vectors and their derivatives [1/s], each of shape (m, 3).
        """
        time = np.asarray(time, np.float64)
        part = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.rate) - 1)
        still = (time < self.time[0]) | (time > self.time[-1])
        time = np.clip(time, self.time[0], self.time[-1])
        angle = self.rate[part] * (time - self.time[part])
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        rate = np.where(still, 0.0, self.rate[part])[:, None]
        return self.place[part] * c + self.way[part] * s, rate * (
            self.way[part] * c - self.place[part] * s
        )


def vector(lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
    """Return unit vectors (n, 3) of positions [rad]."""
    return np.stack(sphere.vector(lon, lat), axis=-1)


def degrees(place: Array) -> tuple[Array, Array]:
    """Return (lon, lat) [deg] of unit vectors (..., 3)."""
    across = np.hypot(place[..., 0], place[..., 1])
    return np.degrees(np.arctan2(place[..., 1], place[..., 0])), np.degrees(
        np.arctan2(place[..., 2], across)
    )


def arc(first: Array, second: Array) -> Array:
    """Return the angle [rad] between unit vectors (..., 3)."""
    return np.asarray(2 * np.arcsin(np.minimum(np.linalg.norm(first - second, axis=-1) / 2, 1.0)))


def frame(place: Array) -> Frame:
    """Return east and north at unit vectors (..., 3)."""
    lon = np.arctan2(place[..., 1], place[..., 0])
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lon)], axis=-1)
    return Frame(east, np.cross(place, east))


def course(place: Array, velocity: Array) -> Array:
    """Return the course [rad] of velocities.

    Args:
        place: unit vectors, shape (..., 3).
        velocity: their derivatives, shape (..., 3).
    """
    there = frame(place)
    return np.asarray(
        np.arctan2(np.sum(velocity * there.east, axis=-1), np.sum(velocity * there.north, axis=-1))
    )


def through(time: npt.ArrayLike, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Path:
    """Return the path through positions.

    Args:
        time: [s], ascending, two or more, shape (n,).
        lon: [rad], shape (n,).
        lat: [rad], shape (n,).
    """
    return Path(np.asarray(time, np.float64), vector(np.asarray(lon), np.asarray(lat)))


def standing(lon: float, lat: float, begin: float, end: float) -> Path:
    """Return the path of an object that stays at a position [rad]."""
    return through([begin, end], [lon, lon], [lat, lat])


def of_legs(lon: float, lat: float, legs: Sequence[Leg], begin: float = 0.0) -> Path:
    """Return the path from a position along rhumb lines, one after the other.

    Args:
        lon: of the start [rad].
        lat: of the start [rad].
        legs: the rhumb lines.
        begin: time at the start [s].
    """
    times, lons, lats = [begin], [lon], [lat]
    for leg in legs:
        many = max(int(np.ceil(leg.speed * leg.lasting / LONGEST)), 1)
        done = np.arange(1, many + 1) / many
        far = leg.speed * leg.lasting * done / sphere.RADIUS
        to = lats[-1] + far * np.cos(leg.course)
        # Longitude from the difference of isometric latitudes; on a parallel, its limit.
        rise = np.arctanh(np.sin(to)) - np.arctanh(np.sin(lats[-1]))
        level = np.abs(to - lats[-1]) < 1e-9
        slope = np.where(level, np.cos(lats[-1]), (to - lats[-1]) / np.where(level, 1.0, rise))
        lons += list(lons[-1] + far * np.sin(leg.course) / slope)
        lats += list(to)
        times += list(times[-1] + leg.lasting * done)
    if len(times) == 1:
        return standing(lon, lat, begin, begin + 1.0)
    return through(times, lons, lats)
