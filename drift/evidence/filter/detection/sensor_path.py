"""The path of a sensor over time: the legs of a sortie, cut into pieces.

A piece is short enough for its great circle to be straight. For part of a step, the kernels take a
`kernels.evidence.sweep.Track`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geo import sphere
from geo.array import Array
from geo.polyline import Area, Legs
from kernels.evidence.sweep import Track

# Returns the positions of a marker, lon and lat [rad], at times [s after the run's start].
Moved = Callable[[Array], tuple[Array, Array]]

# [m], longest piece of a leg up to 62 degrees N; beyond, pieces are shorter as the tangent of the
# latitude grows. For a particle within half a piece, the great circle is straight to 0.3 m; if the
# particle drifts by 1 km, to 2 m.
PIECE = 50_000.0
# beyond this latitude a plane chart uses great circles, not their second-order approximation
NEAR_POLE = math.radians(85.0)
# [deg] beyond this latitude pieces need not be shorter: there kernels follow great circles
STEEP = 89.0
# [m], longest piece of an area's edge: it bulges by less than 4 m up to 60 degrees N
EDGE = 10_000.0


@dataclass(frozen=True)
class Path:
    """Nodes of a sensor's path, and the pieces between them, each a leg or part of one."""

    time: Array  # [s after the run's start], ascending, (k + 1,)
    lon: Array  # [deg] without jumps
    lat: Array
    course: Array  # leg direction (east, north) at begin and end of each piece, (k, 4)
    searching: Array  # bool (k,)
    leg: Array  # int (k,): number of the leg that each piece is part of, from 1

    def between(
        self,
        begin: float,
        end: float,
        elapsed: int,
        moved: Moved | None,
        datum: tuple[float, float],
        polar: bool = False,
    ) -> Track | None:
        """Return the track from begin to end, or None if there is none.

        Args:
            begin: of the track [s after the run's start].
            end: of the track; both are within the step.
            elapsed: begin of the step [s after the run's start].
            moved: positions of the marker with which the path drifts. The path then has the same
                offset from the marker as it was laid out with from the datum.
            datum: of the drifting path (lon, lat) [deg].
            polar: whether courses are rotated to the meridian of 0, as kernels.evidence.sweep needs
                if the domain contains a pole.
        """
        begin, end = max(begin, float(self.time[0])), min(end, float(self.time[-1]))
        if begin >= end:
            return None
        inner = self.time[(self.time > begin) & (self.time < end)]
        time = np.concatenate([[begin], inner, [end]])
        lon, lat = self._at(time)
        piece = np.clip(
            np.searchsorted(self.time, time[:-1], side="right") - 1, 0, len(self.searching) - 1
        )
        low, span = self.time[piece], np.diff(self.time)[piece]
        first, last = self.course[piece, :2], self.course[piece, 2:]
        at, to = ((time[:-1] - low) / span)[:, None], ((time[1:] - low) / span)[:, None]
        course = np.concatenate([first + at * (last - first), first + to * (last - first)], axis=1)
        course[:, :2] = np.where(at == 0, first, course[:, :2])
        course[:, 2:] = np.where(to == 1, last, course[:, 2:])
        if polar:
            each = (
                np.radians(np.stack([lon[:-1], lon[1:]], axis=1)),
                np.stack([lat[:-1], lat[1:]], axis=1),
            )
            course = np.stack(
                sphere.to_pole(*each, *course.reshape(-1, 2, 2).transpose(2, 0, 1)), axis=-1
            ).reshape(-1, 4)
        if moved is not None:
            x, y = moved(time)
            apart = sphere.offset(
                np.radians(datum[0]), np.radians(datum[1]), np.radians(lon), np.radians(lat)
            )
            if polar:  # directions stay constant in the plane of the pole
                at_datum = np.full(lon.shape, np.radians(datum[0])), np.full(lon.shape, datum[1])
                apart = sphere.from_pole(x, y, *sphere.to_pole(*at_datum, *apart))
            lon, lat = (np.degrees(angle) for angle in sphere.destination(x, y, *apart))
        place = np.stack([sphere.to_binary(lon), sphere.to_binary(lat)], axis=1)
        turned = np.radians(lat)
        trig = np.stack([np.cos(turned), 0.25 * sphere.UNIT * np.sin(2 * turned)], axis=1)
        return Track(
            (time - elapsed).astype(np.float32),
            place.reshape(-1),
            trig.astype(np.float32).reshape(-1),
            course.astype(np.float32).reshape(-1),
            self.searching[piece].astype(np.int32),
            self.leg[piece].astype(np.int32),
        )

    def _at(self, time: Array) -> tuple[Array, Array]:
        """Return positions [deg] at times.

        The same time gives the same bits, so that tracks join.
        """
        node = np.clip(
            np.searchsorted(self.time, time, side="right") - 1, 0, len(self.searching) - 1
        )
        share = (time - self.time[node]) / (self.time[node + 1] - self.time[node])
        lon, lat = np.radians(self.lon), np.radians(self.lat)
        east, north = sphere.offset(lon[node], lat[node], lon[node + 1], lat[node + 1])
        x, y = sphere.destination(lon[node], lat[node], share * east, share * north)
        between = sphere.near_degrees(np.degrees(x), self.lon[node]), np.degrees(y)
        first, last = (
            np.select([share == 0, share == 1], [nodes[node], nodes[node + 1]], inner)
            for nodes, inner in zip((self.lon, self.lat), between, strict=True)
        )
        return first, last


