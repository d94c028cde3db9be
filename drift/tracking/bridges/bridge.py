"""Brownian bridges between way points on the sphere, and their position at a time.

Nunez, Singham and Atkinson 2020, doi:10.1080/01605682.2019.1570806, equations 2 to 9, define
bridges in a plane: the mean is on the straight line, the variance K^2 s (1 - s) T is largest in the
middle, and the normal, possibly correlated errors of both ends add in the proportions 1 - s and s.
Here each leg is a great circle, so that no plane must be chosen. Deviations across it change with
the share s of the leg as neighbouring great circles part and meet (Jacobi's equation, y'' = -y on
the unit sphere). For ends an angle h apart the errors of departure and arrival have the factors
sin((1 - s) h) / sin(h) and sin(s h) / sin(h). The variance is K^2 T sin(s h) sin((1 - s) h) / (h
sin(h)), the equation's Green's function with both ends fixed. At s = 1/2 that is K^2 T tan(h/2) /
(2 h). Deviations along the leg are as in the plane. For h -> 0 everything is; the variance across
is larger than in the plane by the share h^2 s (1 - s) / 3, at most h^2/12 (0.06 % for ends 300 nmi
apart).

The distribution is of first order in the deviation: with a standard deviation d its relative error
is about (d/R)^2, 0.17 % at d = 140 nmi. 400,000 paths of 400 Euler steps in three dimensions, over
6,000 nmi, had 140.28 +- 0.16 nmi across midway and 119.98 +- 0.13 along; the model gives 140.20 and
120. Motion in each leg is independent of the ends and of the other legs.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geo import notation, sphere
from geo.array import Array

FARTHEST = np.radians(
    150.0
)  # [rad] between way points; at 180 degrees the shortest way is not unique
WIDEST = sphere.RADIUS / 2  # [m] largest standard deviation for a model of first order
# rounding allowed in a covariance's symmetry and sign, as a share of the largest variance
LOOSE = 1e-9


@dataclass(frozen=True)
class Bridge:
    """Way points in order of time, their errors, and the spread rate between them.

    lon, lat: [rad], (n,). time: [s], (n,), since 1970 or since any other moment. covariance: [m2],
    (2 n, 2 n), of the errors east and north at the first way point, east and north at the second,
    and so on. spread_rate: K [m/sqrt(s)].
    """

    lon: Array
    lat: Array
    time: Array
    covariance: Array
    spread_rate: float


@dataclass(frozen=True)
class Position:
    """Position of a bridge at some times: normal in the tangent plane of its mean.

    time: [s], (m,). lon, lat: of the mean [rad], (m,). covariance: east and north of the mean [m2],
    (m, 2, 2).
    """

    time: Array
    lon: Array
    lat: Array
    covariance: Array


@dataclass(frozen=True)
class Ways:
    """The great circles between way points.

    angle: length [rad], (n - 1,). begin, end: rotations of (east, north) at the leg's first and
    last point to (along, to the left), (n - 1, 2, 2).
    """

    angle: Array
    begin: Array
    end: Array


def between(
    lon_deg: npt.ArrayLike,
    lat_deg: npt.ArrayLike,
    time: npt.ArrayLike,
    spread_rate: float,
    covariance: npt.ArrayLike | None = None,
) -> Bridge:
    """Return the bridge between way points, two or more in order of time.

    Args:
        lon_deg: of the way points [deg], shape (n,).
        lat_deg: of the way points [deg], shape (n,).
        time: np.datetime64 in UTC, or seconds, shape (n,).
        spread_rate: K [m/sqrt(s)]; drift.case.values.units converts "12 nmi/sqrt(h)".
        covariance: of errors east and north at each way point [m2], shape (2 n, 2 n); None: exact.

    Raises:
        ValueError: the arguments define no bridge.
    """
    lon, lat = (np.radians(np.atleast_1d(np.asarray(x, np.float64))) for x in (lon_deg, lat_deg))
    moments = np.atleast_1d(np.asarray(time))
    seconds = (
        notation.epochs(moments).astype(np.float64)
        if moments.dtype.kind == "M"
        else moments.astype(np.float64)
    )
    size = 2 * lon.size
    matrix = np.zeros((size, size)) if covariance is None else np.asarray(covariance, np.float64)
    _check(lon, lat, seconds, spread_rate, matrix)
    bridge = Bridge(lon, lat, seconds, (matrix + matrix.T) / 2, float(spread_rate))
    refuse_width(widest(bridge))
    return bridge


def refuse_width(spread: float) -> None:
    """Raise ValueError, one line, for a standard deviation [m] beyond the model's validity."""
    if spread > WIDEST:
        raise ValueError(
            f"it strays by {spread / notation.NMI:,.0f} nmi (standard deviation), more than the {WIDEST / notation.NMI:,.0f} nmi that the "
            "model allows; lower the spread rate or the errors, or give way points in between"
        )


