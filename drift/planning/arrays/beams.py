"""What each beam of a plan's arrays would hear of particles in each slot: the chances that an
allocation is made of.

Arrays stand or are towed; particles are those on which plans are made
(drift.planning.search.follow). A chance is that of the search's own mathematics
(kernels.planning.beams) over one slot, in which a beam begins as if it had never listened.

What a group of sensors has in common and nobody knows (its `unknown`) is drawn for each particle,
once for all slots and sensors of the group: given its value beams miss a particle independently,
and the mean over particles is that over the unknown too.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse, special

from drift.evidence.sensors import hearing
from drift.evidence.sensors.hearing import Receiver
from drift.evidence.sensors.records import Gain, Listener, Sonar
from drift.planning.arrays import heard
from drift.planning.arrays.records import Chosen
from drift.planning.search.planning_tracks import Tracks
from geo import notation, polyline, sphere
from geo.array import Array, Real
from geo.polyline import Legs
from kernels.planning import beams as kernel
from kernels.planning.beams import Beams, Course
from kernels.planning.stations import Swarm, Tables

PART = 1500.0  # [m] longest part of a relative way in which excess is taken once
LEAST = 1e-6  # chances below it count as none

Tell = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Field:
    """Arrays and the particles among which they listen, at edges of bins of which each lies in one
    slot.
    """

    listeners: tuple[Listener, ...]
    tracks: Tracks
    swarm: Swarm
    slots: Array  # number of each slot's first bin and, last, of all bins (slots + 1,)
    tables: tuple[Tables, ...]  # of each listener
    courses: tuple[Course, ...]
    gains: tuple[Real, ...]  # [dB] (beams, sides) of each listener, less threshold
    offsets: tuple[Real, ...]  # [dB] of each listener's excess (m,)

    @property
    def array(self) -> Array:
        """The number of each beam's array (beams,)."""
        return np.repeat(np.arange(len(self.gains)), [len(gain) for gain in self.gains])


def field(listeners: Sequence[Listener], tracks: Tracks, edges: Array, seed: int) -> Field:
    """Return arrays among particles; edges: of slots, datetime64 (slots + 1,), within the time of
    the tracks.
    """
    slots = notation.epochs(edges).astype(float)
    inner = [np.array(one.legs.time) for one in listeners if one.legs is not None]
    time = np.unique(np.concatenate([tracks.time, slots, *inner]))
    cut = at_edges(tracks, time[(time >= slots[0]) & (time <= slots[-1])])
    turned = [np.ascontiguousarray(x.T) for x in (cut.lon, cut.lat, cut.adrift)]
    swarm = Swarm(
        (cut.time - cut.time[0]).astype(np.float32),
        turned[0],
        turned[1],
        turned[2].astype(np.uint8),
        cut.scenario,
    )
    drawn = _unknowns(listeners, cut.m, seed)
    tables, courses, gains = [], [], []
    for one in listeners:
        sonar = _sonar(one)
        tables.append(heard.tables(sonar, cut.time, np.zeros(1)))
        courses.append(course(one, cut.time))
        gains.append(_gains(sonar))
    return Field(
        tuple(listeners),
        cut,
        swarm,
        np.searchsorted(cut.time, slots),
        tuple(tables),
        tuple(courses),
        tuple(gains),
        tuple(drawn[one.sensor.group] * _sonar(one).unknown for one in listeners),
    )


def at_edges(tracks: Tracks, time: Array) -> Tracks:
    """Return the same tracks at times [s since 1970] within theirs, straight in between; velocities
    are left out.
    """
    k = np.clip(np.searchsorted(tracks.time, time, side="right") - 1, 0, tracks.bins - 1)
    share = ((time - tracks.time[k]) / (tracks.time[k + 1] - tracks.time[k]))[:, None]
    lon, lat = (
        (v[k] + np.round(share * (v[k + 1] - v[k]).astype(np.float64)).astype(np.int64)).astype(
            np.int32
        )  # wraps as it should
        for v in (tracks.lon, tracks.lat)
    )
    # Inside a bin it can be heard where it can be at both of its ends.
    there = np.where(
        share <= 0,
        tracks.adrift[k],
        np.where(share >= 1, tracks.adrift[k + 1], tracks.adrift[k] & tracks.adrift[k + 1]),
    )
    return replace(tracks, time=time, lon=lon, lat=lat, adrift=there, flow=None)


def _sonar(listener: Listener) -> Sonar:
    sees = listener.sensor.sees
    assert isinstance(sees, Sonar)
    return sees


def _gains(sonar: Sonar) -> Real:
    """Return the gains of all beams [dB] by relative bearing, evenly round from ahead, less the
    threshold (beams, sides).
    """
    sides = hearing.even(sonar.gain.bearing, hearing.MOST_SIDES)
    at = np.arange(sides) * hearing.TURN / sides
    every = [
        hearing.round_circle(at, sonar.gain.bearing, Receiver(sonar, (k,)).gain)
        for k in range(len(sonar.gain.beams))
    ]
    return (np.stack(every) - sonar.threshold).astype(np.float32)


def _unknowns(listeners: Sequence[Listener], m: int, seed: int) -> dict[str, Real]:
    """Return of each group standard normal numbers, one a particle: every m-th part of the
    distribution has one.
    """
    found = {}
    for number, group in enumerate(dict.fromkeys(one.sensor.group for one in listeners)):
        order = np.random.default_rng((seed, number)).permutation(m)
        found[group] = np.asarray(special.ndtri((order + 0.5) / m), float)
    return found


