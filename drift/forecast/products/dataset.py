"""The contents of forecast.nc: CF-1.11 variables on one grid that covers all output times."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from drift.engine.particles.snapshot import Means
from drift.engine.particles.status import Status
from drift.forecast import areas, likeliest
from drift.forecast.likeliest import Shown
from drift.forecast.survey import Survey
from drift.products.files import temporary
from geo import sphere
from geo.array import Array
from geo.cells import Cells

AREA = "area: cell_area"
COUNTED = "for resampled particles, the value of the particles from which they descend"
SUMMARY = (
    "Probability of the position of an object at sea over time, by cells, from weighted particles that drift or steer. It includes "
    "the evidence of searches and contacts up to each time, areas that hold stated shares, and the fate of the object."
)
SUMMED = "time: point area: sum"  # CF cell methods of a cell's probability at a time
CALIBRATED = "calibrated so that the share of held-out particles inside equals the stated one"


def _positions(
    name: str, dims: tuple[str, ...], words: str
) -> dict[str, tuple[tuple[str, ...], dict[str, str]]]:
    """Return the longitude and latitude variables of a position."""
    return {
        f"{name}_{short}": (
            dims,
            {
                "standard_name": axis,
                "long_name": f"{axis} of {words}",
                "units": f"degrees_{toward}",
            },
        )
        for short, axis, toward in (("lon", "longitude", "east"), ("lat", "latitude", "north"))
    }


CELLWISE = ("time", "lat", "lon")
# of many scenarios: drift.forecast.likeliest
MAPPED_ALONE = ("time", "mapped_scenario", "lat", "lon")
# By name: dimensions, attributes. Each variable takes its values from `_maps` or `_numbers`.
VARIABLES: dict[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "probability": (
        CELLWISE,
        {
            "long_name": "probability that the object is in the cell, adrift or ashore",
            "units": "1",
            "cell_measures": AREA,
            "cell_methods": SUMMED,
            "ancillary_variables": "containment",
        },
    ),
    "probability_ashore": (
        CELLWISE,
        {
            "long_name": "probability that the object is ashore in the cell",
            "units": "1",
            "cell_measures": AREA,
            "cell_methods": SUMMED,
        },
    ),
    "probability_by_scenario": (
        ("time", "scenario", "lat", "lon"),
        {
            "long_name": "joint probability of the scenario and of the object in the cell; the sum over scenarios is probability",
            "units": "1",
            "cell_measures": AREA,
            "cell_methods": SUMMED,
        },
    ),
    "containment": (
        CELLWISE,
        {
            "long_name": "smallest share of the probability on the map whose area contains the cell",
            "units": "1",
            "cell_measures": AREA,
            "comment": CALIBRATED,
        },
    ),
    "cell_area": (
        ("lat", "lon"),
        {
            "standard_name": "cell_area",
            "long_name": "area of the cell on the sphere",
            "units": "m2",
        },
    ),
    "lat_bnds": (("lat", "bnds"), {}),  # edges have their coordinate's attributes (CF, 7.1)
    "lon_bnds": (("lon", "bnds"), {}),
    "containment_area": (
        ("time", "share"),
        {
            "long_name": "area of the smallest region that holds the share",
            "units": "m2",
            "comment": CALIBRATED,
        },
    ),
    "held_out": (
        ("time", "share"),
        {
            "long_name": "share of held-out particles inside the region of a map, calibrated on others",
            "units": "1",
        },
    ),
    "status_probability": (
        ("time", "status"),
        {"long_name": "probability of each status of the object; adds up to 1", "units": "1"},
    ),
    "scenario_probability": (
        ("time", "scenario"),
        {"long_name": "probability of each scenario; adds up to 1", "units": "1"},
    ),
    "effective_particles": (
        ("time",),
        {
            "long_name": "effective sample size of the particles on the map",
            "units": "1",
            "comment": COUNTED,
        },
    ),
    "status_effective": (
        ("time", "status"),
        {
            "long_name": "effective sample size of the particles of each status",
            "units": "1",
            "comment": COUNTED,
        },
    ),
    "scenario_effective": (
        ("time", "scenario"),
        {
            "long_name": "effective sample size of the particles on the map, of each scenario",
            "units": "1",
            "comment": COUNTED,
        },
    ),
    "effective_worlds": (
        ("time",),
        {
            "long_name": "effective number of worlds on the map; objects of a world share its unknowns",
            "units": "1",
            "comment": "each world is weighted by its share of the map at that time, so this differs from the number in "
            "washup.nc, which depends on the finds only",
        },
    ),
    "particles_per_kernel": (
        ("time",),
        {"long_name": "effective particles in a smoothing kernel", "units": "1"},
    ),
    **_positions("mean", ("time",), "the mean position, adrift or ashore"),
    **_positions("datum", ("time",), "the datum, the mean position of those adrift"),
    **_positions("scenario_mean", ("time", "scenario"), "the scenario's mean position"),
    "off_grid": (
        ("time",),
        {
            "long_name": "share of the probability adrift or ashore that lies outside the grid; "
            "areas and containment count it",
            "units": "1",
        },
    ),
    "cells_per_kernel": (
        ("time",),
        {
            "long_name": "best bandwidth for the densest particles, in cells of the smoothing grid",
            "units": "1",
        },
    ),
}
STEERING = {  # long names for runs with steering targets
    "adrift or ashore": "under way, arrived, aground, adrift or ashore",
    "of those adrift": "of those under way or adrift",
}


class Maps:
    """The maps of all times on the common cells, filled one time after another."""

    def __init__(self, times: int, grid: Cells, scenarios: int, shares: int) -> None:
        """Allocate the maps of `times` outputs; scenarios: the number of displayed entries."""
        self.grid = grid
        shapes = [(times, scenarios, *grid.shape), *[(times, *grid.shape)] * 3]
        self._cellwise = temporary.zeros(shapes, np.float32)
        self.by_scenario, self.probability, self.ashore, self.contained = self._cellwise
        self._put = np.zeros(times, bool)
        self.off, self.per_kernel, self.height = (np.full(times, np.nan) for _ in range(3))
        self.areas, self.held_out = (np.full((times, shares), np.nan) for _ in range(2))

    def put(self, i: int, area: areas.Area) -> None:
        """Store the map of time number i."""
        self._put[i] = True
        part, own = _coarsened(area, self.grid)
        where, there = _overlap(own, self.grid)
        total = part.sum(axis=(0, 1))
        self.by_scenario[(i, slice(None), *where)] = part.sum(axis=1)[(slice(None), *there)]
        self.probability[(i, *where)] = total[there]
        # empty where no particle is ashore
        self.ashore[(i, *where)] = part[:, 1:].sum(axis=(0, 1))[there]
        self.contained[i] = 1.0
        self.contained[(i, *where)] = _containment(area, total, own.area())[there]
        self.off[i] = 1 - total[there].sum() / total.sum()
        self.per_kernel[i], self.height[i] = area.per_kernel, area.cells.height
        self.areas[i], self.held_out[i] = area.areas, area.held_out
        for values in self._cellwise:
            temporary.release_pages(values)

    def values(self) -> dict[str, Array]:
        """Return the variables by cell and time, and those by time."""
        self.contained[~self._put] = np.nan
        return {
            "probability": self.probability,
            "probability_ashore": self.ashore,
            "probability_by_scenario": self.by_scenario,
            "containment": self.contained,
            **_edges(self.grid),
            "cell_area": np.repeat(self.grid.area()[:, None], self.grid.nlon, axis=1),
            "off_grid": self.off,
            "containment_area": self.areas,
            "held_out": self.held_out,
            "particles_per_kernel": self.per_kernel,
        }


def build_dataset(
    surveys: Sequence[Survey],
    scenarios: Sequence[str],
    maps: Maps,
    shares: Sequence[float],
    bandwidths: Sequence[float | None] | None = None,
) -> xr.Dataset:
    """Return the forecast as a dataset; times without probability on the map hold zeros and NaN.

    Args:
        surveys: statistics of each output.
        scenarios: names, in order of their numbers.
        maps: of all outputs.
        shares: of the containment areas.
        bandwidths: [binary angle unit] suited to the densest part of each output, on a grid that
            does not follow the particles.
    """
    by_scenario = np.array([survey.scenario for survey in surveys])
    mapped_alone = likeliest.likeliest_scenarios(by_scenario)
    values = {
        **maps.values(),
        "status_probability": np.array([survey.status for survey in surveys]),
        "scenario_probability": by_scenario,
        **_effective(surveys),
        **_tracks([survey.means for survey in surveys], maps.grid),
    }
    if bandwidths is None:
        del values["off_grid"]
    else:
        values["cells_per_kernel"] = np.array(bandwidths, np.float64) / maps.height
    data = {
        name: (dims, values[name], attributes)
        for name, (dims, attributes) in VARIABLES.items()
        if name in values
    }
    coordinates = _coordinates([survey.time for survey in surveys], scenarios, maps.grid, shares)
    if mapped_alone.rest:
        data["probability_by_scenario"] = (MAPPED_ALONE, *data["probability_by_scenario"][1:])
        names = np.array(mapped_alone.names(scenarios), object)
        coordinates["mapped_scenario"] = (
            "mapped_scenario",
            names,
            {"long_name": "scenario; the last entry is all scenarios without a map"},
        )
    forecast = xr.Dataset(data, coordinates, {"summary": SUMMARY})
    if "effective_worlds" in forecast:
        forecast["effective_worlds"].attrs["worlds"] = surveys[0].worlds
    if not any(survey.steers for survey in surveys):
        # without steering only the last three exist
        return forecast.isel(status=slice(int(Status.UNDER_WAY)))
    for variable in forecast.variables.values():
        for drifting, steering in STEERING.items() if variable.attrs else ():
            variable.attrs["long_name"] = variable.attrs["long_name"].replace(drifting, steering)
    return forecast


def displayed_scenarios(data: xr.Dataset) -> Shown:
    """Return which scenarios of a forecast have maps of their own."""
    return likeliest.likeliest_scenarios(data["scenario_probability"].values)


def _edges(grid: Cells) -> dict[str, Array]:
    """Return the edges of the cells [deg], (n, 2)."""

    def pairs(first: int, width: int, count: int) -> Array:
        edges = (first + width * np.arange(count + 1)) * (360 / sphere.TURN)
        return np.stack([edges[:-1], edges[1:]], axis=1)

    return {
        "lat_bnds": np.clip(pairs(grid.lat0, grid.height, grid.nlat), -90, 90),
        "lon_bnds": pairs(grid.lon0, grid.width, grid.nlon),
    }


def _coordinates(
    times: Sequence[Any], scenarios: Sequence[str], grid: Cells, shares: Sequence[float]
) -> dict[str, Any]:
    return {
        "time": ("time", np.array(times, "datetime64[ns]"), _axis("time", "T", "time, UTC")),
        "lat": (
            "lat",
            grid.lat(),
            {
                **_axis("latitude", "Y", "latitude of the cell's centre"),
                "units": "degrees_north",
                "bounds": "lat_bnds",
            },
        ),
        "lon": (
            "lon",
            grid.lon(),
            {
                **_axis("longitude", "X", "longitude of the cell's centre"),
                "units": "degrees_east",
                "bounds": "lon_bnds",
            },
        ),
        "scenario": ("scenario", np.array(scenarios, object), {"long_name": "scenario"}),
        "status": (
            "status",
            np.array([s.name.lower() for s in Status], object),
            {"long_name": "fate of the object"},
        ),
        "share": (
            "share",
            np.array(shares),
            {"long_name": "share of the probability on the map", "units": "1"},
        ),
    }


def _axis(name: str, axis: str, words: str) -> dict[str, str]:
    return {"standard_name": name, "long_name": words, "axis": axis}


def _effective(surveys: Sequence[Survey]) -> dict[str, Array]:
    """Return the effective numbers of particles, and of worlds if there are any."""
    worlds = surveys and surveys[0].worlds > 0
    return {
        "effective_particles": np.array([survey.effective_map for survey in surveys]),
        "status_effective": np.array([survey.effective_status for survey in surveys]),
        "scenario_effective": np.array([survey.effective_scenario for survey in surveys]),
        **(
            {"effective_worlds": np.array([survey.effective_worlds for survey in surveys])}
            if worlds
            else {}
        ),
    }


def _overlap(own: Cells, grid: Cells) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the rows and columns that cells share with a grid, as slices of the grid and of the
    cells.
    """
    on_grid, on_cells = [], []
    for start, count, size in (
        ((own.lat0 - grid.lat0) // grid.height, own.nlat, grid.nlat),
        ((own.lon0 - grid.lon0) // grid.width, own.nlon, grid.nlon),
    ):
        low, high = max(start, 0), min(start + count, size)
        high = max(low, high)
        on_grid.append(slice(low, high))
        on_cells.append(slice(low - start, high - start))
    return (on_grid[0], on_grid[1]), (on_cells[0], on_cells[1])


def _coarsened(area: areas.Area, grid: Cells) -> tuple[Array, Cells]:
    """Return the map summed into cells of the common size, and these cells."""
    k = grid.width // area.cells.width
    return areas.summed(area.probability, k) if k > 1 else area.probability, areas.coarser(
        area.cells, k
    )


def _containment(own: areas.Area, total: Array, cell_area: Array) -> Array:
    """Return the containment on the common cells: the map's own, or recomputed from sums of finer
    cells.
    """
    if total.shape == own.cells.shape:
        return own.containment
    return areas.containment(total, cell_area, own.coarse)[0]


def _tracks(mean: Sequence[Means], grid: Cells) -> dict[str, Array]:
    """Return mean positions, with longitudes continuous from the grid's western edge."""
    west = grid.lon()[0] - 180
    positions = {}
    for name, at in (
        ("mean", [m.all for m in mean]),
        ("datum", [m.adrift for m in mean]),
        ("scenario_mean", [m.scenario for m in mean]),
    ):
        lonlat = np.array(at)
        positions[f"{name}_lon"] = sphere.east_of_degrees(lonlat[..., 0], west)
        positions[f"{name}_lat"] = lonlat[..., 1]
    return positions
