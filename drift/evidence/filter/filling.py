"""Repopulation of particles that a contact rules out: the bulk repopulation of Borovies 2007.

Source: Particle filter based tracking in a detection sparse discrete event simulation environment,
III.B.2. It is for targets that keep a course or act. If a contact leaves fewer than the share
`bulk` of the particles, all others are placed at possible positions of the contact, with any course
and speed up to `fastest`. Earlier knowledge of the target is reduced to the estimate at the contact
before. Method "position" gives a particle more weight, the nearer the speed that it needs from the
earlier estimate is to the estimated speed. Method "course" sends half of the particles straight
from there, all with equal weight. Method "combined" does both. This is a heuristic and not
Bayesian: docs/searches.md explains the weights. kernels.tracking.clouds does the same for a
tracker's clouds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drift.engine.motion.ensemble_spec import EnsembleSpec
from drift.engine.motion.scenario import Scenario
from drift.engine.motion.steering.itinerary import Acts, Course, Itinerary
from drift.engine.particles import resample, weights
from drift.engine.particles.ensemble import NEVER, Layout
from drift.evidence.filter import contacts as contact_laws
from drift.evidence.filter.detection import sensor_path
from drift.evidence.filter.records import Contact, Resampling
from geo import sphere
from geo.array import Array
from kernels.maths import noise
from kernels.maths.noise import Purpose
from kernels.step import coast
from kernels.step.coast import DeviceCoast

# least weight, as a share of the fastest speed: a tenth of a knot where that is 32
LEAST = 0.1 / 32
FLOOR = -200.0  # log likelihood of particles that a contact rules out, which may be all of them
TRIES = 64  # positions drawn for a particle until one is in water; else it stays ruled out


class Estimate(NamedTuple):
    """Estimated position and speed of a target."""

    lon: float  # [rad] of the weighted mean position
    lat: float
    speed: float  # [m/s] weighted mean of the particles' speeds
    time: int  # [s after start]


@dataclass(frozen=True)
class ParticleCloud:
    """Positions, speeds and weights of particles at a time, (n,) each."""

    lon: Array  # [rad]
    lat: Array
    speed: Array  # [m/s]
    log_weight: Array


@dataclass(frozen=True)
class Replacement:
    """Repopulated particles: their slots and new state, and the log weights of all particles."""

    slots: Array  # int64 (m,)
    lon: Array  # [rad] (m,)
    lat: Array
    course: Array  # [rad] (m,)
    speed: Array  # [m/s] (m,)
    change: Array  # int64 [s after start] (m,): next change of course, or next act
    # bool (m,): whether `change` applies to all of them; else only to those that had stopped, since
    # exponential waiting times have no memory
    fresh: Array
    log_weight: Array  # float64 (n,)


def bounds_position(contact: Contact) -> bool:
    """Return whether a contact is certainly of the object and bounds its position.

    Only such contacts rule out and repopulate particles.
    """
    sure = (
        contact.belief == 1
        and contact.false_density == 0
        and contact.drifter is None
        and contact.zones is None
    )
    return sure and (contact.kind != "bearing" or math.isfinite(contact.far))


def _estimate_target(cloud: ParticleCloud, time: int) -> Estimate:
    """Return the estimated position and speed of the target from its particles.

    time: of the particles [s after start].
    """
    share = weights.relative(cloud.log_weight)
    x, y, z = (share @ axis for axis in sphere.vector(cloud.lon, cloud.lat))
    return Estimate(
        math.atan2(y, x),
        math.atan2(z, math.hypot(x, y)),
        float(share @ cloud.speed / share.sum()),
        time,
    )


class BulkRepopulation:
    """Repopulation of particles at one contact after the other."""

    def __init__(
        self,
        rule: Resampling,
        seed: int,
        changes: Sequence[float | tuple[float, float]],
        shore: DeviceCoast | None,
    ) -> None:
        """Set up the repopulation of a run.

        Args:
            rule: method, share and speed.
            seed: of the run.
            changes: by scenario, mean time between changes of course [s] (0: none), or the shortest
                and longest time between acts.
            shore: land, on which no particle is placed; None: anywhere.
        """
        self._rule, self._seed, self._changes, self._shore = rule, seed, changes, shore
        self._last: Estimate | None = None  # at the previous contact

    def anew(
        self,
        contact: Contact,
        number: int,
        time: int,
        cloud: ParticleCloud,
        contradicted: Array,
        layout: Layout,
    ) -> Replacement | None:
        """Return the particles to repopulate after a contact; None if enough have survived.

        Particles whose new position would be on land are not placed.

        Args:
            contact: one for which `bounded` is true.
            number: of the contact in the case.
            time: of the contact [s after start].
            cloud: particles after the contact.
            contradicted: particles that the contact rules out, bool (n,).
            layout: slots by scenario.
        """
        share, left = weights.relative(cloud.log_weight), ~contradicted
        scenarios = list(zip(layout.bounds[:-1], layout.bounds[1:], strict=True))
        for first, last in scenarios:
            left[first:last] &= resample.survivors(share[first:last])
        placed = None
        if left.sum() < self._rule.bulk * len(left):
            placed = self._draw_replacements(contact, number, time, cloud, left, scenarios)
        if placed is None or placed.slots.size:
            self._last = _estimate_target(
                cloud if placed is None else _replace_particles(cloud, placed), time
            )
        return placed

    def _draw_replacements(
        self,
        contact: Contact,
        number: int,
        time: int,
        cloud: ParticleCloud,
        survivors: Array,
        scenarios: list[tuple[int, int]],
    ) -> Replacement:
        log_weight, parts = np.array(cloud.log_weight, np.float64), []
        for scenario, (first, last) in enumerate(scenarios):
            own, rng = (
                cloud.log_weight[first:last],
                noise.generator(self._seed, Purpose.FILLING, number, (scenario, 0)),
            )
            out = np.flatnonzero(~survivors[first:last])
            lon, lat, wet = self._positions_in_water(contact, out.size, rng)
            course, speed, need = self._draw_motion(contact, time, lon, lat, rng)
            law = self._changes[scenario]
            change = time + _draw_waits(law, out.size, rng)
            fresh = np.full(out.size, isinstance(law, tuple))
            out, moving = (
                out[wet],
                [values[wet] for values in (lon, lat, course, speed, change, fresh)],
            )
            weight = np.where(survivors[first:last], weights.relative(own), 0.0)
            mean = weight.sum() / max(survivors[first:last].sum(), 1) or 1.0
            weight[out] = mean
            if need is not None and self._last is not None and self._rule.method != "course":
                high, pace = self._rule.fastest, self._last.speed
                least = high * LEAST
                weight[survivors[first:last]] = max(high - pace, least)
                window = np.where(need < pace, need - (2 * pace - high), high - need)
                weight[out] = np.maximum(window[wet], least)
            if weight.sum() > 0:
                total = own.max() + math.log(weights.relative(own).sum())
                with np.errstate(divide="ignore"):
                    log_weight[first:last] = np.log(weight / weight.sum()) + total
            parts.append((first + out, *moving))
        slots, lon, lat, course, speed, change, fresh = (
            np.concatenate(column) for column in zip(*parts, strict=True)
        )
        return Replacement(slots, lon, lat, course, speed, change, fresh, log_weight)

    def _draw_motion(
        self, contact: Contact, time: int, lon: Array, lat: Array, rng: np.random.Generator
    ) -> tuple[Array, Array, Array | None]:
        """Return courses [rad] and speeds [m/s], and the speeds needed from the last estimate.

        The needed speeds are None without an earlier estimate.
        """
        high, n = self._rule.fastest, lon.size
        course, speed = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, high, n)
        if contact.course_std > 0:
            course = contact.course + contact.course_std * rng.standard_normal(n)
        if contact.speed_std > 0:
            speed = np.clip(contact.speed + contact.speed_std * rng.standard_normal(n), 0, high)
        straight = rng.random(n) < 0.5
        last = self._last
        # two contacts at the same time give no speed
        if last is None or time <= last.time:
            return course % (2 * np.pi), speed, None
        need = sphere.distance(last.lon, last.lat, lon, lat) / (time - last.time)
        if self._rule.method != "position":
            east, north = sphere.offset(lon, lat, last.lon, last.lat)  # of where it comes from
            course = np.where(straight, np.arctan2(-east, -north), course)
            speed = np.where(straight, np.minimum(need, high), speed)
        return course % (2 * np.pi), speed, need

    def _positions_in_water(
        self, contact: Contact, n: int, rng: np.random.Generator
    ) -> tuple[Array, Array, Array]:
        """Return n possible positions (lon, lat) [rad] of a contact, and which are in water."""
        lon, lat, wet = np.zeros(n), np.zeros(n), np.zeros(n, bool)
        for _ in range(TRIES):
            dry = np.flatnonzero(~wet)
            if not dry.size:
                break
            lon[dry], lat[dry] = draw_positions(contact, dry.size, rng)
            wet[dry] = (
                True
                if self._shore is None
                else coast.wet(self._shore, *(_binary(x[dry]) for x in (lon, lat)))
            )
        return lon, lat, wet


def _draw_waits(law: float | tuple[float, float], n: int, rng: np.random.Generator) -> Array:
    """Return times to the next change of course [s], int64 (n,).

    They are exponential with a mean (0: never), or uniform between two times.
    """
    if isinstance(law, tuple):
        return np.rint(rng.uniform(*law, n)).astype(np.int64)
    if law == 0:
        return np.full(n, NEVER, np.int64)
    return np.minimum(np.maximum(rng.exponential(law, n), 1), NEVER).astype(np.int64)


def bulk_repopulation_of(
    rule: Resampling, spec: EnsembleSpec, shore: DeviceCoast | None
) -> BulkRepopulation:
    """Return the repopulation for a run; all of its scenarios must keep a course or act."""
    itineraries = [scenario.itinerary for scenario in spec.scenarios]
    changes = [
        phase.between if isinstance(phase, Acts) else phase.change
        for own in itineraries
        if own
        for phase in own.phases
        if isinstance(phase, Course | Acts)
    ]
    minds_land = any(own and own.land != "ignore" for own in itineraries)
    return BulkRepopulation(rule, spec.seed, changes, shore if minds_land else None)


def why_not_repopulated(
    rule: Resampling,
    scenarios: Sequence[Scenario],
    contacts: Sequence[Contact],
    start: np.datetime64,
) -> str:
    """Return an error message if contacts of a case cannot repopulate particles, else "".

    Args:
        rule: of the case.
        scenarios: of the case.
        contacts: of the case.
        start: of the run.
    """
    what = f'resampling: method "{rule.method}" repopulates targets that keep a course, at possible positions of a contact'
    for scenario in scenarios:
        own = scenario.itinerary
        if own is None or own.distress is not None or not _keeps_course(own):
            return (
                f'{what}, and scenario "{scenario.name}" drifts, follows way points, loiters or ends; give each scenario one [[scenario.phase]] '
                'with a course or a behaviour, no end and no distress, or method = "systematic"'
            )
    for contact in contacts:
        if bounds_position(contact) and contact.time == start:
            return f'{what}, and contact "{contact.name}" is at the start of the run: give it as the scenarios\' position, or start earlier'
    if not any(bounds_position(contact) for contact in contacts):
        return (
            f"{what}, and no contact of the case allows it: give a [[contact]] without belief and false_density (a bearing with far), or method = "
            '"duplicates"'
        )
    return ""


def _keeps_course(itinerary: Itinerary) -> bool:
    """Return whether a target keeps or changes a course, or acts, to the end of the run."""
    first = itinerary.phases[0]
    endless = isinstance(first, Course | Acts) and first.until is None and first.lasting == math.inf
    return len(itinerary.phases) == 1 and endless


def _replace_particles(cloud: ParticleCloud, placed: Replacement) -> ParticleCloud:
    """Return a cloud with the repopulated particles."""
    columns = {}
    for name in ("lon", "lat", "speed"):
        columns[name] = np.array(getattr(cloud, name), np.float64)
        columns[name][placed.slots] = getattr(placed, name)
    return ParticleCloud(**columns, log_weight=placed.log_weight)


def _binary(angle: Array) -> Array:
    return sphere.to_binary(np.degrees(angle))


def draw_positions(contact: Contact, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return n possible positions (lon, lat) [rad] of a contact.

    Positions of a bearing are uniform in range between its limits.
    """
    if contact.kind == "position":
        which = rng.choice(len(contact.fixes), n, p=[fix.share for fix in contact.fixes])
        lon, lat = np.radians([(fix.lon, fix.lat) for fix in contact.fixes])[which].T
        along, across = (
            contact.major * rng.standard_normal(n),
            contact.minor * rng.standard_normal(n),
        )
        c, s = math.cos(contact.orientation), math.sin(contact.orientation)
        return sphere.destination(lon, lat, along * s + across * c, along * c - across * s)
    if contact.kind == "area":
        return _positions_in_area(contact, n, rng)
    assert contact.sensor is not None
    if contact.kind == "range":
        bearing = rng.uniform(0, 2 * np.pi, n)
        far = np.abs(contact.range + contact.range_std * rng.standard_normal(n))
    else:
        bearing, far = _draw_bearings(contact, n, rng), rng.uniform(contact.near, contact.far, n)
    lon, lat = np.radians(contact.sensor)
    return sphere.destination(lon, lat, far * np.sin(bearing), far * np.cos(bearing))


