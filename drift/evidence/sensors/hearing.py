"""A passive sonar at a position and time: even tables, and signal excess by bearing and range.

The tables are those of kernels.evidence.listen, which moves particles past the sonar; here they are
evaluated for positions at one time.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drift.evidence.sensors import losses
from drift.evidence.sensors.records import Gain, Sonar
from geo import notation, sphere
from geo.array import Array
from kernels.evidence.listen import Tables

TURN = 2 * math.pi
MOST_RAYS = 720  # most bearings of even loss tables
# used if no smaller number contains the bearings of a table: linear interpolation lowers a peak of
# 10 dB in 30 degrees by 0.1 dB
FINE_RAYS = 360
FINEST = 100.0  # [m] smallest spacing of ranges of even loss tables
MOST_SIDES = 7200  # most bearings of even gain tables
FINE_SIDES = 3600  # fewest bearings, unless gains are the same all round
# a signal excess below minus so many standard deviations is inaudible: once in 10^9 draws
SILENT = 6.0


@dataclass(frozen=True, eq=False)
class Receiver:
    """A sonar with the beams that are processed."""

    sonar: Sonar
    beams: tuple[int, ...] = ()  # numbers of the beams that are processed, from 0; (): all

    @cached_property
    def gain(self) -> Array:
        """The gain [dB] by relative bearing, the best of the beams (b,)."""
        gain: Gain = self.sonar.gain
        return np.asarray(
            np.max(gain.beams[list(self.beams)] if self.beams else gain.beams, axis=0)
        )

    @cached_property
    def ranges(self) -> Array:
        """The even ranges [m] of loss tables, as far as any target is audible."""
        own = self.sonar
        far = own.losses.range
        if len(far) < 2:
            return np.array([far[0], far[0] + 1.0])
        whole, least = far[-1] - far[0], max(float(np.diff(far).min()), FINEST)
        first, most = (
            max(math.ceil(whole / gap - 1e-6), 1) for gap in (least, max(least / 4, FINEST))
        )
        rings = _holding((far - far[0]) / whole, first, most) + 1
        even = np.linspace(far[0], far[-1], rings)
        best = (
            own.levels.level.max()
            + self.gain.max()
            - own.noise.level.min()
            - own.threshold
            + 4 * own.unknown
        )
        lowest = own.losses.loss.min(axis=(0, 1))
        heard = np.flatnonzero(best - lowest > -SILENT * own.fluctuation)
        last = far[min(heard[-1] + 1, len(far) - 1)] if heard.size else far[0]
        return even[: max(int(np.searchsorted(even, last)) + 1, 2)]

    @cached_property
    def _sides(self) -> int:
        """The number of bearings of gain tables.

        The heading of the array puts its bearings between those of the noise.
        """
        every = self.sonar.gain.bearing, self.sonar.noise.bearing
        gaps = [np.diff(own, append=own[0] + TURN).min() for own in every]
        return (
            1
            if min(gaps) >= TURN
            else min(max(math.ceil(TURN / min(gaps)), FINE_SIDES), MOST_SIDES)
        )

    def tables(self, lon: float, lat: float, heading: float, time: np.datetime64) -> Tables:
        """Return the tables of the sonar in the form that kernels take.

        Args:
            lon: longitude of the sonar [rad].
            lat: latitude of the sonar [rad].
            heading: of its array, true [rad].
            time: of the noise.
        """
        own, ranges = self.sonar, self.ranges
        rays = even(own.losses.bearing, MOST_RAYS)
        sides = self._sides
        laid = self.laid_out(losses.between(own.losses, lon, lat), rays)
        toward = np.arange(sides) * TURN / sides
        gains = round_circle(toward - heading, own.gain.bearing, self.gain)
        gains = gains - round_circle(toward, own.noise.bearing, self.noise(time)) - own.threshold
        return Tables(
            np.ascontiguousarray(laid, np.float32),
            float(ranges[0]),
            float(ranges[1] - ranges[0]),
            gains.astype(np.float32),
            own.levels.level,
            own.levels.speed.astype(np.float32),
            own.fluctuation,
            own.jump_rate,
        )

    def laid_out(self, loss: Array, rays: int) -> Array:
        """Return losses (b, r) resampled at even bearings and ranges (rays, rings)."""
        by_range = _along(self.ranges, self.sonar.losses.range, loss)
        return round_circle(np.arange(rays) * TURN / rays, self.sonar.losses.bearing, by_range)

    def noise(self, time: np.datetime64) -> Array:
        """Return the noise [dB] by bearing at a time (b,), interpolated between its times."""
        own = self.sonar.noise
        if not own.times.size:
            return np.asarray(own.level[0])
        at = float(notation.epoch(time))
        known = np.array([float(notation.epoch(moment)) for moment in own.times])
        k = int(np.clip(np.searchsorted(known, at, side="right") - 1, 0, max(len(known) - 2, 0)))
        share = (
            np.clip((at - known[k]) / (known[k + 1] - known[k]), 0, 1) if len(known) > 1 else 0.0
        )
        return np.asarray(
            (1 - share) * own.level[k] + share * own.level[min(k + 1, len(known) - 1)]
        )

    def change(self, begin: np.datetime64, end: np.datetime64) -> float:
        """Return the largest total variation of the noise over bearings between two times [dB]."""
        known = self.sonar.noise.times
        times = [begin, *known[(known > begin) & (known < end)], end]
        every = np.array([self.noise(time) for time in times])
        return float(np.abs(np.diff(every, axis=0)).sum(axis=0).max())


def even(bearings: Array, most: int) -> int:
    """Return the number of even bearings that contain all of a table's, or are much finer.

    Args:
        bearings: of the table [rad], ascending.
        most: largest number.
    """
    if len(bearings) == 1:
        return 1
    gaps = np.diff(bearings, append=bearings[0] + TURN)
    least = min(max(math.ceil(TURN / float(gaps.min()) - 1e-6), 4), most)
    return _holding(bearings / TURN, least, min(max(FINE_RAYS, least), most))


def _holding(shares: Array, least: int, most: int) -> int:
    """Return the first number of equal parts of 1 whose ends contain all `shares`; else `most`.

    Linear interpolation between other points than a table's would lower its peaks.
    """
    count = np.arange(least, most + 1)
    place = shares[:, None] * count
    met = np.abs(place - np.round(place)).max(axis=0) < 1e-4
    return int(count[met.argmax()]) if met.any() else most


def round_circle(at: Array, bearings: Array, values: Array) -> Array:
    """Return values at bearings, interpolated linearly round the circle.

    Args:
        at: bearings [rad], shape (k,).
        bearings: of the table [rad], ascending in [0, 2 pi), shape (b,).
        values: of the table, shape (b, ...).

    Returns:
        Values, shape (k, ...).
    """
    if len(bearings) == 1:
        return np.repeat(values[:1], len(at), axis=0)
    turned = np.mod(at, TURN)
    k = np.searchsorted(bearings, turned, side="right") - 1  # -1: before the first, after the last
    begin, end = bearings[k], bearings[(k + 1) % len(bearings)]
    span = np.mod(end - begin, TURN)
    share = np.mod(turned - begin, TURN) / np.where(span > 0, span, TURN)
    share = share.reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray((1 - share) * values[k] + share * values[(k + 1) % len(bearings)])


def _along(ranges: Array, known: Array, loss: Array) -> Array:
    """Return losses (b, k) at ranges (k,), interpolated linearly between known ranges (r,)."""
    if len(known) == len(ranges) and np.allclose(known, ranges, rtol=1e-9):
        return loss
    return np.stack([np.interp(ranges, known, row) for row in loss])


def _excess(tables: Tables, east: Array, north: Array) -> Array:
    """Return the signal excess [dB] of a source of 0 dB; -inf: beyond the table.

    Args:
        tables: of the sonar.
        east: offset from the sonar [m], any shape.
        north: offset from the sonar [m], same shape.
    """
    arrives, gain = terms(tables, east, north)
    return np.asarray(arrives + gain)


def terms(tables: Tables, east: Array, north: Array) -> tuple[Array, Array]:
    """Return the two terms of the signal excess of a source of 0 dB.

    Args:
        tables: of the sonar.
        east: offset from the sonar [m], any shape.
        north: offset from the sonar [m], same shape.

    Returns:
        The level that arrives [dB], -inf beyond the table, and gain - noise - threshold [dB].
    """
    far, bearing = np.hypot(east, north), np.arctan2(east, north)
    rings = tables.losses.shape[1]
    ring = np.maximum((far - tables.nearest) / tables.between, 0.0)
    k = np.minimum(ring.astype(int), rings - 2)
    share = ring - k
    low = (1 - share) * _round(tables.losses, bearing, k) + share * _round(
        tables.losses, bearing, k + 1
    )
    gain = _round(tables.gains[:, None], bearing, np.zeros_like(k))
    return np.where(ring <= rings - 1, -low, -np.inf), gain


def _round(table: Array, bearing: Array, column: Array) -> Array:
    """Return the values of a table (sides, columns) at bearings [rad] and columns.

    Values are interpolated linearly between its even bearings.
    """
    many = len(table)
    place = np.mod(bearing / TURN, 1.0) * many
    k = np.minimum(place.astype(int), many - 1)
    share = place - k if many > 1 else 0.0
    return np.asarray((1 - share) * table[k, column] + share * table[(k + 1) % many, column])


def level(sonar: Sonar, scenario: Array, speed: Array) -> Array:
    """Return source levels [dB], shape (n,).

    Args:
        sonar: with levels by scenario and speed.
        scenario: number of the scenario, shape (n,).
        speed: over ground [m/s], shape (n,).
    """
    own = sonar.levels
    k = np.clip(np.searchsorted(own.speed, speed, side="right") - 1, 0, max(len(own.speed) - 2, 0))
    after = np.minimum(k + 1, len(own.speed) - 1)
    span = own.speed[after] - own.speed[k]
    share = np.clip((speed - own.speed[k]) / np.where(span > 0, span, 1.0), 0, 1)
    return np.asarray((1 - share) * own.level[scenario, k] + share * own.level[scenario, after])


def signal_excess_of_sources(
    ear: Receiver,
    place: tuple[float, float],
    heading: float,
    time: np.datetime64,
    lon: Array,
    lat: Array,
    source: Array,
) -> Array:
    """Return the signal excess [dB] of sources, shape (n,).

    Args:
        ear: the sonar.
        place: its position (lon, lat) [rad].
        heading: of its array, true [rad].
        time: of the noise.
        lon: longitudes of the sources [rad], shape (n,).
        lat: latitudes of the sources [rad], shape (n,).
        source: source levels [dB], shape (n,).
    """
    way = sphere.offset(*place, lon, lat)
    return np.asarray(_excess(ear.tables(*place, heading, time), *way) + source)


def instantaneous_pod(sonar: Sonar, over: Array) -> Array:
    """Return the probability of instantaneous detection by signal excess [dB], any shape."""
    from scipy import special  # imported here: few cases need it, and it takes a third of a second

    return np.asarray(special.ndtr(over / sonar.fluctuation))
