"""Likelihood of a contact: the log probability density of the observation, given the position.

Contacts are Gaussian fixes, bearings, ranges and areas, each with the sensor's probability of
detection by range (docs/searches.md, "Contacts").
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

    It is a density: per m2 for positions and areas, per radian for bearings, per metre for ranges.
    Belief and false contacts are not included. It is -inf beyond 6 standard deviations, where no
    error is normal, so that a wrong digit does not look like a discovery.
    """
    with np.errstate(divide="ignore"):
        return LIKELIHOODS[contact.kind](contact, lon, lat)


def log_unit(contact: Contact) -> float:
    """Return the log of a density of about the maximum of a contact's likelihood.

    False contacts and motion are included. Weights are multiplied by likelihoods in this unit,
    which keeps them near 1, where float32 is precise.
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
    """Return the smallest standard deviation [rad] of a bearing over all relative bearings."""
    return min((std for _, std in contact.bearing_stds), default=contact.bearing_std)


def _measured(heard: Heard | None) -> list[float]:
    """Return the standard deviations of a received level [dB] and a frequency [Hz], if measured."""
    if heard is None:
        return []
    stds = [math.hypot(heard.tone.std, heard.tone.source_std)] if heard.tone else []
    if heard.level is not None and isinstance(heard.sensor.sees, Sonar):
        stds.append(math.hypot(heard.level[1], heard.sensor.sees.fluctuation))
    return stds


def _highest(std: float) -> float:
    """Return the log of the maximum of a normal density."""
    return -math.log(std) - 0.5 * LOG_TURN


def log_motion(contact: Contact, east: Array, north: Array) -> Array:
    """Return the log likelihood of a contact's course and speed.

    It is a density, per radian and per m/s. A target at rest has any course.

    Args:
        contact: with a course, a speed or both.
        east: velocity of the particles [m/s], shape (n,).
        north: velocity of the particles [m/s], shape (n,).

    Returns:
        Log densities, shape (n,).
    """
    speed = np.hypot(east, north)
    total = np.zeros(speed.shape)
    if contact.course_std > 0:
        own = log_normal_density(
            sphere.wrap(np.arctan2(east, north) - contact.course), contact.course_std
        )
        total = total + np.where(speed > 0, own, -LOG_TURN)
    if contact.speed_std > 0:
        total = total + log_normal_density(speed - contact.speed, contact.speed_std)
    return np.asarray(total)


def _area(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log of 1 / area inside the contact's area, and -inf outside."""
    assert contact.area is not None
    return np.asarray(
        np.log(is_in_area(contact.area, lon, lat).astype(np.float64))
        - math.log(patterns.square_metres(contact.area))
    )


def _bearing(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log density of a bearing, given the particles' bearings from the sensor.

    It is -inf outside the contact's ranges. If the array cannot tell port from starboard, bearing
    and image each have half of the density.
    """
    east, north = _from_sensor(contact, lon, lat)
    far, true = np.hypot(east, north), np.arctan2(east, north)
    log_density = _off_bearing(contact, true, contact.bearing)
    if contact.heard is not None and contact.heard.mirrored:
        other = _off_bearing(
            contact, true, mirrored_bearing(contact.bearing, contact.heard.heading)
        )
        log_density = np.logaddexp(log_density, other) - math.log(2)
    log_density = np.where((far >= contact.near) & (far <= contact.far), log_density, -np.inf)
    return np.asarray(log_density + np.log(_detection(contact, far)))


def mirrored_bearing(bearing: float, heading: float) -> float:
    """Return the mirror image of a bearing [rad] about the heading of an array."""
    return (2 * heading - bearing) % (2 * math.pi)


def _off_bearing(contact: Contact, true: Array, told: float) -> Array:
    """Return the log density of a measured bearing `told` [rad], given the true ones (n,)."""
    apart = sphere.wrap(true - told)
    if contact.wedge > 0:
        return np.where(np.abs(apart) <= contact.wedge / 2, -math.log(contact.wedge), -np.inf)
    return log_normal_density(apart, bearing_std(contact, true))


def bearing_std(contact: Contact, true: Array | float) -> Array | float:
    """Return the standard deviation [rad] of a bearing for true bearings [rad], any shape."""
    if not contact.bearing_stds or contact.heard is None:
        return contact.bearing_std
    angle, std = zip(*contact.bearing_stds, strict=True)
    return np.asarray(np.interp(np.abs(sphere.wrap(true - contact.heard.heading)), angle, std))


def _range(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log density of a range, given the particles' distances from the sensor."""
    far = np.hypot(*_from_sensor(contact, lon, lat))
    return np.asarray(
        log_normal_density(far - contact.range, contact.range_std)
        + np.log(_detection(contact, far))
    )


def _from_sensor(contact: Contact, lon: Array, lat: Array) -> tuple[Array, Array]:
    """Return the offset (east, north) [m] of binary angles, in the sensor's tangent plane."""
    assert contact.sensor is not None
    at = math.radians(contact.sensor[0]), math.radians(contact.sensor[1])
    return sphere.offset(*at, lon * sphere.UNIT, lat * sphere.UNIT)


def _fixes(contact: Contact, lon: Array, lat: Array) -> Array:
    """Return the log of the mixture of normals about the fixes, in their tangent planes."""
    x, y = lon * sphere.UNIT, lat * sphere.UNIT
    c, s = math.cos(contact.orientation), math.sin(contact.orientation)
    total = np.full(x.shape, -np.inf)
    for fix in contact.fixes:
        east, north = sphere.offset(math.radians(fix.lon), math.radians(fix.lat), x, y)
        along, across = north * c + east * s, east * c - north * s
        log_density = (
            log_normal_density(along, contact.major)
            + log_normal_density(across, contact.minor)
            + math.log(fix.share)
        )
        total = np.logaddexp(total, log_density)
    if contact.zones is not None and contact.sensor is not None:
        at = math.radians(contact.sensor[0]), math.radians(contact.sensor[1])
        total += np.log(_detection(contact, sphere.distance(*at, x, y)))
    return total


def log_normal_density(x: Array, std: Array | float) -> Array:
    """Return the log of a normal density, -inf beyond 6 standard deviations."""
    return np.where(
        np.abs(x) > BEYOND * std, -np.inf, -0.5 * (x / std) ** 2 - np.log(std) - 0.5 * LOG_TURN
    )


def _detection(contact: Contact, far: Array) -> Array:
    """Return the sensor's probability of detection at ranges [m]."""
    if contact.zones is None:
        return np.ones_like(far)
    chance = np.zeros_like(far)
    for inner, outer, pod in zip(
        contact.zones.inner, contact.zones.outer, contact.zones.pod, strict=True
    ):
        chance[(far >= inner) & (far < outer)] = pod
    return chance


def is_in_area(area: Area, lon: Array, lat: Array) -> Array:
    """Return which binary angles lie inside an area, bool (n,)."""
    import shapely

    at_lon, at_lat, outline = sensor_path.ring(area)
    shape = shapely.Polygon(outline.reshape(-1, 2).astype(np.float64))
    # the int32 difference wraps at the antimeridian
    apart = np.subtract(lon, sphere.to_binary(at_lon)).astype(np.float64) * sphere.UNIT
    return np.asarray(
        shapely.contains_xy(
            shape, *sensor_path.chart(0.0, math.radians(at_lat), apart, lat * sphere.UNIT)
        )
    )


LIKELIHOODS = {"position": _fixes, "area": _area, "bearing": _bearing, "range": _range}
