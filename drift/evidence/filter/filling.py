"""Particles placed again where a contact has ruled most of them out: the bulk repopulation of
Borovies 2007.

That is Particle filter based tracking in a detection sparse discrete event simulation environment,
III.B.2, for targets that keep a course or act. Where a contact leaves fewer than `bulk` of the
particles, all that it rules out are placed where it may have been, with any course and speed up to
`fastest`; what else is known of the target is the estimate at the contact before. By "position"
particles weigh the more the nearer the speed that they would have needed from there is to the
estimated one; by "course" half of them come straight from there, and all weigh alike; "combined"
does both. It is a heuristic, no Bayes: docs/searches.md says what becomes of weights.
kernels.tracking.clouds does the same for a tracker's clouds.
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
FLOOR = -200.0  # log likelihood of what a contact contradicts: it may contradict every particle
TRIES = 64  # places drawn for a particle until one is in water; without one it stays ruled out


class Estimate(NamedTuple):
    """Where a target is taken to be, and how fast it is."""

    lon: float  # [rad] of the weighted mean place
    lat: float
    speed: float  # [m/s] weighted mean of the particles' speeds
    time: int  # [s after start]


@dataclass(frozen=True)
class Cloud:
    """What particles are like at a time, (n,) each."""

    lon: Array  # [rad]
    lat: Array
    speed: Array  # [m/s]
    log_weight: Array


@dataclass(frozen=True)
class Placed:
    """Particles that have been placed anew: their slots, what they are now, and the log weights of
    all.
    """

    slots: Array  # int64 (m,)
    lon: Array  # [rad] (m,)
    lat: Array
    course: Array  # [rad] (m,)
    speed: Array  # [m/s] (m,)
    change: Array  # int64 [s after start] (m,): when it changes its course or acts next
    # bool (m,): whether that is so of all, or of those alone that had stopped, for whose others it
    # has no memory
    fresh: Array
    log_weight: Array  # float64 (n,)


def bounded(contact: Contact) -> bool:
    """Return whether a contact is surely of the object, and says where that may be: only then does
    it rule out and place again.
    """
    sure = (
        contact.belief == 1
        and contact.false_density == 0
        and contact.drifter is None
        and contact.zones is None
    )
    return sure and (contact.kind != "bearing" or math.isfinite(contact.far))


def estimate(cloud: Cloud, time: int) -> Estimate:
    """Return what a cloud says of its target at a time [s after start]."""
    share = weights.relative(cloud.log_weight)
    x, y, z = (share @ axis for axis in sphere.vector(cloud.lon, cloud.lat))
    return Estimate(
        math.atan2(y, x),
        math.atan2(z, math.hypot(x, y)),
        float(share @ cloud.speed / share.sum()),
        time,
    )


class Filling:
    """How particles are placed again at contacts, one after the other."""

    def __init__(
        self,
        rule: Resampling,
        seed: int,
        changes: Sequence[float | tuple[float, float]],
        shore: DeviceCoast | None,
    ) -> None:
        """Make ready; changes: mean time between changes of course [s] by scenario, 0: none, or the
        least and longest between acts.

        shore: on whose land nothing is placed, None: anywhere.
        """
        self._rule, self._seed, self._changes, self._shore = rule, seed, changes, shore
        self._last: Estimate | None = None  # at the contact before

    def anew(
        self,
        contact: Contact,
        number: int,
        time: int,
        cloud: Cloud,
        contradicted: Array,
        layout: Layout,
    ) -> Placed | None:
        """Return the particles to repopulate after a contact; None if there are none.

        Particles whose new position would be on land are not placed.

        number: of the contact in the case; time: of it [s after start]; cloud: after it;
        contradicted: whom it leaves nothing, bool (n,).
        """
        share, left = weights.relative(cloud.log_weight), ~contradicted
        scenarios = list(zip(layout.bounds[:-1], layout.bounds[1:], strict=True))
        for first, last in scenarios:
            left[first:last] &= resample.survivors(share[first:last])
        placed = None
        if left.sum() < self._rule.bulk * len(left):
            placed = self._placed(contact, number, time, cloud, left, scenarios)
        if placed is None or placed.slots.size:
            self._last = estimate(cloud if placed is None else changed(cloud, placed), time)
        return placed

    def _placed(
        self,
        contact: Contact,
        number: int,
        time: int,
        cloud: Cloud,
        left: Array,
        scenarios: list[tuple[int, int]],
    ) -> Placed:
        log_weight, parts = np.array(cloud.log_weight, np.float64), []
        for scenario, (first, last) in enumerate(scenarios):
            own, rng = (
                cloud.log_weight[first:last],
                noise.generator(self._seed, Purpose.FILLING, number, (scenario, 0)),
            )
            out = np.flatnonzero(~left[first:last])
            lon, lat, wet = self._in_water(contact, out.size, rng)
            course, speed, need = self._motion(contact, time, lon, lat, rng)
            law = self._changes[scenario]
            change = time + _waits(law, out.size, rng)
            fresh = np.full(out.size, isinstance(law, tuple))
            out, moving = (
                out[wet],
                [values[wet] for values in (lon, lat, course, speed, change, fresh)],
            )
            weight = np.where(left[first:last], weights.relative(own), 0.0)
            mean = weight.sum() / max(left[first:last].sum(), 1) or 1.0
            weight[out] = mean
            if need is not None and self._last is not None and self._rule.method != "course":
                high, pace = self._rule.fastest, self._last.speed
                least = high * LEAST
                weight[left[first:last]] = max(high - pace, least)
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
        return Placed(slots, lon, lat, course, speed, change, fresh, log_weight)

    def _motion(
        self, contact: Contact, time: int, lon: Array, lat: Array, rng: np.random.Generator
    ) -> tuple[Array, Array, Array | None]:
        """Return courses, speeds, and those needed from the last estimate, if there is one from
        before.
        """
        high, n = self._rule.fastest, lon.size
        course, speed = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, high, n)
        if contact.course_std > 0:
            course = contact.course + contact.course_std * rng.standard_normal(n)
        if contact.speed_std > 0:
            speed = np.clip(contact.speed + contact.speed_std * rng.standard_normal(n), 0, high)
        straight = rng.random(n) < 0.5
        last = self._last
        # of two contacts at one time the first tells no speed
        if last is None or time <= last.time:
            return course % (2 * np.pi), speed, None
        need = sphere.distance(last.lon, last.lat, lon, lat) / (time - last.time)
        if self._rule.method != "position":
            east, north = sphere.offset(lon, lat, last.lon, last.lat)  # of where it comes from
            course = np.where(straight, np.arctan2(-east, -north), course)
            speed = np.where(straight, np.minimum(need, high), speed)
        return course % (2 * np.pi), speed, need

    def _in_water(
        self, contact: Contact, n: int, rng: np.random.Generator
    ) -> tuple[Array, Array, Array]:
        """Return places (lon, lat) [rad] where a contact may have been, (n,), and which of them are
        in water.
        """
        lon, lat, wet = np.zeros(n), np.zeros(n), np.zeros(n, bool)
        for _ in range(TRIES):
            dry = np.flatnonzero(~wet)
            if not dry.size:
                break
            lon[dry], lat[dry] = places(contact, dry.size, rng)
            wet[dry] = (
                True
                if self._shore is None
                else coast.wet(self._shore, *(_binary(x[dry]) for x in (lon, lat)))
            )
        return lon, lat, wet


def _waits(law: float | tuple[float, float], n: int, rng: np.random.Generator) -> Array:
    """Return times until courses change [s], int64 (n,): exponential about a mean, 0 of which is
    never, or alike between two times.
    """
    if isinstance(law, tuple):
        return np.rint(rng.uniform(*law, n)).astype(np.int64)
    if law == 0:
        return np.full(n, NEVER, np.int64)
    return np.minimum(np.maximum(rng.exponential(law, n), 1), NEVER).astype(np.int64)


def of_run(rule: Resampling, spec: EnsembleSpec, shore: DeviceCoast | None) -> Filling:
    """Return how the particles of a run are placed again, all of whose scenarios keep a course."""
    itineraries = [scenario.itinerary for scenario in spec.scenarios]
    changes = [
        phase.between if isinstance(phase, Acts) else phase.change
        for own in itineraries
        if own
        for phase in own.phases
        if isinstance(phase, Course | Acts)
    ]
    minds_land = any(own and own.land != "ignore" for own in itineraries)
    return Filling(rule, spec.seed, changes, shore if minds_land else None)


def refused(
    rule: Resampling,
    scenarios: Sequence[Scenario],
    contacts: Sequence[Contact],
    start: np.datetime64,
) -> str:
    """Return why particles cannot be placed again at the contacts of a case, in a line; "": they
    can.
    """
    what = f'resampling: method "{rule.method}" places what keeps a course where a contact may have been'
    for scenario in scenarios:
        own = scenario.itinerary
        if own is None or own.distress is not None or not _keeps_course(own):
            return (
                f'{what}, and scenario "{scenario.name}" drifts, follows way points, loiters or ends; give each scenario one [[scenario.phase]] '
                'with a course or a behaviour, no end and no distress, or method = "systematic"'
            )
    for contact in contacts:
        if bounded(contact) and contact.time == start:
            return f'{what}, and contact "{contact.name}" is at the start of the run: give it as the scenarios\' position, or start earlier'
    if not any(bounded(contact) for contact in contacts):
        return (
            f"{what}, and there is none that could: give a [[contact]] without belief and false_density (a bearing with far), or method = "
            '"duplicates"'
        )
    return ""


def _keeps_course(itinerary: Itinerary) -> bool:
    """Return whether a target keeps a course, or changes it, or acts, to the end."""
    first = itinerary.phases[0]
    endless = isinstance(first, Course | Acts) and first.until is None and first.lasting == math.inf
    return len(itinerary.phases) == 1 and endless


def changed(cloud: Cloud, placed: Placed) -> Cloud:
    """Return a cloud with those that have been placed again."""
    columns = {}
    for name in ("lon", "lat", "speed"):
        columns[name] = np.array(getattr(cloud, name), np.float64)
        columns[name][placed.slots] = getattr(placed, name)
    return Cloud(**columns, log_weight=placed.log_weight)


def _binary(angle: Array) -> Array:
    return sphere.to_binary(np.degrees(angle))


def places(contact: Contact, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return places (lon, lat) [rad] where a contact may have been, (n,): alike in range between
    the ranges of a bearing.
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
        return _within(contact, n, rng)
    assert contact.sensor is not None
    if contact.kind == "range":
        bearing = rng.uniform(0, 2 * np.pi, n)
        far = np.abs(contact.range + contact.range_std * rng.standard_normal(n))
    else:
        bearing, far = _bearings(contact, n, rng), rng.uniform(contact.near, contact.far, n)
    lon, lat = np.radians(contact.sensor)
    return sphere.destination(lon, lat, far * np.sin(bearing), far * np.cos(bearing))


def _bearings(contact: Contact, n: int, rng: np.random.Generator) -> Array:
    """Return bearings [rad] that a contact may have had; half of them the image's where the array
    cannot tell.
    """
    bearing = np.full(n, contact.bearing)
    if contact.heard is not None and contact.heard.mirrored:
        bearing = np.where(
            rng.random(n) < 0.5, bearing, contact_laws.image(contact.bearing, contact.heard.heading)
        )
    if contact.wedge > 0:
        return bearing + contact.wedge * (rng.random(n) - 0.5)
    return np.asarray(bearing + contact_laws.bearing_std(contact, bearing) * rng.standard_normal(n))


def _within(contact: Contact, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return places in a contact's area, alike everywhere."""
    assert contact.area is not None
    lon, lat, inside = np.zeros(n), np.zeros(n), np.zeros(n, bool)
    corners = np.radians(np.array(contact.area.ring))
    x, y = sphere.track(corners[:, 0], corners[:, 1], sensor_path.EDGE)  # great circles bulge
    (west, east), (south, north) = (
        (float(edge.min()), float(edge.max())) for edge in (np.unwrap(x), y)
    )
    while not inside.all():
        out = np.flatnonzero(~inside)
        lon[out] = rng.uniform(west, east, out.size)
        lat[out] = np.arcsin(rng.uniform(math.sin(south), math.sin(north), out.size))
        inside[out] = contact_laws.inside(contact.area, _binary(lon[out]), _binary(lat[out]))
    return lon, lat
