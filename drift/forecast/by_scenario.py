"""A forecast by scenario: the map of each as if it were the true one, with its areas, and how
likely it is.

Works on the maps that a forecast keeps: those of all scenarios, or of the likeliest ones and of the
others together (drift.forecast.likeliest). Of a spill the scenarios are classes of objects.
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
    """One scenario at a time: its probability at the first output and now, and the forecast, of
    that time, if it is true.
    """

    name: str
    before: float
    now: float
    forecast: Forecast


def each(forecast: Forecast, time: int) -> list[OneScenario]:
    """Return the scenarios that have maps at an output, the likeliest first; the others together
    are the last.

    A scenario that is ruled out, or of which nothing is on the map, has an empty map.
    """
    data = forecast.data
    shown = dataset.shown(data)
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
            _alone(forecast, time, k, float(now[k]), float(count[k])),
        )
        for k in (*alone, *range(len(shown.alone), shown.size))
    ]


def _effective(number: Array, weight: Array, place: Array, many: int) -> Array:
    """Return how many particles count for each that is shown, (many,); of several together by Kish
    1965, sec. 11.2.
    """
    squares = np.divide(weight**2, number, out=np.zeros(len(weight)), where=number > 0)
    total, spread = (
        np.bincount(place, values, many) for values in (np.where(number > 0, weight, 0.0), squares)
    )
    return np.divide(total**2, spread, out=np.zeros(many), where=spread > 0)


def _alone(forecast: Forecast, time: int, k: int, weight: float, count: float) -> Forecast:
    """Return the forecast of an output if scenario number k of the maps, of some probability, is
    true.

    What is ashore in a cell is shared by the scenarios as the whole cell is. Its areas are the
    smallest that hold their shares of its smoothed map: no particles were held out to calibrate
    them.
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
