"""Synthetic flows in closed form, for the shipped example case, for tests and for trials.

A `Flow` takes points, flow(lon, lat) [deg] with shapes that broadcast, and returns a `Velocity`: a
function of time, velocity(seconds since 2000-01-01 UTC) -> (east, north) [m/s], each of the
broadcast shape. The time is absolute, so a flow does not depend on when a run starts.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.errors import UserError
from geo.forcing.quantity import velocities

Velocity = Callable[[float], tuple[Array, Array]]
Flow = Callable[[ArrayLike, ArrayLike], Velocity]

EPOCH = np.datetime64("2000-01-01", "s")
DAY = 86400.0  # [s]
ROTATION = 7.292115e-5  # [rad/s] of the Earth (GRS80)
METRES = sphere.RADIUS * np.pi / 180.0  # [m] in a degree of latitude


def _east_of(lon: ArrayLike, reference: float) -> Array:
    """Return longitudes [deg] relative to a reference longitude, in [-180, 180)."""
    return np.asarray(sphere.wrap_degrees(np.asarray(lon, float) - reference))


def _solid_rotation(
    box: Box, speed: float = 0.5, pole_lon: float = 40.0, pole_lat: float = 60.0
) -> Flow:
    """Return a rotation of the whole sphere about the axis through (pole_lon, pole_lat) [deg].

    speed [m/s] is the speed 90 degrees from the axis. velocity = omega x r: a particle moves on a
    small circle and is back at its start after 2 pi R / speed.
    """
    lam, phi = np.radians(pole_lon), np.radians(pole_lat)

    def flow(lon: ArrayLike, lat: ArrayLike) -> Velocity:
        d, y = np.radians(np.asarray(lon, float)) - lam, np.radians(np.asarray(lat, float))
        east = np.asarray(speed * (np.cos(y) * np.sin(phi) - np.sin(y) * np.cos(phi) * np.cos(d)))
        north = np.asarray(speed * np.cos(phi) * np.sin(d) + 0.0 * y)
        return lambda seconds: (east, north)

    return flow


def _stommel_gyre(box: Box, speed: float = 1.0, boundary: float = 0.05) -> Flow:
    """Return Stommel's (1948, doi:10.1029/TR029i002p00202) gyre over the box.

    Its interior is slow and its western boundary current fast. boundary: width of that current as a
    share of the box's width; speed [m/s]: the largest northward component. The streamfunction on
    the unit square is psi = pi sin(pi y) (1 - x - exp(-x / boundary)).
    """
    width, height = box.east - box.west, box.north - box.south
    # q is of the order of exp(-1 / boundary). It makes psi vanish at the east wall, which would
    # leak otherwise.
    q = np.exp(-1.0 / boundary)

    def flow(lon: ArrayLike, lat: ArrayLike) -> Velocity:
        x = _east_of(lon, (box.west + box.east) / 2) / width + 0.5
        y = (np.asarray(lat, float) - box.south) / height
        decay = np.exp(-np.clip(x, -1, 2) / boundary)
        psi_y = np.pi * np.cos(np.pi * y) * (1 - x - decay + q * x)
        psi_x = np.sin(np.pi * y) * (-1 + decay / boundary + q)
        inside = (x >= 0) & (x <= 1) & (y >= 0) & (y <= 1)
        scale = speed / (1 / boundary - 1)
        # u = -dpsi/dy, v = dpsi/(cos(lat) dx): no divergence
        cosine = np.cos(np.radians(np.asarray(lat, float)))
        east = np.where(inside, -psi_y * scale * width / height, 0.0)
        north = np.where(inside, psi_x * scale / cosine, 0.0)
        return lambda seconds: (east, north)

    return flow


def _inertial(
    box: Box,
    speed: float = 0.3,
    mean_east: float = 0.05,
    mean_north: float = 0.0,
    lat: float = 45.0,
) -> Flow:
    """Return an inertial oscillation of amplitude speed [m/s] on a uniform mean flow [m/s].

    It turns clockwise in the northern hemisphere, with the inertial period at `lat` [deg].
    """
    f = 2 * ROTATION * np.sin(np.radians(lat))

    def flow(lon: ArrayLike, lat: ArrayLike) -> Velocity:
        still = 0.0 * (np.asarray(lon, float) + np.asarray(lat, float))

        def velocity(seconds: float) -> tuple[Array, Array]:
            turn = f * seconds
            return mean_east + speed * np.cos(turn) + still, mean_north - speed * np.sin(
                turn
            ) + still

        return velocity

    return flow


# Eddies: (lon, lat [deg], radius [km], speed [m/s], positive counterclockwise, amplitude of the
# drift west and north [km/day])
EDDIES = (
    (-89.6, 25.6, 115.0, -0.75, 3.0, 0.3),  # a ring shed by the Loop Current
    (-88.2, 27.6, 45.0, 0.45, -1.0, -0.8),  # cyclones on its flank
    (-88.0, 23.9, 55.0, 0.40, 1.0, 0.6),
    (-92.6, 26.6, 70.0, 0.35, 1.5, 0.0),
    (-94.3, 24.2, 95.0, -0.40, 2.0, 0.2),
)
# axis of the Loop Current [deg]: in by the Yucatan Channel, out by the Straits of Florida
LOOP = (
    (-85.6, 20.0),
    (-85.9, 21.8),
    (-86.6, 23.4),
    (-87.2, 25.0),
    (-87.1, 26.4),
    (-86.2, 27.3),
    (-85.0, 27.0),
    (-84.3, 25.7),
    (-83.9, 24.5),
    (-82.9, 23.8),
    (-81.2, 23.9),
    (-80.0, 24.6),
    (-79.6, 26.0),
    (-79.7, 28.0),
    (-79.4, 30.5),
)
# edge of the shelf [deg], with deep water on its right: Texas, Louisiana, Florida, the Keys,
# Florida's east coast
SHELF = (
    (-98.0, 25.0),
    (-96.6, 27.0),
    (-94.5, 28.3),
    (-91.5, 28.4),
    (-89.0, 29.2),
    (-87.0, 29.9),
    (-85.0, 29.0),
    (-83.7, 27.6),
    (-83.0, 26.0),
    (-82.4, 24.7),
    (-80.9, 24.6),
    (-80.1, 25.4),
    (-80.0, 27.0),
    (-80.6, 30.5),
)
HALF = 38e3  # [m] half width of the jet
TIDE = 86_164.1  # [s] period of K1, nearly inertial in the Gulf


def _gulf(box: Box, speed: float = 0.9, tide: float = 0.06) -> Flow:
    """Return a jet like the Loop Current with drifting eddies and a weak daily tide [m/s].

    Jet and eddies derive from one streamfunction, so they have no divergence. The jet's
    streamfunction is a tanh of the distance from its axis (a smoothed polyline with kinks of a few
    degrees); an eddy's is a Gaussian; their sum goes to zero over the shelf. The flow resembles
    the Gulf of Mexico but is invented: do not use it as a forecast. Far from the Gulf only the
    tide is left.
    """
    # Distances are computed in a plane with scale 1 at 26 N: x = lon * squeeze * METRES.
    squeeze = np.cos(np.radians(26.0))

    def flow(lon: ArrayLike, lat: ArrayLike) -> Velocity:
        a, b = -88.0 + _east_of(lon, -88.0), np.asarray(lat, float)
        x, y = np.broadcast_arrays(a, b)
        side, side_x, side_y = _signed_distance(_smooth_corners(LOOP), squeeze, x, y)
        edge, edge_x, edge_y = _signed_distance(_smooth_corners(SHELF), squeeze, x, y)
        depth = np.tanh((edge - 20e3) / 40e3)
        off = np.hypot((x + 88.0) * 0.9, y - 25.0) / 14.0
        far = np.clip(off - 0.7, 0, None)
        fade = np.exp(-(far**2) / 0.02)  # the flow fades out beyond the Gulf
        deep = (0.5 + 0.5 * depth) * fade
        fall = -100.0 * far / (np.maximum(off, 0.7) * 14.0**2 * METRES) * deep
        rise = (0.5 - 0.5 * depth * depth) / 40e3 * fade
        deep_x = rise * edge_x + fall * 0.81 * (x + 88.0) / squeeze
        deep_y = rise * edge_y + fall * (y - 25.0)
        cosine = np.cos(np.radians(y))

        def velocity(seconds: float) -> tuple[Array, Array]:
            days = seconds / DAY
            # the loop grows and shrinks
            loop = np.tanh((side + 12e3 * np.sin(2 * np.pi * days / 27.0)) / HALF)
            # [m2/s]; zero on the left of the jet, where the shelf lies
            psi = speed * HALF * (1 + loop)
            psi_x, psi_y = (speed * (1 - loop * loop) * d for d in (side_x, side_y))
            # eddies circle about fixed positions, so that the flow looks similar on any date
            phase = 2 * np.pi * days / 60.0
            for e_lon, e_lat, radius, swirl, west, north in EDDIES:
                narrow = np.cos(np.radians(e_lat))
                c_lon = e_lon - west * 5e3 * np.sin(phase) / (METRES * narrow)
                c_lat = e_lat + north * 5e3 * np.cos(phase) / METRES
                dx, dy = (a - c_lon) * METRES * narrow, (b - c_lat) * METRES
                r = radius * 1e3  # [m] radius at which the swirl is fastest
                # On a grid a Gaussian is the outer product of one row and one column.
                row, column = (
                    swirl * r * np.exp(0.5 - dx * dx / (2 * r * r)),
                    np.exp(-dy * dy / (2 * r * r)),
                )
                psi -= row * column
                psi_x += row * dx * (narrow / squeeze / (r * r)) * column
                psi_y += row * (dy / (r * r) * column)
            turn = 2 * np.pi * seconds / TIDE
            east = -(psi_y * deep + psi * deep_y)
            north = (psi_x * deep + psi * deep_x) * (squeeze / cosine)
            return east + tide * np.cos(turn), north - tide * np.sin(turn)

        return velocity

    return flow


def _smooth_corners(line: tuple[tuple[float, float], ...]) -> Array:
    """Smooth a polyline by Chaikin's corner cutting, shape (n, 2) [deg]."""
    points = np.array(line)
    for _ in range(3):
        low, high = 0.75 * points[:-1] + 0.25 * points[1:], 0.25 * points[:-1] + 0.75 * points[1:]
        points = np.concatenate((points[:1], np.stack((low, high), 1).reshape(-1, 2), points[-1:]))
    return points