def course(listener: Listener, time: Array) -> Course:
    """Return where an array is at times [s since 1970] (e,), and when it listens."""
    sonar, sensor, legs = _sonar(listener), listener.sensor, listener.legs
    if legs is None:
        assert sensor.place is not None
        lon, lat = (np.full(len(time), math.radians(x)) for x in sensor.place)
        heading, listens = np.full(len(time) - 1, sensor.heading), np.ones(len(time) - 1, bool)
    else:
        lon, lat, heading, listens = _towed(legs, time)
    middle = lon[:-1] + 0.5 * sphere.wrap(lon[1:] - lon[:-1]), 0.5 * (lat[1:] + lat[:-1])
    which, weight = heard.places(sonar, middle[0][None], middle[1][None])
    binary = (sphere.to_binary(np.degrees(angle)) for angle in (lon, lat))
    return Course(*binary, heading, listens, which[0], weight[0])


def _towed(legs: Legs, time: Array) -> tuple[Array, Array, Array, Array]:
    """Return lon, lat [rad] at times (e,), and of each bin the course [rad] and whether it listens;
    bins end at vertices.
    """
    first, last = legs.time[0], legs.time[-1]
    places = np.radians([polyline.position_at(legs, float(np.clip(t, first, last))) for t in time])
    lon, lat = sphere.wrap(places[:, 0]), places[:, 1]
    heading = np.arctan2(*sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:]))
    middle = 0.5 * (time[1:] + time[:-1])
    leg = np.clip(np.searchsorted(legs.time, middle, side="right") - 1, 0, len(legs.searching) - 1)
    return lon, lat, heading, (middle > first) & (middle < last) & np.array(legs.searching)[leg]


def chances(field: Field, tell: Tell = lambda share: None) -> list[sparse.csc_array]:
    """Return of each slot the chance that each beam hears each particle, (particles, beams)."""
    made, slots = [], len(field.slots) - 1
    bins = len(field.swarm.time) - 1
    rows = [
        np.repeat(np.arange(len(gain), dtype=np.int32), bins).reshape(-1, bins)
        for gain in field.gains
    ]
    for slot in range(slots):
        span = int(field.slots[slot]), int(field.slots[slot + 1])
        parts = []
        for k, gain in enumerate(field.gains):
            log = _missed(field, k, Beams(gain, rows[k]), span)
            chance = -np.expm1(log)
            chance[chance < LEAST] = 0
            parts.append(sparse.csr_array(chance))
        made.append(sparse.vstack(parts, format="csr").T)
        tell((slot + 1) / slots)
    return made


def _missed(field: Field, number: int, beams: Beams, span: tuple[int, int]) -> Real:
    return np.asarray(
        kernel.missed(
            field.swarm,
            field.tables[number],
            field.courses[number],
            beams,
            span,
            field.offsets[number],
            PART,
        )
    )


def carried(field: Field, chosen: Chosen) -> Real:
    """Return the chance that each particle is heard at least once by the beams chosen of each slot,
    (m,).

    Here an array's fluctuation is carried from slot to slot, and is the same for all of its beams,
    of which the best is listened to: that is how a watch that processes these beams is computed by
    a run.
    """
    whole = 0, len(field.swarm.time) - 1
    log = np.zeros(len(field.swarm.scenario))
    for number, (first, gain) in enumerate(zip(_firsts(field), field.gains, strict=True)):
        own = [
            tuple(b - first for b in beams if first <= b < first + len(gain)) for beams in chosen
        ]
        kinds = [kind for kind in dict.fromkeys(own) if kind]
        if not kinds:
            continue
        gains = np.stack([gain[list(kind)].max(axis=0) for kind in kinds])
        by_slot = np.array([kinds.index(kind) if kind else -1 for kind in own], np.int32)
        rows = np.repeat(by_slot, np.diff(field.slots))[None]
        log += _missed(field, number, Beams(gains, rows), whole)[0]
    return -np.expm1(log)


def _firsts(field: Field) -> list[int]:
    """Return the number of each array's first beam."""
    return [sum(len(gain) for gain in field.gains[:number]) for number in range(len(field.gains))]


def looks(listener: Listener) -> list[str]:
    """Return what an array's beams are called: relative bearings (R), and true ones (T) of one that
    stands; both sides of a line.
    """
    sonar = _sonar(listener)
    stands = listener.legs is None and not listener.tow
    return [
        _look(sonar.gain, k, listener.sensor.heading if stands else None)
        for k in range(len(sonar.gain.beams))
    ]


def _look(gain: Gain, beam: int, heading: float | None) -> str:
    steered = float(gain.steered[beam])
    if math.isnan(steered):
        steered = float(gain.bearing[np.argmax(gain.beams[beam])])
    ends = abs(math.sin(steered)) < 1e-6
    sides = [steered] if ends or not gain.mirrored else [steered, -steered]
    relative = f"{_degrees(steered)}R"
    if heading is None:
        return relative
    return f"{relative} {'/'.join(_degrees(heading + side) for side in sides)}T"


def _degrees(angle: float) -> str:
    return f"{round(math.degrees(angle)) % 360:03d}"
