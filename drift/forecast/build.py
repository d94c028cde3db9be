"""Builds the forecast products from the particles: maps, containment areas, contours, mean tracks.

Computations are float64 NumPy on fixed-point deposits in a fixed order, so the same snapshots give
the same bits on any number of threads. A map covers the object adrift or ashore. Particles outside
the forcing, departed, sunk or not yet released are counted in `status_probability`, which adds up
to 1, but are on no map. Longitudes continue across the antimeridian, eastward from the grid's
western edge. The particles are read part by part (drift.engine.particles.snapshot).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
import shapely
import xarray as xr
from scipy import ndimage

from drift.engine.particles.snapshot import Deal, Output, answer_here
from drift.forecast import areas, cloud, containment, density, likeliest, survey
from drift.forecast.cloud import Cloud
from drift.forecast.likeliest import Shown
from drift.forecast.products import dataset
from drift.forecast.shares import SHARES
from drift.forecast.survey import Survey
from drift.products.files import copies
from geo import sphere
from geo.array import Array
from geo.cells import QUANTUM, Cells, IsLand
from geo.errors import UserError
from kernels.runtime import runtime

MOST_COPIES = 4  # copies of this process that compute maps, some 50 MB each
WORTH = 1_000_000  # cells of all maps from which copies gain more than starting them costs
ACROSS = 360  # most cells across the forecast's grid
ACROSS_ONE = 840  # most cells across the finer grid of a single snapshot
MOST_ONE = 1_500_000  # most cells of a snapshot on a user-defined grid
METRE = 1 / (sphere.RADIUS * sphere.UNIT)  # [binary angle unit] along a meridian


@dataclass(frozen=True)
class Contour:
    """Outline [deg, unwrapped] of the containment area of a share at one time."""

    time: np.datetime64
    share: float
    area: float  # [m2]
    polygon: shapely.MultiPolygon


@dataclass(frozen=True)
class Forecast:
    """All forecast products; `data` is the content of forecast.nc
    (drift.forecast.products.dataset).
    """

    data: xr.Dataset
    contours: tuple[Contour, ...]

    @property
    def probability(self) -> xr.DataArray:
        """Probability that the object is in a cell, adrift or ashore (time, lat, lon)."""
        return self.data["probability"]

    def containment_at(self, time: np.datetime64, lon: npt.ArrayLike, lat: npt.ArrayLike) -> Array:
        """Return the containment at points [deg], (n,): see drift.forecast.containment."""
        return containment.containment_at(self.data, time, lon, lat)

    @property
    def shares(self) -> tuple[float, ...]:
        """Shares of the containment areas, ascending."""
        return tuple(float(share) for share in self.data["share"].values)

    @property
    def ends(self) -> tuple[float, ...]:
        """The smallest and the largest share, which small maps show."""
        return tuple(dict.fromkeys((self.shares[0], self.shares[-1])))


@dataclass(frozen=True)
class _Laid:
    """A snapshot's deposits in its own cells, and which of these are land, (nlat, nlon); None
    without land.
    """

    cells: Cells
    deposits: areas.Deposits
    land: Array | None


def build_forecast(
    outputs: Sequence[Output],
    *,
    scenarios: Sequence[str],
    is_land: IsLand | None = None,
    shares: tuple[float, ...] = SHARES,
    grid: Cells | None = None,
    tell: Callable[[float], None] = lambda share: None,
    deal: Deal = answer_here,
) -> Forecast:
    """Return the forecast products of the particles at some times.

    Args:
        outputs: the particles at each time.
        scenarios: names, in order of their numbers.
        is_land: takes int32 binary angles (lon, lat), each (n,), and returns bool (n,); cells that
            hold particles always count as reachable.
        shares: of the containment areas, ascending.
        grid: of the forecast; None: it follows the particles. Maps are computed on subdivisions of
            its cells wherever there are particles, so areas and containment include probability
            outside the grid.
        tell: takes the share of the work that is done.
        deal: reads the particles.
    """
    return _prepare(outputs, scenarios, is_land, shares, grid, ahead=False, deal=deal)(tell)


def begin(
    outputs: Sequence[Output],
    *,
    scenarios: Sequence[str],
    is_land: IsLand | None = None,
    shares: tuple[float, ...] = SHARES,
    grid: Cells | None = None,
) -> Callable[..., Forecast]:
    """Return a function that completes `build_forecast`, in any thread; its argument reports
    progress.

    The particles are read, and `is_land` is called (it may need the device), before this returns.
    The arguments are those of `build_forecast`.
    """
    return _prepare(outputs, scenarios, is_land, shares, grid, ahead=True)


def _prepare(
    outputs: Sequence[Output],
    scenarios: Sequence[str],
    is_land: IsLand | None,
    shares: tuple[float, ...],
    grid: Cells | None,
    ahead: bool,
    deal: Deal = answer_here,
) -> Callable[..., Forecast]:
    """Return the function of `begin`.

    ahead: whether all deposits are computed before this returns. Otherwise they are computed before
    each map, so that memory does not grow with the number of maps.
    """
    surveys = survey.survey_outputs(outputs, len(scenarios), deal)
    centre, shown = _reference(surveys), _displayed_scenarios(surveys)
    clouds = _clouds(outputs, surveys, centre, deal)
    windows, common = (
        _windows(clouds, centre) if grid is None else (_fixed(clouds, centre, grid), grid)
    )
    land = _Land(is_land, common)
    gridded = [
        (output, cloud.gridding_of_output(known, window, shown, output.n))
        for output, known, window in zip(outputs, surveys, windows, strict=True)
        if window is not None
    ]
    answers = deal(
        [output for output, _ in gridded],
        [partial(cloud.deposit_sums, gridding=gridding) for _, gridding in gridded],
    )
    each: Iterable[_Laid | None] = (
        None
        if window is None
        else _Laid(window, cloud.merge_deposits(next(answers), known, shown), land.on(window))
        for known, window in zip(surveys, windows, strict=True)
    )
    laid = list(each) if ahead else each
    # Python's threads would wait for each other; the functions of `begin` run beside other work
    cells = sum(own.window.nlat * own.window.nlon for _, own in gridded)
    processes = min(runtime.threads(), MOST_COPIES) if cells > WORTH and not ahead else 1
    bandwidths = None if grid is None else [None if own is None else own.spacing for own in clouds]

    def rest(tell: Callable[[float], None] = lambda share: None) -> Forecast:
        maps, contours = dataset.Maps(len(surveys), common, shown.size, len(shares)), []
        drawn = copies.map_in_order(
            lambda own: None if own is None else _map(own, shares, common), laid, processes
        )
        for number, (known, made) in enumerate(zip(surveys, drawn, strict=True)):
            if made is not None:
                area, outlines = made
                maps.put(number, area)
                contours += [
                    Contour(known.time, share, float(size), outline)
                    for share, size, outline in zip(shares, area.areas, outlines, strict=True)
                ]
            tell((number + 1) / len(surveys))
        return Forecast(
            dataset.build_dataset(surveys, scenarios, maps, shares, bandwidths), tuple(contours)
        )

    return rest


def grid_of(outputs: Sequence[Output], scenarios: int) -> Cells:
    """Return the grid that `build_forecast` would choose for some outputs, in a form that can be
    given again.
    """
    surveys = survey.survey_outputs(outputs, scenarios, answer_here)
    centre = _reference(surveys)
    grid = _windows(_clouds(outputs, surveys, centre, answer_here), centre)[1]
    width, height = (-(-size // QUANTUM) * QUANTUM for size in (grid.width, grid.height))
    columns, rows = (
        -(-count * old // new)
        for count, old, new in ((grid.nlon, grid.width, width), (grid.nlat, grid.height, height))
    )
    return Cells(grid.lon0, grid.lat0, width, height, min(columns, _whole_turn(width)), rows)


def _clouds(
    outputs: Sequence[Output], surveys: Sequence[Survey], centre: int, deal: Deal
) -> list[Cloud | None]:
    """Return each output's extent and bandwidth; None if no probability is on its map."""
    present = [k for k, known in enumerate(surveys) if known.heaviest > 0]
    questions = [
        partial(cloud.extent_sums, goals=cloud.goals_of_output(surveys[k]), centre=centre)
        for k in present
    ]
    clouds: list[Cloud | None] = [None] * len(outputs)
    for k, parts in zip(present, deal([outputs[k] for k in present], questions), strict=True):
        clouds[k] = cloud.merge_extents(parts, surveys[k])
    return clouds