def _draw_bearings(contact: Contact, n: int, rng: np.random.Generator) -> Array:
    """Return n possible bearings [rad] of a contact.

    If the array cannot tell port from starboard, about half are mirrored.
    """
    bearing = np.full(n, contact.bearing)
    if contact.heard is not None and contact.heard.mirrored:
        bearing = np.where(
            rng.random(n) < 0.5,
            bearing,
            contact_laws.mirrored_bearing(contact.bearing, contact.heard.heading),
        )
    if contact.wedge > 0:
        return bearing + contact.wedge * (rng.random(n) - 0.5)
    return np.asarray(bearing + contact_laws.bearing_std(contact, bearing) * rng.standard_normal(n))


def _positions_in_area(contact: Contact, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return n positions (lon, lat) [rad], uniform in the area of a contact."""
    assert contact.area is not None
    lon, lat, inside = np.zeros(n), np.zeros(n), np.zeros(n, bool)
    corners = np.radians(np.array(contact.area.ring))
    # edges are great circles, which may reach beyond the corners
    x, y = sphere.track(corners[:, 0], corners[:, 1], sensor_path.EDGE)
    (west, east), (south, north) = (
        (float(edge.min()), float(edge.max())) for edge in (np.unwrap(x), y)
    )
    while not inside.all():
        out = np.flatnonzero(~inside)
        lon[out] = rng.uniform(west, east, out.size)
        lat[out] = np.arcsin(rng.uniform(math.sin(south), math.sin(north), out.size))
        inside[out] = contact_laws.is_in_area(contact.area, _binary(lon[out]), _binary(lat[out]))
    return lon, lat
