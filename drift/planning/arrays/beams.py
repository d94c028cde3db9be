"""Detection probabilities of single beams: input of the beam allocation.

For each slot, `chances` gives the probability that each beam of each array hears each planning
particle (drift.planning.search.follow). Arrays are fixed or towed. The detection model is that of
the search (kernels.planning.beams); each slot starts as if the beam had never listened before.

The sensors of a group share an unknown bias (`unknown`). One value is drawn for each particle and
used for all slots and sensors of the group. Given that value, beams miss a particle independently,
and the mean over particles also averages over the unknown.
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

PART = 1500.0  # [m] longest part of the relative track with one value of signal excess
LEAST = 1e-6  # lower probabilities are set to 0

Tell = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Field:
    """Arrays and the particles that they may hear.

    Bins of time are short enough that each one lies inside one slot.
    """

    listeners: tuple[Listener, ...]
    tracks: Tracks
    swarm: Swarm
    slots: Array  # index of each slot's first bin, then the number of bins (slots + 1,)
    tables: tuple[Tables, ...]  # of each listener
    courses: tuple[Course, ...]
    gains: tuple[Real, ...]  # [dB] gain less threshold (beams, sides), of each listener
    offsets: tuple[Real, ...]  # [dB] unknown part of each listener's signal excess (m,)

    @property
    def array(self) -> Array:
        """The index of each beam's array, shape (beams,)."""
        return np.repeat(np.arange(len(self.gains)), [len(gain) for gain in self.gains])


def field(listeners: Sequence[Listener], tracks: Tracks, edges: Array, seed: int) -> Field:
    """Return arrays and particles, prepared for `chances` and `carried`.

    Args:
        listeners: fixed and towed arrays with their sensors.
        tracks: planning particles; their weights sum to 1.
        edges: slot edges, datetime64, shape (slots + 1,), within the time of the tracks.
        seed: of the draws of each group's unknown.
    """
    slots = notation.epochs(edges).astype(float)
    inner = [np.array(one.legs.time) for one in listeners if one.legs is not None]
    time = np.unique(np.concatenate([tracks.time, slots, *inner]))
    resampled = at_edges(tracks, time[(time >= slots[0]) & (time <= slots[-1])])
    by_particle = [
        np.ascontiguousarray(x.T) for x in (resampled.lon, resampled.lat, resampled.adrift)
    ]
    swarm = Swarm(
        (resampled.time - resampled.time[0]).astype(np.float32),
        by_particle[0],
        by_particle[1],
        by_particle[2].astype(np.uint8),
        resampled.scenario,
    )
    drawn = _unknowns(listeners, resampled.m, seed)
    tables, courses, gains = [], [], []
    for one in listeners:
        sonar = _sonar(one)
        tables.append(heard.tables(sonar, resampled.time, np.zeros(1)))
        courses.append(_course(one, resampled.time))
        gains.append(_gains(sonar))
    return Field(
        tuple(listeners),
        resampled,
        swarm,
        np.searchsorted(resampled.time, slots),
        tuple(tables),
        tuple(courses),
        tuple(gains),
        tuple(drawn[one.sensor.group] * _sonar(one).unknown for one in listeners),
    )


def at_edges(tracks: Tracks, time: Array) -> Tracks:
    """Return tracks interpolated linearly to other times; velocities are dropped.

    Args:
        tracks: particle tracks.
        time: [s since 1970], shape (e,), within the time of the tracks.
    """
    k = np.clip(np.searchsorted(tracks.time, time, side="right") - 1, 0, tracks.bins - 1)
    share = ((time - tracks.time[k]) / (tracks.time[k + 1] - tracks.time[k]))[:, None]
    lon, lat = (
        (v[k] + np.round(share * (v[k + 1] - v[k]).astype(np.float64)).astype(np.int64)).astype(
            np.int32
        )  # overflow wraps at the date line, as intended
        for v in (tracks.lon, tracks.lat)
    )
    # Inside a bin a particle is afloat only if it is at both ends of the bin.
    adrift = np.where(
        share <= 0,
        tracks.adrift[k],
        np.where(share >= 1, tracks.adrift[k + 1], tracks.adrift[k] & tracks.adrift[k + 1]),
    )
    return replace(tracks, time=time, lon=lon, lat=lat, adrift=adrift, flow=None)


