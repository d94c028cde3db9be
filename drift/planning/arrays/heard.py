"""What an array would hear of particles on each of many ways: the tables and tracks that
kernels.planning.stations takes.
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

# [m] longest part of a particle's relative way in which its signal excess is taken once
NEAR = 1500.0
SAME = 10_000.0  # [m] to which positions are rounded for which losses are looked up


def swarm(tracks: Tracks) -> Swarm:
    """Return particles as the kernel takes them."""
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
    """An array and the particles that it may hear."""

    sea: Sea
    tracks: Tracks
    swarm: Swarm
    tables: Tables
    chances: Array  # of the values of its unknown

    @property
    def sonar(self) -> Sonar:
        """Its sonar."""
        sees = self.sea.tow.sensor.sees
        assert isinstance(sees, Sonar)
        return sees


def hearer(sea: Sea, tracks: Tracks) -> Hearer:
    """Return an array made ready to be placed among particles."""
    sonar = sea.tow.sensor.sees
    assert isinstance(sonar, Sonar)
    offsets, chances = unknown.values(sea.tow.sensor)
    return Hearer(sea, tracks, swarm(tracks), tables(sonar, tracks.time, offsets), chances)


def tables(sonar: Sonar, time: Array, offsets: Array) -> Tables:
    """Return the tables of a sonar for bins whose edges are these times [s since 1970]."""
    ear = Receiver(sonar)
    rays = hearing.even(sonar.losses.bearing, hearing.MOST_RAYS)
    sides, winds = (
        hearing.even(x, hearing.MOST_SIDES) for x in (sonar.gain.bearing, sonar.noise.bearing)
    )
    middles = (0.5 * (time[1:] + time[:-1])).astype("int64").astype("datetime64[s]")
    noise = [
        round_circle(_even(winds), sonar.noise.bearing, ear.noise(moment)) for moment in middles
    ]
    laid = np.stack([ear.laid_out(loss, rays) for loss in sonar.losses.loss])
    ranges = ear.ranges
    return Tables(
        laid.astype(np.float32),
        float(ranges[0]),
        float(ranges[1] - ranges[0]),
        (round_circle(_even(sides), sonar.gain.bearing, ear.gain) - sonar.threshold).astype(
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
    return np.arange(many) * TURN / many


def missed(hearer: Hearer, ways: Ways, share: float, part: float = NEAR) -> Array:
    """Return the probabilities that each way misses each particle, float32 (c, m, factors).

    share: of the range, which the parts of a relative way may be long in which the signal excess is
    taken once; they may be `part` [m] in any case. Of what a way hears, 0.02 costs 0.3 %, and 0.1
    costs 1.5 %.
    """
    time = hearer.tracks.time
    lon, lat = tow_ways.ships_at(hearer.sea, ways, time)
    begin, end = tow_ways.span(hearer.sea, ways)
    listens = (time[:-1] >= begin[:, None] - 1) & (time[1:] <= end[:, None] + 1)
    ahead = np.arctan2(*sphere.offset(lon[:, :-1], lat[:, :-1], lon[:, 1:], lat[:, 1:]))
    middle = (
        lon[:, :-1] + 0.5 * sphere.wrap(lon[:, 1:] - lon[:, :-1]),
        0.5 * (lat[:, 1:] + lat[:, :-1]),
    )
    which, weight = places(hearer.sonar, *middle)
    own = stations.Ways(
        _binary(lon), _binary(lat), ahead.astype(np.float32), listens, which, weight
    )
    return np.asarray(np.exp(stations.missed(hearer.swarm, hearer.tables, own, part, share)))


def places(sonar: Sonar, lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return numbers of the places whose losses hold at positions [rad] (c, e), and their weights
    (c, e, BESIDE).
    """
    which, weight = (
        np.zeros((*lon.shape, BESIDE), np.int32),
        np.zeros((*lon.shape, BESIDE), np.float32),
    )
    weight[..., 0] = 1
    if len(sonar.losses.loss) == 1:
        return which, weight
    at = np.stack([sphere.wrap(lon), lat], axis=-1)
    # Losses change slowly: 10 km away they are the same.
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
    return sphere.to_binary(np.degrees(angle))


def excess_near(hearer: Hearer, lon: Array, lat: Array, within: float) -> Array:
    """Return the highest signal excess [dB] by range from positions [rad] (c,) of a sonar within a
    distance [m] of each.

    A source of 0 dB, whatever the heading and the bearing; (c, rings). Losses are those at any
    place of a square round the position.
    """
    t = hearer.tables
    rings = t.losses.shape[2]
    reach = math.ceil(within / t.between)
    lowest = t.losses.min(axis=1)  # (places, rings): by whatever bearing
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
