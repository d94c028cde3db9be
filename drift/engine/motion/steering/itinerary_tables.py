"""Converts the itineraries of a run into tables of numbers for kernels.steering.itinerary.Plan."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from drift.engine.motion.period import Period
from drift.engine.motion.steering.itinerary import (
    Abeam,
    Acts,
    Between,
    Course,
    Followed,
    InBox,
    InDisc,
    InRing,
    Itinerary,
    Moment,
    Near,
    Part,
    Phase,
    Rate,
    Spread,
    WayPoint,
    Ways,
)
from geo import sphere
from geo.array import Array
from kernels.steering import itinerary as kernel


class Tables(NamedTuple):
    """Flat tables of a run's itineraries for kernels.steering.itinerary.packed."""

    stories: Array
    story_laws: Array
    phases: Array
    phase_laws: Array
    points: Array
    point_laws: Array
    vertices: Array
    behaviours: Array
    tracks: Array


# [m] longest edge of a polygon to loiter in, which is straight in lon and lat; great circles bulge
# 8 m
EDGE = 20_000.0


def _tables(itineraries: Sequence[Itinerary | None], period: Period) -> Tables:
    """Return the tables of the scenarios' itineraries; None: a scenario without one."""
    made = _Tables(period)
    for itinerary in itineraries:
        made.add(itinerary)
    return made.done()


def plan(itineraries: Sequence[Itinerary | None], period: Period) -> Any:
    """Return a kernels.steering.itinerary.Plan of the scenarios' itineraries, on the device."""
    return kernel.packed(_tables(itineraries, period)._asdict())