def of_legs(legs: Legs, start: int) -> Path:
    """Return the path of legs.

    Args:
        legs: of a sortie.
        start: of the run [s since 1970].
    """
    time, lon, lat, course, searching, leg = (
        [legs.time[0]],
        [legs.lon[0]],
        [legs.lat[0]],
        [],
        [],
        [],
    )
    for k, seeks in enumerate(legs.searching):
        highest = min(max(map(abs, legs.lat[k : k + 2])), STEEP)
        longest = PIECE * min(1.0, 1.9 / max(math.tan(math.radians(highest)), 1e-9))
        x, y = sphere.track(
            np.radians(legs.lon[k : k + 2]), np.radians(legs.lat[k : k + 2]), longest
        )
        pieces = len(x) - 1
        # The tangent of the leg's great circle at each node: the same wherever a leg is cut.
        east, north = sphere.offset(x[:-1], y[:-1], x[-1], y[-1])
        back = sphere.offset(x[-1], y[-1], x[0], y[0])
        way = np.stack([np.append(east, -back[0]), np.append(north, -back[1])], axis=1)
        way /= np.maximum(np.hypot(*way.T), 1e-9)[:, None]
        course.append(np.concatenate([way[:-1], way[1:]], axis=1))
        share = np.arange(1, pieces + 1) / pieces
        time.extend(legs.time[k] + share * (legs.time[k + 1] - legs.time[k]))
        lon.extend(np.degrees(x[1:]))
        lat.extend(np.degrees(y[1:]))
        searching.extend([seeks] * pieces)
        leg.extend([k + 1] * pieces)
    unwrapped = np.degrees(np.unwrap(np.radians(lon)))
    return Path(
        np.array(time) - start,
        unwrapped,
        np.array(lat),
        np.concatenate(course),
        np.array(searching),
        np.array(leg),
    )


def path_of_fixed_sensor(lon: float, lat: float, begin: float, end: float) -> Path:
    """Return the path of a sensor that stays at a position.

    Args:
        lon: longitude [deg].
        lat: latitude [deg].
        begin: of the path [s after the run's start].
        end: of the path [s after the run's start].
    """
    course = np.array([[0.0, 1.0, 0.0, 1.0]])
    return Path(
        np.array([begin, end]),
        np.array([lon, lon]),
        np.array([lat, lat]),
        course,
        np.array([True]),
        np.array([1]),
    )


def chart(at_lon: float, at_lat: float, lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return (x, y) [m] of positions [rad] on the plane about a position [rad].

    In this plane `kernels.evidence.sweep` tests whether positions are in a ring.
    """
    apart = lon - at_lon
    if abs(at_lat) > NEAR_POLE:
        return sphere.offset(at_lon, at_lat, lon, lat)
    y = lat - at_lat - 0.25 * np.sin(2 * at_lat) * apart**2
    return apart * np.cos(at_lat) * sphere.RADIUS, y * sphere.RADIUS


def ring(area: Area) -> tuple[float, float, Array]:
    """Return a position (lon, lat) [deg] inside the extent of an area, and its outline about that.

    The outline, (x, y, x, y, ...) [m], is in the form that `kernels.evidence.sweep.expose` takes:
    it runs counterclockwise, and edges are great circles, divided where they curve.
    """
    corners = np.radians(np.array(area.ring))
    x, y = sphere.track(corners[:, 0], corners[:, 1], EDGE)
    lon, lat = np.unwrap(x[:-1]), y[:-1]
    at_lon, at_lat = 0.5 * (lon.min() + lon.max()), 0.5 * (lat.min() + lat.max())
    if abs(np.unwrap(x)[-1] - lon[0]) > np.pi:  # the outline encloses a pole
        at_lon, at_lat = 0.0, math.copysign(math.pi / 2, at_lat)
    outline = np.stack(chart(at_lon, at_lat, lon, lat), axis=1)
    after = np.roll(outline, -1, axis=0)
    if np.sum(outline[:, 0] * after[:, 1] - outline[:, 1] * after[:, 0]) < 0:
        outline = outline[::-1]
    return (
        float(np.degrees(at_lon)),
        float(np.degrees(at_lat)),
        outline.reshape(-1).astype(np.float32),
    )