def _displayed_scenarios(surveys: Sequence[Survey]) -> Shown:
    """Return which scenarios have maps of their own, consistent with `dataset.shown` for these
    outputs.
    """
    return likeliest.likeliest_scenarios([known.scenario for known in surveys])


def _reference(surveys: Sequence[Survey]) -> int:
    """Return the longitude [binary angle] around which to unwrap: that of the mean position at all
    times.
    """
    x, y = np.sum([known.direction for known in surveys], axis=0)
    return int(sphere.to_binary(np.degrees(np.arctan2(y, x))))


def _windows(clouds: Sequence[Cloud | None], centre: int) -> tuple[list[Cells | None], Cells]:
    """Return each snapshot's own cells and the common cells, which they divide by powers of two."""
    present = [own for own in clouds if own is not None]
    if not present:
        return [None] * len(clouds), Cells(centre, 0, 2**12, 2**12, 1, 1)
    south, north = min(c.south for c in present), max(c.north for c in present)
    west, east = min(c.west for c in present), max(c.east for c in present)
    shrink = max(float(np.cos((south + north) / 2 * sphere.UNIT)), 0.01)
    across = max(north - south, (east - west) * shrink)
    wanted = [_cell_size(own) for own in present]
    side = max(
        across / ACROSS,
        min(*wanted, across / 120) if len(wanted) > 1 else min(wanted[0], across / 120),
        32.0,
    )
    halvings = min(max(int(np.log2(side / 8)), 0), 10)
    height = _multiple(side, 2**halvings)
    width = _multiple(side / shrink, 2**halvings)

    boxes: list[tuple[int, int, int, int, int] | None] = []
    for own in clouds:
        if own is None:
            boxes.append(None)
            continue
        fine = _cell_size(own)
        x0, x1 = _span(own.west, own.east, width, 15 * fine / shrink)
        y0, y1 = _span(own.south, own.north, height, 15 * fine)
        x0, x1 = _clip_range(x0, x1, width, -(2**31), 2**31)  # so far particles are unwrapped
        y0, y1 = _clip_range(y0, y1, height, -(2**30), 2**30)
        boxes.append((x0, x1, y0, y1, _halvings(height, fine, max(x1 - x0, y1 - y0), halvings)))
    filled = [box for box in boxes if box is not None]
    left, right = min(b[0] for b in filled), max(b[1] for b in filled)
    low, high = min(b[2] for b in filled), max(b[3] for b in filled)

    def lon0(x: int) -> int:
        return centre + x * width

    # the grid's western edge in [-180, 180)
    turns = (lon0(left) + 2**31) // sphere.TURN * sphere.TURN
    grid = Cells(lon0(left) - turns, low * height, width, height, right - left, high - low)
    windows = [
        None
        if box is None
        else Cells(
            lon0(box[0]) - turns,
            box[2] * height,
            width,
            height,
            min(box[1] - box[0], _whole_turn(width)),
            box[3] - box[2],
        ).finer(box[4])
        for box in boxes
    ]
    return windows, grid