def refuse_antipodes(lon: Array, lat: Array) -> None:
    """Raise ValueError, one line, if two consecutive way points are nearly antipodal.

    Args:
        lon: of the way points [rad], shape (n,).
        lat: of the way points [rad], shape (n,).
    """
    apart = sphere.distance(lon[:-1], lat[:-1], lon[1:], lat[1:]) / sphere.RADIUS
    if apart.max(initial=0.0) > FARTHEST:
        k = int(np.argmax(apart))
        raise ValueError(
            f"way points {k + 1} and {k + 2} are {np.degrees(apart[k]):.0f} degrees apart: the track between them is hardly "
            f"known; give way points at most {np.degrees(FARTHEST):.0f} degrees apart"
        )


def widest(bridge: Bridge) -> float:
    """Return the largest standard deviation [m] in any direction.

    It is evaluated at the way points and midway between them.
    """
    middle = (bridge.time[:-1] + bridge.time[1:]) / 2
    covariance = bridge_at(bridge, np.concatenate([bridge.time, middle])).covariance
    return float(np.sqrt(np.linalg.eigvalsh(covariance).max()))


def _check(lon: Array, lat: Array, time: Array, spread_rate: float, covariance: Array) -> None:
    """Raise ValueError, one line, if the arguments define no bridge."""
    if not lon.shape == lat.shape == time.shape or lon.ndim != 1:
        raise ValueError(
            f"lon, lat and time have shapes {lon.shape}, {lat.shape} and {time.shape}; they must be one (n,)"
        )
    if lon.size < 2:
        raise ValueError(
            f"a bridge needs two way points or more, its departure and its arrival; given {lon.size}"
        )
    if not (np.isfinite(lon).all() and np.isfinite(lat).all() and np.isfinite(time).all()):
        raise ValueError("a longitude, latitude or time of the way points is not finite")
    if np.abs(lat).max() > np.pi / 2:
        raise ValueError(f"latitude {np.degrees(np.abs(lat).max()):g} is outside -90 to 90")
    steps = np.diff(time)
    if steps.min() <= 0:
        k = int(np.argmin(steps > 0))
        when = "at the time of" if steps[k] == 0 else f"{-steps[k] / 3600:g} h before"
        raise ValueError(
            f"way point {k + 2} is reached {when} way point {k + 1}; give way points in order of time"
        )
    if not 0 <= spread_rate < np.inf:
        raise ValueError(f"spread rate {spread_rate!r} must be at least 0 m/sqrt(s), and finite")
    refuse_antipodes(lon, lat)
    if covariance.shape != (2 * lon.size,) * 2 or not np.isfinite(covariance).all():
        raise ValueError(
            f"covariance has shape {covariance.shape}; must be finite and {(2 * lon.size,) * 2}, in m2"
        )
    tolerance = LOOSE * np.abs(covariance).max(initial=0.0)
    if np.abs(covariance - covariance.T).max() > tolerance:
        raise ValueError("covariance is not symmetric")
    if np.linalg.eigvalsh(covariance).min() < -tolerance:
        raise ValueError(
            "covariance is not positive semi-definite: it has a negative variance in some direction"
        )


def ways(bridge: Bridge) -> Ways:
    """Return the great circles from each way point to the next."""
    lon, lat = bridge.lon, bridge.lat
    forth = np.stack(sphere.offset(lon[:-1], lat[:-1], lon[1:], lat[1:]), -1)
    back = np.stack(sphere.offset(lon[1:], lat[1:], lon[:-1], lat[:-1]), -1)
    return Ways(np.hypot(*forth.T) / sphere.RADIUS, turned(forth), turned(-back))


def turned(ahead: Array) -> Array:
    """Return rotations (m, 2, 2) of (east, north) to (along, to the left) of directions (m, 2).

    For a direction of length 0, any rotation will do.
    """
    length = np.hypot(ahead[:, 0], ahead[:, 1])
    east, north = np.where(length > 0, ahead.T / np.where(length > 0, length, 1.0), [[1.0], [0.0]])
    return np.stack([np.stack([east, north], -1), np.stack([-north, east], -1)], -2)


def across(share: Array, angle: Array) -> Array:
    """Return sin(share h) / sin(h), which tends to the share for small angles h."""
    near = angle < 1e-7  # where it differs by less than 1e-14
    return np.where(near, share, np.sin(share * angle) / np.where(near, 1.0, np.sin(angle)))


def strayed(share: Array, later: Array, angle: Array) -> Array:
    """Return the covariance of a bridge at two times over K^2 T, along and across the leg.

    Args:
        share: of the leg's time at the earlier time, shape (...).
        later: the same at the later time, shape (...).
        angle: length of the leg [rad], shape (...).

    Returns:
        Shape (..., 2).
    """
    plane = share * (1 - later)
    # sin(s h) / (h sin(h)) sin((1 - s') h), written so that h -> 0 is safe
    bent = across(share, angle) * (1 - later) * np.sinc((1 - later) * angle / np.pi)
    return np.stack([plane, bent], -1)


