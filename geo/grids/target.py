"""The regular grid to which other grids are interpolated: its spacing and its extent."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geo import sphere
from geo.array import Array
from geo.box import Box
from geo.grids import layout as lay
from geo.grids.grid import Grid
from geo.grids.layout import Axes, Curved, Layout, Plane, Triangles, uniform

# ratio of the source's spacing to the target's (NorKyst-800: rms error of a component 0.7 %, with
# equal spacing 1.9 %)
FINER = 2.0
MOST_NODES = 4_000_000  # largest number of nodes of a target grid, 32 MB per slice
POLAR = 75.0  # [deg] latitude beyond which cells may contain a pole


@dataclass
class Extent:
    """Combined extent of layouts: longitudes, latitudes and finest spacing [deg].

    Longitudes are rounded to a hundredth of a degree.
    """

    lon: Array = field(default_factory=lambda: np.empty(0))
    south: float = np.inf
    north: float = -np.inf
    step: float = np.inf

    def add(self, item: Layout) -> None:
        """Extend it by a layout."""
        lon, lat = (np.ravel(v) for v in lay.points(item))
        finite = np.isfinite(lon) & np.isfinite(lat)
        south, north = _latitude_range(item, lat[finite])
        rounded = np.concatenate((np.floor(lon[finite] * 100), np.ceil(lon[finite] * 100))) / 100
        self.lon = np.unique(np.concatenate((self.lon, rounded)))
        self.south, self.north = min(self.south, south), max(self.north, north)
        self.step = min(self.step, lay.spacing(item))


def over(extent: Extent, box: Box | None) -> tuple[Grid, bool]:
    """Return the regular grid over an extent, and whether MOST_NODES made it coarser."""
    return _limit_nodes(
        _grid_over(extent.lon, extent.south, extent.north, extent.step / FINER, box)
    )


def choose(layouts: Sequence[Layout], box: Box | None) -> tuple[Grid, bool]:
    """Return the regular grid for layouts, and whether MOST_NODES made it coarser than wanted.

    box: needed area; None for the layouts' whole extent.
    """
    first = layouts[0]
    if all(isinstance(item, Axes) for item in layouts):
        grid = _target_of_axes([item for item in layouts if isinstance(item, Axes)])
    else:
        step = min(lay.spacing(item) for item in layouts) / FINER
        lon, lat = (np.ravel(v) for v in lay.points(first))
        if isinstance(first, Triangles):
            lon, lat = (
                first.lon[np.unique(first.cells[first.cells >= 0])],
                first.lat[np.unique(first.cells[first.cells >= 0])],
            )
        finite = np.isfinite(lon) & np.isfinite(lat)
        lon, lat = lon[finite], lat[finite]
        grid = _grid_over(lon, *_latitude_range(first, lat), step, box)
    return _limit_nodes(grid)


def _grid_over(lon: Array, low: float, high: float, step: float, box: Box | None) -> Grid:
    """Return the regular grid over longitudes and a range of latitudes.

    step: spacing [deg of a great circle].
    """
    south, north = low, high
    if box is not None:
        south, north = max(south, box.south - 2 * step), min(north, box.north + 2 * step)
    nearest_equator = 0.0 if south < 0 < north else min(abs(south), abs(north))
    # at the widest parallel the spacing must be fine enough
    dlon = step / max(0.02, np.cos(np.radians(nearest_equator)))
    west, width = _shortest_arc(lon, 4 * FINER * dlon)
    if box is not None and box.east - box.west < 350.0:
        west, width = _shared_arc(west, width, box.west - 2 * dlon, box.east - box.west + 4 * dlon)
    return _build_grid(west, south, width, max(north - south, step), dlon, step)


def _limit_nodes(grid: Grid) -> tuple[Grid, bool]:
    """Return a grid with at most MOST_NODES nodes, and whether it had to be made coarser."""
    coarser = np.sqrt(grid.nlon * grid.nlat / MOST_NODES)
    if coarser > 1:
        width, height = (grid.nlon - 1) * grid.dlon, (grid.nlat - 1) * grid.dlat
        grid = _build_grid(
            grid.lon0, grid.lat0, width, height, grid.dlon * coarser, grid.dlat * coarser
        )
    return grid, bool(coarser > 1)


def _latitude_range(item: Layout, lat: Array) -> tuple[float, float]:
    """Return a layout's (south, north) [deg], given its points' latitudes.

    A pole inside a cell is included.
    """
    south, north = float(lat.min()), float(lat.max())
    if isinstance(item, Plane) and max(-south, north) > POLAR:
        pole = float(np.copysign(90.0, south + north))
        (x,), (y,) = item.to_plane(np.array([0.0]), np.array([pole]))
        if min(item.x) <= x <= max(item.x) and min(item.y) <= y <= max(item.y):
            return min(south, pole), max(north, pole)
    if not isinstance(item, Curved) or max(-south, north) < POLAR:
        return south, north
    polar = (np.fmax.reduce(np.abs(item.lat), axis=1) > POLAR)[:-1]
    corners = np.concatenate(
        (lay.cells(item, np.nonzero(polar)[0]).reshape(-1, 4), lay.fold_cells(item))
    )
    _, _, low, high = lay.extents(np.ravel(item.lon)[corners], np.ravel(item.lat)[corners])
    return float(np.fmin.reduce(low, initial=south)), float(np.fmax.reduce(high, initial=north))


def _shared_arc(west: float, width: float, start: float, span: float) -> tuple[float, float]:
    """Return (west, width) [deg] of the intersection of an arc of longitudes and a wanted one.

    If it is in two pieces, the whole wanted arc is returned.
    """
    if width >= 360.0:
        return start, span
    offset = (start - west) % 360.0
    ahead, behind = min(width, offset + span) - offset, min(width, offset + span - 360.0)
    if ahead > 0 and behind > 0:
        return start, span
    return (west, behind) if behind > ahead else (start, max(ahead, 0.0))


def _build_grid(
    west: float, south: float, width: float, height: float, dlon: float, dlat: float
) -> Grid:
    """Return the grid with this extent [deg] and a spacing of at most (dlon, dlat) [deg]."""
    nlat = max(2, int(np.ceil(height / dlat - 1e-6)) + 1)
    if width >= 360.0 - 1e-9:
        n = int(np.ceil(360.0 / dlon - 1e-6))
        return Grid(-180.0, float(south), 360.0 / n, float(height / (nlat - 1)), n + 1, nlat)
    nlon = max(2, int(np.ceil(width / dlon - 1e-6)) + 1)
    west = sphere.wrap_degrees(west)
    return Grid(
        float(west),
        float(south),
        float(max(width, dlon) / (nlon - 1)),
        float(height / (nlat - 1)),
        nlon,
        nlat,
    )


def _shortest_arc(lon: Array, gap: float) -> tuple[float, float]:
    """Return (west, width) [deg] of the shortest arc with all longitudes.

    It is 360 wide if no gap is wider than `gap`.
    """
    turned = np.unique(np.round(lon % 360.0, 9))
    gaps = np.diff(np.concatenate((turned, turned[:1] + 360.0)))
    widest = int(np.argmax(gaps))
    if gaps[widest] <= gap:
        return -180.0, 360.0
    west = float(turned[(widest + 1) % len(turned)])
    return west, float(360.0 - gaps[widest])


def _target_of_axes(several: Sequence[Axes]) -> Grid:
    """Return a grid with the axes that are uniform and shared.

    Other axes get half of their lower-quartile step.
    """
    first = several[0]

    def line(key: str) -> tuple[float, float, float]:
        all_values = [getattr(a, key) for a in several]
        values = all_values[0]
        shared = all(
            len(v) == len(values) and np.allclose(v, values, atol=1e-6) for v in all_values
        )
        low, high = max(float(v[0]) for v in all_values), min(float(v[-1]) for v in all_values)
        if shared and uniform(values):
            return low, high, (high - low) / (len(values) - 1)
        step = min(float(np.percentile(np.diff(v), 25)) for v in all_values) / FINER
        return low, high, step

    west, east, dlon = line("lon")
    south, north, dlat = line("lat")
    width = 360.0 if first.round else east - west
    if first.round:
        grid = _build_grid(west, south, 360.0, north - south, dlon, dlat)
        return Grid(west, south, grid.dlon, grid.dlat, grid.nlon, grid.nlat)
    return _build_grid(west, south, width, north - south, dlon, dlat)