def _fixed(clouds: Sequence[Cloud | None], centre: int, grid: Cells) -> list[Cells | None]:
    """Return each snapshot's own cells, which divide the cells of a given grid by powers of two."""
    middle = grid.lon0 + grid.nlon * grid.width // 2
    offset = (
        (centre - middle + sphere.TURN // 2) % sphere.TURN - sphere.TURN // 2 + middle - grid.lon0
    )
    halvings = (QUANTUM & -QUANTUM).bit_length() - 1
    shrink = grid.height / grid.width
    windows: list[Cells | None] = []
    for own in clouds:
        if own is None:
            windows.append(None)
            continue
        fine = _cell_size(own)
        x0, x1 = _span(
            offset + own.west, offset + own.east, grid.width, 15 * fine * grid.width / grid.height
        )
        y0, y1 = _span(own.south - grid.lat0, own.north - grid.lat0, grid.height, 15 * fine)
        y0, y1 = _clip_range(y0, y1, grid.height, -(2**30) - grid.lat0, 2**30 - grid.lat0)
        if grid.nlon == _whole_turn(grid.width) and (x0 < 0 or x1 > grid.nlon):
            x0, x1 = 0, grid.nlon  # cells beyond one edge of the grid continue at the other
        if (x1 - x0) * (y1 - y0) > MOST_ONE:
            across = max((x1 - x0) * grid.width * shrink, (y1 - y0) * grid.height) / METRE
            raise UserError(
                f"output.grid: the particles are {across / 1000:,.0f} km across, "
                f"{x1 - x0:,} x {y1 - y0:,} of its cells; at most {MOST_ONE:,} can be smoothed: "
                f"make spacing {np.sqrt((x1 - x0) * (y1 - y0) / MOST_ONE):.1f} times as large"
            )
        k = _halvings(grid.height, fine, max(x1 - x0, y1 - y0), halvings)
        corner = grid.lon0 + x0 * grid.width, grid.lat0 + y0 * grid.height
        windows.append(Cells(*corner, grid.width, grid.height, x1 - x0, y1 - y0).finer(k))
    return windows


def _cell_size(of: Cloud) -> float:
    """Return the cell size [binary angle unit] that resolves an output's densest part."""
    return max(of.spacing / 2.5, 0.2 * METRE)


def _span(low: int, high: int, cell: int, reach: float) -> tuple[int, int]:
    """Return the first cell and the last + 1 of an extent with its margin; reach: of a kernel
    beyond it.
    """
    margin = reach + 0.04 * (high - low)
    return int(np.floor((low - margin) / cell)), int(np.floor((high + margin) / cell)) + 1


def _clip_range(first: int, last: int, cell: int, low: int, high: int) -> tuple[int, int]:
    """Return a range of cells, clipped to those that overlap [low, high)."""
    return max(first, low // cell), min(last, -(-high // cell))


def _whole_turn(width: int) -> int:
    """Return how many columns go round the Earth; the last may overlap the first."""
    return -(-sphere.TURN // width)


def _halvings(height: int, fine: float, across: int, most: int) -> int:
    """Return how often to halve cells until they are fine enough; `most` and ACROSS_ONE
    limit it.
    """
    k = 0
    while height / 2**k > 1.4 * fine and k < most and across * 2 ** (k + 1) <= ACROSS_ONE:
        k += 1
    return k


def _multiple(size: float, quantum: int) -> int:
    return max(round(size / quantum), 1) * quantum


class _Land:
    """Land at cell centres; looked up once for all snapshots on the common cells."""

    def __init__(self, is_land: IsLand | None, grid: Cells) -> None:
        self.is_land, self.grid = is_land, grid
        self.common = None if is_land is None else self._look(grid)

    def _look(self, where: Cells) -> Array:
        assert self.is_land is not None
        lon, lat = where.centres()
        return np.asarray(self.is_land(lon.ravel(), lat.ravel()), bool).reshape(where.shape)

    def on(self, window: Cells) -> Array | None:
        """Return land (nlat, nlon) on a window of the common cells or finer; None if there
        is none.
        """
        if self.common is None:
            return None
        x, y = (
            (window.lon0 - self.grid.lon0) // window.width,
            (window.lat0 - self.grid.lat0) // window.height,
        )
        within = (
            x >= 0
            and y >= 0
            and x + window.nlon <= self.grid.nlon
            and y + window.nlat <= self.grid.nlat
        )
        if window.width == self.grid.width and within:
            land = self.common[y : y + window.nlat, x : x + window.nlon]
        else:
            land = self._look(window)
        return land if land.any() else None


def _map(
    laid: _Laid, shares: tuple[float, ...], common: Cells
) -> tuple[areas.Area, list[shapely.MultiPolygon]]:
    """Return the map of one snapshot on its own cells, which divide `common`, and its areas'
    outlines.
    """
    media, k = (
        media_of(laid.deposits, laid.cells.shape, laid.land),
        common.width // laid.cells.width,
    )
    area = areas.build_area(laid.cells, laid.deposits, media, shares, k)
    return area, areas.contours(area)


def media_of(
    deposits: areas.Deposits, shape: tuple[int, int], land: Array | None
) -> list[density.Medium]:
    """Return the medium of particles adrift (water near a particle) and of those ashore (the
    shoreline).
    """
    mass = deposits.mass.sum(axis=0)
    if land is None:
        return [density.medium(np.ones(shape, bool))] * len(mass)
    # a kernel reaches across a spit, but not into a bay without particles
    basins, count = ndimage.label(~land)
    holds = np.zeros(count + 1, bool)
    holds[np.unique(basins.ravel()[deposits.cells])] = True
    holds[0] = False
    water = holds[basins]
    allowed = [water.copy()]
    if len(mass) > 1:
        square = np.ones((3, 3), bool)
        allowed.append(
            ndimage.binary_dilation(land, square) & ndimage.binary_dilation(water, square)
        )
    for where, weights in zip(allowed, mass, strict=True):
        where.ravel()[deposits.cells[weights > 0]] = True
    return [density.medium(where) for where in allowed]
