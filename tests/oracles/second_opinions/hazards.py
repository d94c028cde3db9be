"""Fields of hazard in netCDF files, and posteriors of distress along a voyage in float64."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr
from scipy import stats

RADIUS = 6_371_008.8  # [m] of the sphere, as in geo.sphere


def write(path: Path, values: np.ndarray, lon, lat, name: str = "hazard", **attributes) -> Path:
    """Write a field (lat, lon), or (time, lat, lon) with `hours` in the attributes; return path."""
    hours = attributes.pop("hours", None)
    axes = {
        "lat": ("lat", np.asarray(lat, float), {"units": "degrees_north"}),
        "lon": ("lon", np.asarray(lon, float), {"units": "degrees_east"}),
    }
    dims: tuple[str, ...] = ("lat", "lon")
    if hours is not None:
        units = {"units": "hours since 2026-11-21 00:00"}
        axes["time"] = ("time", np.asarray(hours, float), units)
        dims = ("time", *dims)
    data = xr.Dataset({name: (dims, values, {"units": "1", **attributes})}, coords=axes)
    data.to_netcdf(path)
    return path


def great_circle(a: tuple[float, float], b: tuple[float, float], share: np.ndarray) -> np.ndarray:
    """Return unit vectors (n, 3) at shares of the arc between places [deg], by slerp."""
    u, v = (_vector(*place) for place in (a, b))
    arc = np.arccos(u @ v)
    at = np.sin((1 - share) * arc)[:, None] * u + np.sin(share * arc)[:, None] * v
    return at / np.sin(arc)


def posterior(
    a: tuple[float, float],
    b: tuple[float, float],
    cross_track: float,
    law: Callable[[np.ndarray], np.ndarray],
    hazard: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return shares of one great-circle leg, distances to its right [m], and their joint
    probability, on a lattice of cells.

    Args:
        a: begin [deg].
        b: end [deg].
        cross_track: standard deviation [m].
        law: density of the share without the hazard.
        hazard: of share, longitude [deg] and latitude [deg].
    """
    share = (np.arange(3000) + 0.5) / 3000
    sigma = (np.arange(121) + 0.5) / 121 * 10 - 5
    on = great_circle(a, b, share)
    pole = np.cross(_vector(*b), _vector(*a))  # to the right of the leg
    pole /= np.linalg.norm(pole)
    angle = (sigma * cross_track / RADIUS)[:, None]
    at = on[:, None, :] * np.cos(angle) + pole * np.sin(angle)
    lon = np.degrees(np.arctan2(at[..., 1], at[..., 0]))
    lat = np.degrees(np.arcsin(at[..., 2]))
    joint = law(share)[:, None] * stats.norm.pdf(sigma) * hazard(share[:, None], lon, lat)
    return share, sigma * cross_track, joint / joint.sum()


def right_of(a: tuple[float, float], b: tuple[float, float], lon, lat) -> np.ndarray:
    """Return the distance of places [deg] to the right of a great circle [m]."""
    pole = np.cross(_vector(*b), _vector(*a))
    pole /= np.linalg.norm(pole)
    at = np.stack([_vector(x, y) for x, y in zip(lon, lat, strict=True)])
    return RADIUS * np.arcsin(at @ pole)


def _vector(lon: float, lat: float) -> np.ndarray:
    x, y = np.radians(lon), np.radians(lat)
    return np.array([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)])