def bridge_at(bridge: Bridge, time: npt.ArrayLike) -> Position:
    """Return the position of a bridge at some times (equations 2 to 9, on the sphere).

    Args:
        bridge: with its way points.
        time: np.datetime64, or seconds as in the bridge, shape (m,).

    Raises:
        ValueError: a time is before the first way point or after the last.
    """
    on = _on_legs(bridge, time)
    errors = np.einsum("mia,ab,mjb->mij", on.weights, bridge.covariance, on.weights)
    noise = bridge.spread_rate**2 * on.span[:, None] * strayed(on.share, on.share, on.angle)
    return Position(
        on.time, on.lon, on.lat, errors + np.einsum("mai,ma,maj->mij", on.turn, noise, on.turn)
    )


def joint(bridge: Bridge, time: npt.ArrayLike) -> tuple[Position, Array]:
    """Return the positions of a bridge at some times, and their joint covariance.

    Args:
        bridge: with its way points.
        time: np.datetime64, or seconds as in the bridge, shape (m,).

    Returns:
        The positions, and the covariance [m2], shape (2 m, 2 m): east and north at the first time,
            east and north at the second, and so on.
    """
    on = _on_legs(bridge, time)
    size = on.time.size
    weights = on.weights.reshape(2 * size, -1)
    joint_covariance = weights @ bridge.covariance @ weights.T
    first, second = np.broadcast_arrays(np.arange(size)[:, None], np.arange(size))
    low, high = (
        np.minimum(on.share[first], on.share[second]),
        np.maximum(on.share[first], on.share[second]),
    )
    noise = bridge.spread_rate**2 * on.span[first][..., None] * strayed(low, high, on.angle[first])
    # deviations in different legs are independent
    noise = noise * (on.leg[first] == on.leg[second])[..., None]
    joint_covariance = joint_covariance + np.einsum(
        "mai,mna,naj->minj", on.turn, noise, on.turn
    ).reshape(joint_covariance.shape)
    blocks = joint_covariance.reshape(size, 2, size, 2)[np.arange(size), :, np.arange(size)]
    return Position(on.time, on.lon, on.lat, blocks), joint_covariance


@dataclass(frozen=True)
class _OnLegs:
    """Times of a bridge on its legs; every array begins with the axis of times, (m, ..).

    leg: index of the leg. share: elapsed share of its time. span: its time [s]. angle: its length
    [rad]. lon, lat: of the mean [rad]. turn: rotation of (east, north) there to (along, to the
    left), (m, 2, 2). weights: factors of the way points' errors east and north there, (m, 2, 2 n).
    """

    time: Array
    leg: Array
    share: Array
    span: Array
    angle: Array
    lon: Array
    lat: Array
    turn: Array
    weights: Array


def _on_legs(bridge: Bridge, time: npt.ArrayLike) -> _OnLegs:
    """Return times of a bridge on its legs; raise ValueError for a time outside."""
    moments = np.atleast_1d(np.asarray(time))
    seconds = (
        notation.epochs(moments).astype(np.float64)
        if moments.dtype.kind == "M"
        else moments.astype(np.float64)
    )
    begin, end = bridge.time[0], bridge.time[-1]
    if not ((seconds >= begin) & (seconds <= end)).all():
        outside = np.extract(~((seconds >= begin) & (seconds <= end)), seconds)[0]
        raise ValueError(
            f"{(outside - begin) / 3600:g} h after departure is outside the bridge, which lasts {(end - begin) / 3600:g} h"
        )
    legs = ways(bridge)
    leg = np.clip(np.searchsorted(bridge.time, seconds, "right") - 1, 0, bridge.time.size - 2)
    span = np.diff(bridge.time)[leg]
    share = (seconds - bridge.time[leg]) / span
    x0, y0, x1, y1 = bridge.lon[leg], bridge.lat[leg], bridge.lon[leg + 1], bridge.lat[leg + 1]
    east, north = sphere.offset(x0, y0, x1, y1)
    lon, lat = sphere.destination(x0, y0, east * share, north * share)
    ahead, back = sphere.offset(lon, lat, x1, y1), sphere.offset(lon, lat, x0, y0)
    turn = turned(
        np.stack([np.where(share < 0.5, a, -b) for a, b in zip(ahead, back, strict=True)], -1)
    )
    angle = legs.angle[leg]
    departure = np.stack([1 - share, across(1 - share, angle)], -1)
    arrival = np.stack([share, across(share, angle)], -1)
    weights = np.zeros((seconds.size, 2, 2 * bridge.lon.size))
    row = np.arange(seconds.size)[:, None, None]
    column = 2 * leg[:, None, None] + np.arange(2)
    side = np.arange(2)[:, None]
    weights[row, side, column] = np.einsum("mai,ma,maj->mij", turn, departure, legs.begin[leg])
    weights[row, side, column + 2] = np.einsum("mai,ma,maj->mij", turn, arrival, legs.end[leg])
    return _OnLegs(seconds, leg, share, span, angle, lon, lat, turn, weights)
