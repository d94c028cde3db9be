"""Great circles by unit vectors and rotations alone, for the oracles of lanes and corridors.

Nothing of drift, geo or kernels is used. Points are unit vectors, shape (..., 3), directions
tangents at them.
"""

import numpy as np

R = 6_371_008.8  # [m] mean radius of the Earth
NMI = 1852.0
Array = np.ndarray


def point(lon: Array, lat: Array) -> Array:
    """Return points [rad] as unit vectors."""
    lon, lat = np.asarray(lon, float), np.asarray(lat, float)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def lonlat(p: Array) -> tuple[Array, Array]:
    """Return (lon, lat) [rad] of unit vectors."""
    return np.arctan2(p[..., 1], p[..., 0]), np.arcsin(np.clip(p[..., 2], -1, 1))


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def distance(p: Array, q: Array) -> Array:
    """Return the length [m] of great circles, by the chord: good to 1e-9 for what is under a
    quarter of a turn.
    """
    return 2 * R * np.arcsin(np.linalg.norm(p - q, axis=-1) / 2)


def tangent(p: Array, q: Array) -> Array:
    """Return the direction at p in which q lies."""
    return unit(q - np.sum(p * q, axis=-1, keepdims=True) * p)


def heading(p: Array, bearing: Array) -> Array:
    """Return the direction at p of a bearing [rad, clockwise from north]."""
    east = unit(np.cross([0.0, 0.0, 1.0], p))
    return np.sin(bearing)[..., None] * east + np.cos(bearing)[..., None] * np.cross(p, east)


def walk(p: Array, direction: Array, length: Array) -> Array:
    """Return where a great circle leads from p in a direction after a length [m]."""
    angle = np.asarray(length)[..., None] / R
    return np.cos(angle) * p + np.sin(angle) * direction


def part(p: Array, q: Array, share: Array) -> Array:
    """Return the points at shares of the great circles from p to q."""
    return walk(p, tangent(p, q), share * distance(p, q))


def starboard(p: Array, q: Array, x: Array) -> Array:
    """Return how far [m] points x lie to the right of the great circles from p to q."""
    return R * np.arcsin(-np.sum(unit(np.cross(p, q)) * x, axis=-1))


def rotation(seed: int) -> Array:
    """Return a rotation, each as likely as any other: by the QR decomposition of a normal matrix."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)