def _sonar(listener: Listener) -> Sonar:
    """Return the sonar of an array."""
    sees = listener.sensor.sees
    assert isinstance(sees, Sonar)
    return sees


def _gains(sonar: Sonar) -> Real:
    """Return beam gains less the detection threshold [dB], shape (beams, sides).

    Sides are relative bearings at equal steps, the first one ahead.
    """
    sides = hearing.even(sonar.gain.bearing, hearing.MOST_SIDES)
    bearing = np.arange(sides) * hearing.TURN / sides
    gains = [
        hearing.round_circle(bearing, sonar.gain.bearing, Receiver(sonar, (k,)).gain)
        for k in range(len(sonar.gain.beams))
    ]
    return (np.stack(gains) - sonar.threshold).astype(np.float32)


def _unknowns(listeners: Sequence[Listener], m: int, seed: int) -> dict[str, Real]:
    """Return standard normal numbers for each group, one per particle.

    The sample is stratified: each of the m equally probable intervals holds one number.
    """
    unknowns = {}
    for number, group in enumerate(dict.fromkeys(one.sensor.group for one in listeners)):
        order = np.random.default_rng((seed, number)).permutation(m)
        unknowns[group] = np.asarray(special.ndtri((order + 0.5) / m), float)
    return unknowns


def _course(listener: Listener, time: Array) -> Course:
    """Return an array's position and heading, and the bins in which it listens.

    Args:
        listener: a fixed or towed array.
        time: bin edges [s since 1970], shape (e,).
    """
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
    """Return the course of a towed array by bin; its vertices must be bin edges.

    Longitude and latitude [rad] have the shape (e,); heading [rad] and whether the array listens
    have the shape (e - 1,).
    """
    first, last = legs.time[0], legs.time[-1]
    places = np.radians([polyline.position_at(legs, float(np.clip(t, first, last))) for t in time])
    lon, lat = sphere.wrap(places[:, 0]), places[:, 1]
    heading = np.arctan2(*sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:]))
    middle = 0.5 * (time[1:] + time[:-1])
    leg = np.clip(np.searchsorted(legs.time, middle, side="right") - 1, 0, len(legs.searching) - 1)
    return lon, lat, heading, (middle > first) & (middle < last) & np.array(legs.searching)[leg]


def chances(field: Field, tell: Tell = lambda share: None) -> list[sparse.csc_array]:
    """Return the probability that each beam hears each particle, for each slot.

    Args:
        field: arrays and particles.
        tell: callback that receives the progress, 0 to 1.

    Returns:
        One sparse table for each slot, shape (particles, beams); probabilities below `LEAST` are 0.
    """
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
    """Return the log probability that one array's beams miss each particle, (rows, m)."""
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
    """Return the probability that each particle is heard at least once, shape (m,).

    Unlike `chances`, this carries an array's fluctuation from slot to slot. All beams of an array
    share that fluctuation, and only the best processed beam counts. A simulated watch with these
    beams is computed in the same way.

    Args:
        field: arrays and particles.
        chosen: the beams that are processed in each slot.
    """
    all_bins = 0, len(field.swarm.time) - 1
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
        log += _missed(field, number, Beams(gains, rows), all_bins)[0]
    return -np.expm1(log)


def _firsts(field: Field) -> list[int]:
    """Return the index of each array's first beam."""
    return [sum(len(gain) for gain in field.gains[:number]) for number in range(len(field.gains))]


def looks(listener: Listener) -> list[str]:
    """Return a name for each beam of an array, made of the bearings in which it looks.

    R marks a relative bearing. Fixed arrays also get the true bearing (T). A beam of a line array
    has two true bearings, one on each side.
    """
    sonar = _sonar(listener)
    stands = listener.legs is None and not listener.tow
    return [
        _look(sonar.gain, k, listener.sensor.heading if stands else None)
        for k in range(len(sonar.gain.beams))
    ]


def _look(gain: Gain, beam: int, heading: float | None) -> str:
    """Return the name of one beam; heading [rad] is None for a towed array."""
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
    """Return an angle [rad] as three digits of whole degrees."""
    return f"{round(math.degrees(angle)) % 360:03d}"