class _Tables:
    """The tables under construction."""

    def __init__(self, period: Period) -> None:
        self.period = period
        self.stories: list[list[int]] = []
        self.story_laws: list[list[float]] = []
        self.phases: list[list[int]] = []
        self.phase_laws: list[list[float]] = []
        self.points: list[list[int]] = []
        self.point_laws: list[list[float]] = []
        self.vertices: list[Array] = []
        self.behaviours: list[list[float]] = []
        self.tracks: list[list[int]] = []
        self._followed: dict[Followed, list[int]] = {}

    def done(self) -> Tables:
        """Return the tables, flat; an empty one holds one unused number."""
        stories, story_laws, phases, phase_laws, points, point_laws, behaviours, tracks = (
            np.array(rows or [[0]], dtype).reshape(-1)
            for rows, dtype in (
                (self.stories, np.int32),
                (self.story_laws, np.float32),
                (self.phases, np.int32),
                (self.phase_laws, np.float32),
                (self.points, np.int32),
                (self.point_laws, np.float32),
                (self.behaviours, np.float32),
                (self.tracks, np.int32),
            )
        )
        vertices = np.concatenate([*self.vertices, np.zeros(1, np.int32)]).astype(np.int32)
        return Tables(
            stories,
            story_laws,
            phases,
            phase_laws,
            points,
            point_laws,
            vertices,
            behaviours,
            tracks,
        )

    def add(self, itinerary: Itinerary | None) -> None:
        """Add a scenario's itinerary."""
        first = len(self.phases)
        law, base, numbers = kernel.AWAY, 0, [0.0] * 5
        land = 0
        if itinerary is not None:
            for phase in itinerary.phases:
                self._phase(phase)
            land = {"refuse": kernel.WET, "stop": kernel.WET | kernel.STOPPED, "ignore": 0}[
                itinerary.land
            ]
            if itinerary.land == "refuse" and itinerary.currents == "felt":
                # its track is clear of land, but the current may set it ashore
                land |= kernel.STOPPED
            match itinerary.distress:
                case Between(earliest, after):
                    law, base, numbers = (
                        kernel.BETWEEN,
                        self.period.elapsed(earliest),
                        [*_row(after), 0.0],
                    )
                case Rate(rate):
                    law, numbers = kernel.RATE, [0.0, 0.0, 0.0, 0.0, rate]
                case Part(part):
                    law, numbers = kernel.SHARE, [*_row(part), 0.0]
        self.stories.append([first, len(self.phases), land, law, base])
        self.story_laws.append(numbers)

    def _phase(self, phase: Phase) -> None:
        numbers, laws = [0, len(self.points), 0, 0, 0, 0, kernel.NEVER, kernel.NEVER, 0], [0.0] * 18
        if isinstance(phase, Ways):
            numbers[0], numbers[2:4] = kernel.WAY, [len(phase.points), len(phase.destinations)]
            numbers[8] = self.period.elapsed(phase.start)
            laws[4:8], laws[8:12] = _row(phase.speed), _row(phase.after)
            laws[14:18] = phase.k, phase.k_spread, phase.slowest, min(phase.fastest, 1e9)
            for point in phase.points:
                self._point(point)
            probability = 0.0
            for point, own in phase.destinations:
                probability += own
                self._point(point, probability)
        else:
            numbers[6] = kernel.NEVER if phase.until is None else self.period.elapsed(phase.until)
            numbers[7] = int(min(phase.lasting, kernel.NEVER))
            laws[4:8] = _row(phase.speed)
            if isinstance(phase, Course):
                numbers[0], laws[0:4], laws[12] = kernel.COURSE, _row(phase.course), phase.change
            elif isinstance(phase, Acts):
                numbers[0], laws[0:4], numbers[8] = (
                    kernel.ACTS,
                    _row(phase.course),
                    len(self.behaviours),
                )
                numbers[4:6] = [0, 0] if phase.tracker is None else self._track(phase.tracker)
                self.behaviours.append(
                    [
                        *phase.between,
                        phase.change,
                        phase.seek,
                        phase.hide,
                        phase.leave,
                        phase.spread,
                        phase.fastest,
                    ]
                )
            else:
                numbers[0], numbers[2], laws[13] = kernel.LOITER, 1, phase.leg
                self._point(WayPoint(phase.ring))
                numbers[4:6] = self._ring(*_cut(phase.ring))
        self.phases.append(numbers)
        self.phase_laws.append(laws)

    def _point(self, point: WayPoint, probability: float = 1.0) -> None:
        numbers, laws = [kernel.NORMAL, *[0] * 10], [0.0] * 14
        place = point.place
        laws[3], laws[13] = point.distance, probability
        if isinstance(place, InRing):
            lon, lat = _binary(place)
            west, south = int(lon.min()), int(lat.min())
            numbers[0], numbers[3:5] = kernel.RING, self._ring(lon, lat)
            numbers[5:9] = [
                _wrapped(west),
                south,
                _wrapped(int(lon.max()) - west),
                int(lat.max()) - south,
            ]
            inside = np.array([south, lat.max()]) * sphere.UNIT
            laws[12] = 1.0 if inside[0] <= 0 <= inside[1] else float(np.cos(np.abs(inside).min()))
        else:
            numbers[1:3] = [int(sphere.to_binary(np.degrees(x))) for x in (place.lon, place.lat)]
            match place:
                case Near():
                    laws[0:3], laws[4:8] = (
                        [place.major, place.minor, place.orientation],
                        place.follows,
                    )
                case InBox():
                    numbers[0], laws[0:3] = (
                        kernel.BOX,
                        [place.length / 2, place.width / 2, place.orientation],
                    )
                case InDisc():
                    numbers[0], laws[0] = kernel.DISC, place.radius
                case Abeam():
                    numbers[0] = kernel.ACROSS if place.law == "uniform" else kernel.ASIDE
                    laws[0], laws[2] = place.half, place.toward
        match point.time:
            case Spread(low, high, mode, ratio):
                numbers[9], numbers[10] = kernel.AT_TIME, round(low)
                laws[8:12] = _row(Spread(0.0, high - low, mode - low, ratio))
            case Moment(mean, std):
                numbers[9], numbers[10], laws[8] = kernel.NORMAL_TIME, round(mean), std
        self.points.append(numbers)
        self.point_laws.append(laws)

    def _track(self, followed: Followed) -> list[int]:
        """Add a tracker's track, once; return the number of its first vertex and its number of
        vertices.
        """
        if followed not in self._followed:
            begin = self.period.elapsed(followed.begin)
            time = np.rint(np.array(followed.time) + begin).astype(np.int64)
            last = np.append(
                np.diff(time) > 0, True
            )  # of vertices within one second only the last counts
            place = (
                sphere.to_binary(np.degrees(np.array(x))) for x in (followed.lon, followed.lat)
            )
            rows = np.stack([time, *place], axis=1)[last]
            self._followed[followed] = [len(self.tracks), len(rows)]
            self.tracks += rows.tolist()
        return self._followed[followed]

    def _ring(self, lon: Array, lat: Array) -> list[int]:
        """Add a ring of unwrapped binary angles; return the number of its first vertex and its
        size.
        """
        first = sum(ring.size for ring in self.vertices) // 2
        self.vertices.append(
            np.stack([_wrapped_all(lon), lat], axis=1).reshape(-1).astype(np.int32)
        )
        return [first, lon.size]


def _row(spread: Spread) -> list[float]:
    """Return low, high, mode and uniform share of a truncated triangle, for
    kernels.maths.spreads.triangle.
    """
    return [spread.low, spread.high, spread.mode, 2 / (1 + spread.ratio)]


def _cut(ring: InRing) -> tuple[Array, Array]:
    """Return the vertices of a ring as unwrapped binary angles, with its edges divided to at most
    EDGE.
    """
    lon, lat = [], []
    corners = np.stack([ring.lon, ring.lat], axis=1)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(sphere.distance(a[0], a[1], b[0], b[1]))
        share = np.arange(max(1, int(np.ceil(length / EDGE)))) / max(1, int(np.ceil(length / EDGE)))
        lon.append(a[0] + share * (b[0] - a[0]))
        lat.append(a[1] + share * (b[1] - a[1]))
    return _binary(InRing(tuple(np.concatenate(lon).tolist()), tuple(np.concatenate(lat).tolist())))


def _binary(ring: InRing) -> tuple[Array, Array]:
    """Return the vertices of a ring as unwrapped binary angles, int64."""
    turn = sphere.TURN / (2 * np.pi)
    return np.rint(np.array(ring.lon) * turn).astype(np.int64), np.rint(
        np.array(ring.lat) * turn
    ).astype(np.int64)


def _wrapped(angle: int) -> int:
    return (angle + 2**31) % 2**32 - 2**31


def _wrapped_all(angle: Array) -> Array:
    return np.asarray((angle + 2**31) % 2**32 - 2**31)