def _signed_distance(
    line: Array, squeeze: float, lon: Array, lat: Array
) -> tuple[Array, Array, Array]:
    """Return the distance [m] to a polyline and its derivatives by x and y.

    The distance is positive to the right of the polyline. The first and the last segment extend to
    infinity.
    """
    plane = np.array([squeeze, 1.0]) * METRES
    ends, x, y = line * plane, lon * plane[0], lat * plane[1]
    way = np.diff(ends, axis=0)
    low, high = np.zeros(len(way)), np.ones(len(way))
    low[0], high[-1] = -np.inf, np.inf

    def off(k: Any) -> tuple[Array, Array]:
        """Return the vector [m] to each point from the nearest point of segment k."""
        dx, dy, ux, uy = x - ends[k, 0], y - ends[k, 1], way[k, 0], way[k, 1]
        t = np.clip((dx * ux + dy * uy) / (ux * ux + uy * uy), low[k], high[k])
        return dx - t * ux, dy - t * uy

    best, nearest = np.full(np.shape(lon), np.inf), np.zeros(np.shape(lon), int)
    for k in range(len(way)):
        dx, dy = off(k)
        square = dx * dx + dy * dy
        nearest[square < best] = k
        best = np.minimum(best, square)
    dx, dy = off(nearest)
    ux, uy = way[nearest, 0], way[nearest, 1]
    right = np.sign(uy * dx - ux * dy)
    far, long = np.sqrt(best), np.hypot(ux, uy)
    on = far < 1e-3  # there the derivatives are those of the segment
    by = np.where(on, long, np.maximum(far, 1e-3))
    return right * far, np.where(on, uy, right * dx) / by, np.where(on, -ux, right * dy) / by


