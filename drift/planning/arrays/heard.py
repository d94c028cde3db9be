"""Probability that a towed array misses each particle, for many candidate tracks at once.

This module builds the sonar tables and ship tracks that kernels.planning.stations works on.
"""

import math
from dataclasses import dataclass

import numpy as np

from drift.evidence.sensors import hearing, losses, unknown
from drift.evidence.sensors.hearing import TURN, Receiver, round_circle
from drift.evidence.sensors.records import Sonar
from drift.planning.arrays import ways as tow_ways
from drift.planning.arrays.ways import Sea, Ways
from drift.planning.search.planning_tracks import Tracks
from geo import sphere
from geo.array import Array
from kernels.planning import stations
from kernels.planning.stations import BESIDE, Swarm, Tables

# [m] longest part of a particle's relative track with one value of signal excess
NEAR = 1500.0
SAME = 10_000.0  # [m] positions are rounded to this before losses are looked up


def swarm(tracks: Tracks) -> Swarm:
    """Return planning particles in the layout that the kernels take."""
    turned = (np.ascontiguousarray(x.T) for x in (tracks.lon, tracks.lat, tracks.adrift))
    lon, lat, there = turned
    return Swarm(
        (tracks.time - tracks.time[0]).astype(np.float32),
        lon,
        lat,
        there.astype(np.uint8),
        tracks.scenario,
    )


@dataclass(frozen=True, eq=False)
class Hearer:
    """A towed array, the particles that it may hear and its sonar tables."""

    sea: Sea
    tracks: Tracks
    swarm: Swarm
    tables: Tables
    chances: Array  # probabilities of the values of the array's unknown (factors,)

    @property
    def sonar(self) -> Sonar:
        """The array's sonar."""
        sees = self.sea.tow.sensor.sees
        assert isinstance(sees, Sonar)
        return sees


def hearer(sea: Sea, tracks: Tracks) -> Hearer:
    """Return an array with the tables that `missed` needs for these particles."""
    sonar = sea.tow.sensor.sees
    assert isinstance(sonar, Sonar)
    offsets, chances = unknown.values(sea.tow.sensor)
    return Hearer(sea, tracks, swarm(tracks), tables(sonar, tracks.time, offsets), chances)


def tables(sonar: Sonar, time: Array, offsets: Array) -> Tables:
    """Return the tables of a sonar for the kernels.

    Args:
        sonar: the receiver and its environment.
        time: bin edges [s since 1970], shape (e,).
        offsets: values of the sonar's unknown [dB], shape (factors,).
    """
    receiver = Receiver(sonar)
    rays = hearing.even(sonar.losses.bearing, hearing.MOST_RAYS)
    sides, winds = (
        hearing.even(x, hearing.MOST_SIDES) for x in (sonar.gain.bearing, sonar.noise.bearing)
    )
    middles = (0.5 * (time[1:] + time[:-1])).astype("int64").astype("datetime64[s]")
    noise = [
        round_circle(_even(winds), sonar.noise.bearing, receiver.noise(moment))
        for moment in middles
    ]
    losses_by_ray = np.stack([receiver.laid_out(loss, rays) for loss in sonar.losses.loss])
    ranges = receiver.ranges
    return Tables(
        losses_by_ray.astype(np.float32),
        float(ranges[0]),
        float(ranges[1] - ranges[0]),
        (round_circle(_even(sides), sonar.gain.bearing, receiver.gain) - sonar.threshold).astype(
            np.float32
        ),
        np.array(noise, np.float32),
        sonar.levels.level,
        sonar.levels.speed.astype(np.float32),
        sonar.fluctuation,
        sonar.jump_rate,
        offsets.astype(np.float32),
    )


def _even(many: int) -> Array:
    """Return bearings [rad] at equal steps around the circle."""
    return np.arange(many) * TURN / many


