"""Rhumb lines, tangent planes and triangular laws in float64 that share no code with ours."""

import numpy as np

RADIUS, NMI, HOUR = 6_371_008.8, 1852.0, 3600.0
MILE = NMI / RADIUS  # [rad]


def triangle(rng, law, n):
    low, best, high, ratio = law
    return np.where(
        rng.random(n) >= 2 / (1 + ratio),
        rng.triangular(low, best, high, n),
        rng.uniform(low, high, n),
    )


def rhumb(lon, lat, course, far):
    """Return where a constant course [deg] leads from a place [deg] in so many miles."""
    isometric = np.arctanh(np.sin(np.radians(lat)))
    end = lat + far * np.degrees(MILE) * np.cos(np.radians(course))
    grown = np.arctanh(np.sin(np.radians(end))) - isometric
    due = np.abs(end - lat) < 1e-7  # east or west, where both are 0
    slope = np.where(due, np.cos(np.radians(lat)), np.radians(end - lat) / np.where(due, 1, grown))
    return lon + far * np.degrees(MILE) * np.sin(np.radians(course)) / slope, end


def plane(lon, lat, about):
    """Return (east, north) [nmi] of places [deg] in the tangent plane of one, (n, 2)."""
    lon, lat, at = np.radians(lon - about[0]), np.radians(lat), np.radians(about[1])
    x = np.cos(lat) * np.sin(lon)
    y = np.cos(at) * np.sin(lat) - np.sin(at) * np.cos(lat) * np.cos(lon)
    far = (
        np.arctan2(
            np.hypot(x, y), np.sin(at) * np.sin(lat) + np.cos(at) * np.cos(lat) * np.cos(lon)
        )
        / MILE
    )
    return np.stack([x, y], axis=-1) * (far / np.hypot(x, y))[..., None]


def out_of(offset, about):
    """Return the places [deg] that are so far (east, north) [nmi] in the tangent plane of one."""
    far = np.linalg.norm(offset, axis=-1) * MILE
    east, north = (offset / np.linalg.norm(offset, axis=-1, keepdims=True)).T
    at = np.radians(about[1])
    lat = np.arcsin(np.sin(at) * np.cos(far) + np.cos(at) * np.sin(far) * north)
    lon = np.arctan2(
        east * np.sin(far), np.cos(far) * np.cos(at) - np.sin(far) * np.sin(at) * north
    )
    return about[0] + np.degrees(lon), np.degrees(lat)
