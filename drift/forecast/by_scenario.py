"""One forecast per scenario: its map and areas conditional on the scenario, and its probability.

It uses the maps in a forecast: those of all scenarios, or of the likeliest ones and of the rest
together (drift.forecast.likeliest). In a spill the scenarios are classes of objects.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from drift.forecast import areas
from drift.forecast.build import Contour, Forecast
from drift.forecast.products import dataset
from geo import sphere
from geo.array import Array
from geo.cells import Cells


@dataclass(frozen=True)
class OneScenario:
    """One scenario: its probability at the first output (`before`) and at this one (`now`), and the
    forecast of this time conditional on it.
    """

    name: str
    before: float
    now: float
    forecast: Forecast


def forecasts_by_scenario(forecast: Forecast, time: int) -> list[OneScenario]:
    """Return the scenarios that have maps at an output, likeliest first; the rest together come
    last.

    A scenario that is ruled out, or has no particles on the map, has an empty map.
    """
    data = forecast.data
    shown = dataset.displayed_scenarios(data)
    weight = data["scenario_probability"].values
    before, now = shown.sums(weight[0]), shown.sums(weight[time])
    names = shown.names([str(name) for name in data["scenario"].values])
    count = _effective(
        data["scenario_effective"].values[time], weight[time], shown.place, shown.size
    )
    alone = sorted(range(len(shown.alone)), key=lambda k: -now[k])
    return [
        OneScenario(
            names[k],
            float(before[k]),
            float(now[k]),
            _conditional_forecast(forecast, time, k, float(now[k]), float(count[k])),
        )
        for k in (*alone, *range(len(shown.alone), shown.size))
    ]


def _effective(number: Array, weight: Array, place: Array, many: int) -> Array:
    """Return the effective particles of each displayed scenario, (many,); combined ones by Kish
    1965, sec. 11.2.
    """
    squares = np.divide(weight**2, number, out=np.zeros(len(weight)), where=number > 0)
    total, spread = (
        np.bincount(place, values, many) for values in (np.where(number > 0, weight, 0.0), squares)
    )
    return np.divide(total**2, spread, out=np.zeros(many), where=spread > 0)


def _conditional_forecast(
    forecast: Forecast, time: int, k: int, weight: float, count: float
) -> Forecast:
    """Return the forecast of an output conditional on displayed scenario k, whose probability is
    `weight`.

    The probability ashore in a cell is divided among the scenarios like the whole cell's. The areas
    are the smallest that hold their shares of the scenario's smoothed map. No particles were held
    out to calibrate them.
    """
    data = forecast.data.isel(time=[time])
    joint = data["probability_by_scenario"].values[0, k].astype(np.float64)
    whole = data["probability"].values[0].astype(np.float64)
    mass = joint / weight if weight > 0 else np.zeros_like(joint)
    part = np.divide(mass, whole, out=np.zeros_like(whole), where=whole > 0)
    held, sizes = np.full_like(mass, np.nan), np.full(len(forecast.shares), np.nan)
    contours: tuple[Contour, ...] = ()
    if mass.any():
        held, sizes, polygons = areas.outlined(_cells(data), mass, forecast.shares)
        made = zip(forecast.shares, sizes.tolist(), polygons, strict=True)
        contours = tuple(Contour(data["time"].values[0], *one) for one in made)
    values = {
        "probability": mass,
        "probability_ashore": part * data["probability_ashore"].values[0],
        "containment": held,
        "containment_area": sizes,
        "effective_particles": np.array(count),
    }
    return Forecast(
        data.assign({name: (data[name].dims, value[None]) for name, value in values.items()}),
        contours,
    )


def _cells(data: xr.Dataset) -> Cells:
    """Return the cells of a forecast's grid."""
    (west, east), (south, north) = (
        np.rint(data[f"{name}_bnds"].values[0] * (sphere.TURN / 360)).astype(int).tolist()
        for name in ("lon", "lat")
    )
    return Cells(west, south, east - west, north - south, data.sizes["lon"], data.sizes["lat"])
