"""How well a contact fits each place.

The fit is the logarithm of the probability density of what was seen, given where the object was.

Contacts are Gaussian fixes, bearings, ranges and areas, each with the sensor's chance of detection
by range (docs/searches.md, "Contacts").
"""

import math

import numpy as np

from drift.evidence.filter import patterns
from drift.evidence.filter.detection import sensor_path
from drift.evidence.filter.records import Contact, Heard
from drift.evidence.sensors.records import Sonar
from geo import sphere
from geo.array import Array
from geo.polyline import Area

LOG_TURN = math.log(2 * math.pi)
BEYOND = 6.0  # standard deviations; a normal has 2e-9 of its probability beyond


def log_likelihood(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log likelihood of a contact at binary angles lon, lat, float64 (n,).

    It is -inf where the contact is impossible.

    It is a density: per m2 for positions and areas, per radian for bearings, per metre for ranges.
    Belief and false contacts are left out. Beyond 6 standard deviations, where no error is normal,
    it is -inf: a wrong digit must not look like a discovery.
    """
    with np.errstate(divide="ignore"):
        return LIKELIHOODS[contact.kind](contact, lon, lat)


def log_unit(contact: Contact) -> float:
    """Return the log of a density of the size of a contact's highest, with its false contacts and
    its motion.

    Weights are multiplied by likelihoods in units of it: so they keep near 1, where float32 has its
    digits.
    """
    if contact.kind == "position":
        unit = (
            max(math.log(fix.share) for fix in contact.fixes)
            + _highest(contact.major)
            + _highest(contact.minor)
        )
    elif contact.kind == "area":
        assert contact.area is not None
        unit = -math.log(patterns.square_metres(contact.area))
    elif contact.wedge > 0:
        unit = -math.log(contact.wedge)
    else:
        unit = _highest(_least_std(contact) if contact.kind == "bearing" else contact.range_std)
    for std in (contact.course_std, contact.speed_std, *_measured(contact.heard)):
        unit += _highest(std) if std > 0 else 0.0
    return max(unit, math.log(contact.false_density)) if contact.false_density > 0 else unit


def _least_std(contact: Contact) -> float:
    """Return the least error [rad] of a bearing, whatever the object's."""
    return min((std for _, std in contact.bearing_stds), default=contact.bearing_std)


def _measured(heard: Heard | None) -> list[float]:
    """Return how far a received level and a frequency stray, about [dB, Hz]."""
    if heard is None:
        return []
    stds = [math.hypot(heard.tone.std, heard.tone.source_std)] if heard.tone else []
    if heard.level is not None and isinstance(heard.sensor.sees, Sonar):
        stds.append(math.hypot(heard.level[1], heard.sensor.sees.fluctuation))
    return stds


def _highest(std: float) -> float:
    """Return the log of a normal's highest density."""
    return -math.log(std) - 0.5 * LOG_TURN


def log_motion(contact: Contact, east: Array, north: Array) -> Array:
    """Return the log likelihood of the course and speed of a contact, of velocities (east, north)
    [m/s] (n,).

    It is a density, per radian and per m/s. What lies still has any course.
    """
    speed = np.hypot(east, north)
    total = np.zeros(speed.shape)
    if contact.course_std > 0:
        own = normal(sphere.wrap(np.arctan2(east, north) - contact.course), contact.course_std)
        total = total + np.where(speed > 0, own, -LOG_TURN)
    if contact.speed_std > 0:
        total = total + normal(speed - contact.speed, contact.speed_std)
    return np.asarray(total)


def _area(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log of 1 / area inside it, and -inf outside."""
    assert contact.area is not None
    return np.asarray(
        np.log(inside(contact.area, lon, lat).astype(np.float64))
        - math.log(patterns.square_metres(contact.area))
    )


def _bearing(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log density of the true bearing from the sensor, between the ranges; half of it
    may be its image's.
    """
    east, north = _from_sensor(contact, lon, lat)
    far, true = np.hypot(east, north), np.arctan2(east, north)
    log_density = _off_bearing(contact, true, contact.bearing)
    if contact.heard is not None and contact.heard.mirrored:
        other = _off_bearing(contact, true, image(contact.bearing, contact.heard.heading))
        log_density = np.logaddexp(log_density, other) - math.log(2)
    log_density = np.where((far >= contact.near) & (far <= contact.far), log_density, -np.inf)
    return np.asarray(log_density + np.log(_detection(contact, far)))


def image(bearing: float, heading: float) -> float:
    """Return a bearing [rad] as an array on a heading takes it for that cannot tell port from
    starboard.
    """
    return (2 * heading - bearing) % (2 * math.pi)


def _off_bearing(contact: Contact, true: Array, told: float) -> Array:
    """Return the log density of a bearing that was told [rad] where the true ones are `true` (n,)."""
    apart = sphere.wrap(true - told)
    if contact.wedge > 0:
        return np.where(np.abs(apart) <= contact.wedge / 2, -math.log(contact.wedge), -np.inf)
    return normal(apart, bearing_std(contact, true))


def bearing_std(contact: Contact, true: Array | float) -> Array | float:
    """Return the error [rad] of a bearing of what lies at true bearings [rad], any shape."""
    if not contact.bearing_stds or contact.heard is None:
        return contact.bearing_std
    angle, std = zip(*contact.bearing_stds, strict=True)
    return np.asarray(np.interp(np.abs(sphere.wrap(true - contact.heard.heading)), angle, std))


def _range(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log of a normal of the distance from the sensor."""
    far = np.hypot(*_from_sensor(contact, lon, lat))
    return np.asarray(
        normal(far - contact.range, contact.range_std) + np.log(_detection(contact, far))
    )


def _from_sensor(contact: Contact, lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return (east, north) [m] of binary angles in the tangent plane of the sensor."""
    assert contact.sensor is not None
    at = math.radians(contact.sensor[0]), math.radians(contact.sensor[1])
    return sphere.offset(*at, lon * sphere.UNIT, lat * sphere.UNIT)


def _fixes(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log of the mixture of normals round the fixes, in their tangent planes."""
    x, y = lon * sphere.UNIT, lat * sphere.UNIT
    c, s = math.cos(contact.orientation), math.sin(contact.orientation)
    total = np.full(x.shape, -np.inf)
    for fix in contact.fixes:
        east, north = sphere.offset(math.radians(fix.lon), math.radians(fix.lat), x, y)
        along, across = north * c + east * s, east * c - north * s
        log_density = (
            normal(along, contact.major) + normal(across, contact.minor) + math.log(fix.share)
        )
        total = np.logaddexp(total, log_density)
    if contact.zones is not None and contact.sensor is not None:
        at = math.radians(contact.sensor[0]), math.radians(contact.sensor[1])
        total += np.log(_detection(contact, sphere.distance(*at, x, y)))
    return total


def normal(x: Array, std: Array | float) -> Array:
    """Return the log of a normal density, -inf beyond 6 standard deviations."""
    return np.where(
        np.abs(x) > BEYOND * std, -np.inf, -0.5 * (x / std) ** 2 - np.log(std) - 0.5 * LOG_TURN
    )


def _detection(contact: Contact, far: Array) -> Array:
    """Return the sensor's chance of detection at ranges [m]."""
    if contact.zones is None:
        return np.ones_like(far)
    chance = np.zeros_like(far)
    for inner, outer, pod in zip(
        contact.zones.inner, contact.zones.outer, contact.zones.pod, strict=True
    ):
        chance[(far >= inner) & (far < outer)] = pod
    return chance


def inside(area: Area, lon: Array, lat: Array) -> Array:
    """Return which binary angles lie inside an area, bool (n,)."""
    import shapely

    at_lon, at_lat, outline = sensor_path.ring(area)
    shape = shapely.Polygon(outline.reshape(-1, 2).astype(np.float64))
    # wraps as int32
    apart = np.subtract(lon, sphere.to_binary(at_lon)).astype(np.float64) * sphere.UNIT
    return np.asarray(
        shapely.contains_xy(
            shape, *sensor_path.chart(0.0, math.radians(at_lat), apart, lat * sphere.UNIT)
        )
    )


LIKELIHOODS = {"position": _fixes, "area": _area, "bearing": _bearing, "range": _range}
