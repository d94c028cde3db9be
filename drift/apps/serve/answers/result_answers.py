"""What the warm process answers about a result: its areas by scenario, and the value at a place."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift.apps.serve import shelf
from drift.forecast import by_scenario
from drift.forecast.build import Forecast
from drift.forecast.products import dataset
from drift.products.files import geojson
from geo.errors import UserError
from geo.files import fence
from geo.notation import NMI

NAME = "forecast.nc"
MOST_TIMES = 200  # of which areas by scenario are made


def result(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scenarios of a result, and the areas of one of them at all times.

    Args:
        request: `folder`, `run`, and the name of the `scenario`; None: no areas.

    Returns:
        `times`; `scenarios`, each with its name and its probability at each time; `areas`, those of
        the scenario if it is the true one.
    """
    with _opened(request) as data:
        times = [f"{time.astype('datetime64[s]')}Z" for time in data["time"].values[:MOST_TIMES]]
        shown = dataset.displayed_scenarios(data)
        names = shown.names([str(name) for name in data["scenario"].values])
        weight = [shown.sums(row) for row in data["scenario_probability"].values[: len(times)]]
        wanted = request["scenario"]
        if wanted is not None and wanted not in names:
            raise UserError(f"{request['run']}: has no scenario {str(wanted)[:100]!r}")
        areas = [] if wanted is None else list(_areas(data, wanted, times))
    scenarios = [
        {"name": name, "probability": [round(float(row[k]), 6) for row in weight]}
        for k, name in enumerate(names)
    ]
    return {"times": times, "scenarios": scenarios, "areas": geojson.collection(areas, {})}


def _areas(data: xr.Dataset, wanted: str, times: list[str]) -> Iterator[dict[str, Any]]:
    """Yield the areas of a scenario at all times as features."""
    forecast = Forecast(data, ())
    for k, time in enumerate(times):
        own = next(
            one for one in by_scenario.forecasts_by_scenario(forecast, k) if one.name == wanted
        )
        for contour in own.forecast.contours:
            properties = {
                "time": time,
                "level": contour.share,
                "area_nmi2": round(contour.area / NMI**2, 3),
            }
            yield geojson.feature(geojson.polygons(contour.polygon), properties)


def value(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the probability per square mile at a place, and the smallest area that holds it.

    Args:
        request: `folder`, `run`, number of the `time`, name of the `scenario` or None, and the
            place `at` (lon, lat) [deg].
    """
    with _opened(request) as data:
        k, (lon, lat) = request["time"], request["at"]
        if not 0 <= k < data.sizes["time"]:
            raise UserError(f"{request['run']}: has no output {k}")
        west, south = data["lon"].values[0], data["lat"].values[0]
        dlon, dlat = (float(np.diff(data[name].values[:2])[0]) for name in ("lon", "lat"))
        column, row = round(((lon - west + 180) % 360 - 180) / dlon), round((lat - south) / dlat)
        if not (0 <= column < data.sizes["lon"] and 0 <= row < data.sizes["lat"]):
            return {"per_nmi2": 0.0, "within": None}
        cell = {"time": k, "lat": row, "lon": column}
        square = float(data["cell_area"].isel(lat=row, lon=column)) / NMI**2
        held = float(data["containment"].isel(cell))
        mass = float(data["probability"].isel(cell))
        if request["scenario"] is not None:
            names = dataset.displayed_scenarios(data).names(
                [str(name) for name in data["scenario"].values]
            )
            if request["scenario"] not in names:
                raise UserError(f"{request['run']}: has no such scenario")
            which = names.index(request["scenario"])
            mass = float(data["probability_by_scenario"].isel(cell)[which])
            weight = float(
                dataset.displayed_scenarios(data).sums(data["scenario_probability"].values[k])[
                    which
                ]
            )
            mass, held = (mass / weight if weight > 0 else 0.0), float("nan")
    return {"per_nmi2": mass / square, "within": held if np.isfinite(held) else None}


@contextmanager
def _opened(request: Mapping[str, Any]) -> Iterator[xr.Dataset]:
    """Yield the forecast of a result; raise UserError if it has none that can be read."""
    folder, run = Path(request["folder"]), request["run"]
    try:
        handle, _ = shelf.file_of_run(folder, run, NAME)
        with open(handle, "rb"):
            path = folder / run / NAME
            fence.check_open(handle, path)
            with xr.open_dataset(path) as data:
                yield data
    except (OSError, ValueError, KeyError, IndexError, TypeError, StopIteration) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f"{run}: holds no forecast that the page can show") from None
