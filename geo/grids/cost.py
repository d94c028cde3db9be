"""Interpolation error of a regridded field, sampled as particles will sample it.

Two errors are measured: at the source's points, where interpolating twice is worst; and at one
scattered position in every cell, compared with the source's own interpolation, which is what a
particle meets on average.
"""

from collections.abc import Sequence

import numpy as np

from geo import sphere
from geo.array import Array
from geo.grids import grid as grids
from geo.grids import layout
from geo.grids.grid import Grid
from geo.grids.layout import Curved, Layout, Triangles

Probe = tuple[tuple[Array, Array], Array]  # ((lon, lat) [deg], value there)


def describe_cost(
    grid: Grid,
    layouts: tuple[Layout, Layout],
    carried: tuple[Array, Array],
    source: tuple[Array, Array],
) -> str:
    """Return a note on the regridding error at the source's points and between them."""
    source = _drop_fold(layouts[0], source[0]), _drop_fold(layouts[1], source[1])
    at_points = _rms_error(
        grid, carried, [(layout.points(i), v) for i, v in zip(layouts, source, strict=True)]
    )
    between = _rms_error(
        grid, carried, [_probe_between(i, v) for i, v in zip(layouts, source, strict=True)]
    )
    return (
        f"regridding cost: rms error {between[0]:.1%} of the rms speed between the points, {at_points[0]:.1%} at "
        f"them, {at_points[1]:.1%} of wet points lost (rim and coast)"
    )


def _drop_fold(item: Layout, values: Array) -> Array:
    """Return values with NaN at the fold of a tripolar grid, where the grid's axes reverse."""
    if not isinstance(item, Curved) or item.mirror is None:
        return values
    return np.where(np.arange(len(values))[:, None] < len(values) - 2, values, np.nan)


def _probe_between(item: Layout, values: Array) -> Probe:
    """Return one scattered position in every cell, and the source's interpolated value there."""
    if isinstance(item, Triangles):
        if item.lonc is not None:
            return layout.points(item), values
        a, b = (np.sqrt(_scatter(len(item.cells), 0)), _scatter(len(item.cells), 1))
        share = np.stack((1 - a, a * (1 - b), a * b), axis=1)
        lon, lat = item.lon[item.cells], item.lat[item.cells]
        lon = sphere.near_degrees(lon, lon[:, :1])
        return ((lon * share).sum(1), (lat * share).sum(1)), (values[item.cells] * share).sum(1)
    lon, lat = layout.points(item)
    shape = (lon.shape[0] - 1, lon.shape[1] - 1)
    a, b = (_scatter(shape[0] * shape[1], k).reshape(shape) for k in (0, 1))
    unwrapped = [sphere.near_degrees(v, lon[:-1, :-1]) for v in _corners(lon)]
    weight = ((1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b)

    def blend(corners: Sequence[Array]) -> Array:
        return sum((w * v for w, v in zip(weight, corners, strict=True)), np.zeros(shape))

    if not isinstance(item, Curved):
        return (blend(unwrapped), blend(_corners(lat))), blend(_corners(values))
    # blended as vectors in space, because a cell may hold the pole
    phi, lam = np.radians(lat), np.radians(lon)
    x, y = (blend(_corners(np.cos(phi) * f(lam))) for f in (np.cos, np.sin))
    truth = blend(_corners(values))
    truth[:, ~layout.joins(item)[:-1]] = np.nan  # between columns that are not neighbours
    return (
        np.degrees(np.arctan2(y, x)),
        np.degrees(np.arctan2(blend(_corners(np.sin(phi))), np.hypot(x, y))),
    ), truth


def _corners(values: Array) -> list[Array]:
    return [values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]]


def _scatter(count: int, axis: int) -> Array:
    """Return one coordinate of Roberts's (2018) R2 sequence.

    The sequence covers the unit square evenly without a seed.
    """
    return np.asarray(
        (0.5 + np.arange(1, count + 1) * (0.7548776662466927, 0.5698402909980532)[axis]) % 1.0
    )


def _rms_error(
    grid: Grid, carried: tuple[Array, Array], probes: list[Probe]
) -> tuple[float, float]:
    """Return the rms error as a share of the rms speed, and the share of wet probes lost."""
    square = error = 0.0
    wet = kept = 0
    for values, ((lon, lat), truth) in zip(carried, probes, strict=True):
        box = grid.box
        with np.errstate(invalid="ignore"):
            inside = (lat >= box.south - 1e-6) & (lat <= box.north + 1e-6) & np.isfinite(truth)
            inside &= (lon - box.west + 1e-6) % 360.0 <= box.east - box.west + 2e-6
        sampled = grids.sample(
            grid, grids.widen(np.asarray(values, np.float32), grid), lon[inside], lat[inside]
        )
        present = np.isfinite(sampled)
        square += float((truth[inside][present] ** 2).sum())
        error += float(((sampled - truth[inside])[present] ** 2).sum())
        wet, kept = wet + len(present), kept + int(present.sum())
    return (float(np.sqrt(error / square)) if square > 0 else 0.0), (1 - kept / wet if wet else 0.0)
