"""Grid points without coordinates: fill values, or blocks of land that a model leaves out.

NEMO writes lon = lat = 0 (or -1) for subdomains without a process, which are all land; other files
leave coordinates out wherever there is land. Such points have no position: they are corners of no
cell, and no extent includes them.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from geo import notation
from geo.array import Array
from geo.grids.layout import Curved

FARTHEST = (720.0, 90.001)  # [deg] largest absolute longitude and latitude
POLE = 89.9  # [deg] beyond this latitude many points may share one longitude and latitude
AROUND = [(dj, di) for dj in (-1, 0, 1) for di in (-1, 0, 1) if (dj, di) != (0, 0)]


def drop_missing_points(lon: Array, lat: Array, notes: list[str]) -> tuple[Array, Array]:
    """Return coordinates [deg] with NaN at points without a position.

    These have a fill value (one number beyond all degrees) or lie in a block: points of two
    neighbouring rows and columns with the same pair of numbers. Outside a block the same pair may
    be a regular point. A note goes to `notes`.
    """
    coordinates = [np.array(lon), np.array(lat)]
    with np.errstate(invalid="ignore"):
        for values, most in zip(coordinates, FARTHEST, strict=True):
            fill_value = np.abs(values) > most
            if (
                fill_value.any()
                and not fill_value.all()
                and len(np.unique(values[fill_value])) == 1
            ):
                values[fill_value] = np.nan
        if lon.ndim == 2 and lon.shape == lat.shape:
            block = _in_blocks(*coordinates)
            if block.any():
                first = np.argmax(block)
                where = f"{np.ravel(lon)[first]:g} E, {np.ravel(lat)[first]:g} N"
                notes.append(
                    f"{notation.percent(block.mean())} of the points have no position of their own ({where}): treated as land"
                )
                coordinates = [np.where(block, np.nan, values) for values in coordinates]
    return coordinates[0], coordinates[1]


def _in_blocks(lon: Array, lat: Array) -> NDArray[np.bool_]:
    """Return the points in blocks of points that share one position."""
    same = np.abs(lat[:-1, :-1]) < POLE
    for values in (lon, lat):
        for other in (values[:-1, 1:], values[1:, :-1], values[1:, 1:]):
            same &= values[:-1, :-1] == other
    in_block = np.zeros(lon.shape, bool)
    for place in np.unique(np.stack((lon[:-1, :-1][same], lat[:-1, :-1][same])), axis=1).T:
        equal = (lon == place[0]) & (lat == place[1])
        padded = np.pad(equal, 1)
        shape = equal.shape
        beside = [
            padded[1 + dj : 1 + dj + shape[0], 1 + di : 1 + di + shape[1]] for dj, di in AROUND
        ]
        in_block |= equal & np.any(beside, axis=0)
    return in_block


def extended(curved: Curved) -> Curved:
    """Return a grid with coordinates extrapolated to missing points next to known ones.

    A wet point next to land needs all four corners of its cells. A missing point becomes the mean
    of all extrapolations along straight lines and parallelograms through its known neighbours,
    which is exact to second order in the cell size.
    """
    present = np.isfinite(curved.lon) & np.isfinite(curved.lat)
    if present.all() or not present.any():
        return curved
    ny, nx = present.shape
    goes_round = curved.joined is not None and bool(curved.joined[-1])
    phi, lam = np.radians(curved.lat), np.radians(curved.lon)
    place = np.stack((np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)), -1)
    row, column = np.nonzero(~present)

    def at(dj: int, di: int) -> Array:
        j, i = row + dj, column + di
        inside = np.asarray((j >= 0) & (j < ny) & (goes_round | ((i >= 0) & (i < nx))), bool)
        return np.asarray(np.where(inside[:, None], place[np.clip(j, 0, ny - 1), i % nx], np.nan))

    guesses = [2 * at(dj, di) - at(2 * dj, 2 * di) for dj, di in AROUND]
    guesses += [at(dj, 0) + at(0, di) - at(dj, di) for dj in (-1, 1) for di in (-1, 1)]
    usable = [np.asarray(np.isfinite(guess).all(axis=1), bool) for guess in guesses]
    total = sum(
        (np.where(ok[:, None], guess, 0.0) for ok, guess in zip(usable, guesses, strict=True)),
        np.zeros(3),
    )
    reached = np.asarray(np.any(np.stack(usable), axis=0), bool)
    x, y, z = total[reached].T
    lon, lat = curved.lon.copy(), curved.lat.copy()
    lon[row[reached], column[reached]] = np.degrees(np.arctan2(y, x))
    lat[row[reached], column[reached]] = np.degrees(np.arctan2(z, np.hypot(x, y)))
    return replace(curved, lon=lon, lat=lat)