def _breeze(
    box: Box,
    speed: float = 7.0,
    toward: float = 300.0,
    sea_breeze: float = 2.0,
    swing: float = 20.0,
    middle: float = -88.7,
) -> Flow:
    """Return a trade wind [m/s] with a daily sea breeze and a slow synoptic swing.

    toward: mean direction [deg] that it blows to; sea_breeze: speed [m/s] of a vector that turns
    clockwise once a day; swing: amplitude [deg] of the direction, with a period of five days. The
    speed varies by a tenth with a period of four days. Direction and speed also vary over hundreds
    of kilometres: the swing's wave is 25 degrees of longitude long, counted from `middle` [deg],
    and has a discontinuity on the opposite meridian.
    """

    def flow(lon: ArrayLike, lat: ArrayLike) -> Velocity:
        x, y = _east_of(lon, middle), np.asarray(lat, float)

        def velocity(seconds: float) -> tuple[Array, Array]:
            days = seconds / DAY
            direction = np.radians(toward + swing * np.sin(2 * np.pi * (days / 5.0 + x / 25.0)))
            strength = speed * (1 + 0.1 * np.sin(2 * np.pi * (days / 4.0 - y / 20.0)))
            turn = 2 * np.pi * (days + (x + middle) / 360.0)  # in local solar time
            east = strength * np.sin(direction) + sea_breeze * np.sin(turn)
            return east, strength * np.cos(direction) + sea_breeze * np.cos(turn)

        return velocity

    return flow


# kind -> (builder, quantities that it may stand for, default grid spacing [deg])
KINDS: dict[str, tuple[Callable[..., Flow], tuple[str, ...], float]] = {
    "gulf": (_gulf, ("current",), 0.05),
    "solid_rotation": (_solid_rotation, velocities(), 0.25),
    "stommel_gyre": (_stommel_gyre, ("current",), 0.05),
    "inertial": (_inertial, ("current",), 0.25),
    "breeze": (_breeze, ("wind",), 0.25),
}


def build_flow(quantity: str, kind: str, box: Box, **parameters: float) -> tuple[Flow, float]:
    """Return a built-in flow and its default grid spacing [deg].

    Args:
        quantity: one of QUANTITIES, for which the flow is to be used.
        kind: a key of KINDS.
        box: area of the case; only some flows depend on it.
        parameters: keyword arguments of the flow's builder.

    Raises:
        UserError: the kind or a parameter is unknown, or the kind cannot be this quantity.
    """
    allowed = [name for name, (_, quantities, _) in KINDS.items() if quantity in quantities]
    if kind not in allowed:
        raise UserError(
            f'[[{quantity}]] analytic = "{kind}" is unknown; allowed: {", ".join(allowed) or "none"}'
        )
    make, _, spacing = KINDS[kind]
    try:
        return make(box, **parameters), spacing
    except TypeError as error:
        takes = make.__code__.co_varnames[1 : make.__code__.co_argcount]
        raise UserError(
            f'[[{quantity}]] analytic = "{kind}" takes {", ".join(takes)}, not {sorted(parameters)}'
        ) from error