def missed(hearer: Hearer, ways: Ways, share: float, part: float = NEAR) -> Array:
    """Return the probability that each way misses each particle, float32 (c, m, factors).

    Args:
        hearer: the array and the particles.
        ways: candidate ways (c).
        share: longest part of the relative track with one value of signal excess, as a share of the
            range. 0.02 costs 0.3 % of the heard weight, 0.1 costs 1.5 %.
        part: the same limit as a distance [m]; the longer of both limits holds.
    """
    time = hearer.tracks.time
    lon, lat = tow_ways.ships_at(hearer.sea, ways, time)
    begin, end = tow_ways.span(hearer.sea, ways)
    listens = (time[:-1] >= begin[:, None] - 1) & (time[1:] <= end[:, None] + 1)
    heading = np.arctan2(*sphere.offset(lon[:, :-1], lat[:, :-1], lon[:, 1:], lat[:, 1:]))
    middle = (
        lon[:, :-1] + 0.5 * sphere.wrap(lon[:, 1:] - lon[:, :-1]),
        0.5 * (lat[:, 1:] + lat[:, :-1]),
    )
    which, weight = places(hearer.sonar, *middle)
    own = stations.Ways(
        _binary(lon), _binary(lat), heading.astype(np.float32), listens, which, weight
    )
    return np.asarray(np.exp(stations.missed(hearer.swarm, hearer.tables, own, part, share)))


def places(sonar: Sonar, lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return which tables of transmission loss hold at positions, and with which weights.

    Args:
        sonar: the receiver and its environment.
        lon: longitude [rad], shape (c, e).
        lat: latitude [rad], shape (c, e).

    Returns:
        Indices and weights of the tables, each of shape (c, e, BESIDE).
    """
    which, weight = (
        np.zeros((*lon.shape, BESIDE), np.int32),
        np.zeros((*lon.shape, BESIDE), np.float32),
    )
    weight[..., 0] = 1
    if len(sonar.losses.loss) == 1:
        return which, weight
    at = np.stack([sphere.wrap(lon), lat], axis=-1)
    # Losses change slowly: within 10 km one lookup is enough.
    coarse, back = np.unique(
        np.rint(at * sphere.RADIUS / SAME).reshape(-1, 2), axis=0, return_inverse=True
    )
    near = np.zeros((len(coarse), BESIDE), np.int32)
    share = np.zeros((len(coarse), BESIDE), np.float32)
    for k, (x, y) in enumerate(coarse * SAME / sphere.RADIUS):
        some, own = losses.weights(sonar.losses, float(x), float(y))
        near[k, : len(some)], share[k, : len(some)] = some, own
    return near[back.ravel()].reshape(which.shape), share[back.ravel()].reshape(weight.shape)


def _binary(angle: Array) -> Array:
    """Return an angle [rad] as a binary angle."""
    return sphere.to_binary(np.degrees(angle))


def excess_near(hearer: Hearer, lon: Array, lat: Array, within: float) -> Array:
    """Return an upper bound of signal excess [dB] by range, shape (c, rings).

    The bound holds for a source of 0 dB and for a sonar anywhere near a position, on any heading
    and bearing. It uses the lowest loss among the corners and the centre of a square around the
    position.

    Args:
        hearer: the array and the particles.
        lon: longitude of the positions [rad], shape (c,).
        lat: latitude of the positions [rad], shape (c,).
        within: largest distance of the sonar from the position [m].
    """
    t = hearer.tables
    rings = t.losses.shape[2]
    reach = math.ceil(within / t.between)
    lowest = t.losses.min(axis=1)  # (places, rings), over all bearings
    best = t.gains.max() - t.noise.min()
    cut = np.stack(
        [np.min(lowest[:, max(k - reach, 0) : k + reach + 1], axis=1) for k in range(rings)], axis=1
    )
    if len(cut) == 1:
        return np.repeat(best - cut, len(lon), axis=0)
    some = []
    for x, y in zip(lon, lat, strict=True):
        corners = [(0.0, 0.0), *((i * within, j * within) for i in (-1, 1) for j in (-1, 1))]
        near = {
            int(k)
            for east, north in corners
            for k in losses.weights(
                hearer.sonar.losses, *map(float, sphere.destination(x, y, east, north))
            )[0]
        }
        some.append(best - cut[sorted(near)].min(axis=0))
    return np.array(some)
