"""What the warm process answers about a result: its areas by scenario, and the value at a place."""

import json
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift.apps.serve import names, shelf
from drift.engine.particles.status import Status
from drift.forecast import by_scenario, likeliest_places
from drift.forecast.build import Contour, Forecast
from drift.forecast.products import dataset, headline
from drift.products.files import geojson
from geo.errors import UserError
from geo.files import fence
from geo.notation import NMI

NAME, PARTICLES = "forecast.nc", "particles.nc"
MOST_PARTICLES = 1000  # on the map
MOST_TIMES = 200  # of which areas by scenario are made


def result(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scenarios of a result, and the areas of one of them at all times.

    Args:
        request: `folder`, `run`, and the name of the `scenario`; None: no areas.

    Returns:
        `times`; `scenarios`, each with its name and its probability at each time; `areas`, those of
        the scenario if it is the true one. Of all scenarios together: `words`, the first sentences
        of the report; `likely`, the most likely places at each time (afloat, and on the coast);
        `ashore`, the probability that it is ashore at each time; and `particles`, some of them, if
        the result holds any.
    """
    with _opened(request) as data:
        opens = _opens(request)
        times = [f"{time.astype('datetime64[s]')}Z" for time in data["time"].values[:MOST_TIMES]]
        shown = dataset.displayed_scenarios(data)
        listed = shown.names([str(name) for name in data["scenario"].values])
        wanted = request["scenario"]
        if wanted is not None and wanted not in listed:
            raise UserError(f"{request['run']}: has no scenario {str(wanted)[:100]!r}")
        areas = [] if wanted is None else list(_areas(data, wanted, times))
        words = headline.forecast_headline(data, opens)
        likely = [likely_at(data.isel(time=k)) for k in range(len(times))]
        told = probabilities(data, len(times))
    return {
        "times": times,
        "opens": None if opens is None else f"{opens}Z",
        **told,
        "areas": geojson.collection(areas, {}),
        "words": words,
        "likely": likely,
        **_particles(request, len(times)),
    }


def probabilities(data: xr.Dataset, count: int) -> dict[str, Any]:
    """Return the probability of each `scenario`, and of being `ashore`, at the first outputs.

    Args:
        data: of a forecast.
        count: number of outputs.
    """
    shown = dataset.displayed_scenarios(data)
    weight = [shown.sums(row) for row in data["scenario_probability"].values[:count]]
    scenarios = [
        {"name": name, "probability": [round(float(row[k]), 6) for row in weight]}
        for k, name in enumerate(shown.names([str(name) for name in data["scenario"].values]))
    ]
    ashore = data["status_probability"].sel(status="ashore").values[:count]
    return {"scenarios": scenarios, "ashore": ashore.astype(np.float64).round(6).tolist()}


def likely_at(at: xr.Dataset) -> list[dict[str, Any]]:
    """Return the most likely places at an output, the likelier one first.

    Args:
        at: one output of a forecast.

    Returns:
        Each with the place `at` [deg], whether it is `ashore`, and its `share`.
    """
    return [
        {
            "at": [round(place.lon, 4), round(place.lat, 4)],
            "ashore": place.ashore,
            "share": round(place.share, 6),
        }
        for place in likeliest_places.likeliest_places(at)
    ]


def _opens(request: Mapping[str, Any]) -> np.datetime64 | None:
    """Return the time that the report shows first, as the summary of the run has it; None: the
    last.
    """
    data = names.contents(
        Path(request["folder"]), request["run"], shelf.SUMMARY, largest=shelf.LARGEST_SUMMARY
    )
    opens = json.loads(data).get("opens")
    return None if opens is None else np.datetime64(opens.rstrip("Z"), "s")


def _particles(request: Mapping[str, Any], count: int) -> dict[str, Any]:
    """Return some particles at the first outputs, as a first map has them.

    A result may hold none, or at other times.

    Args:
        request: as that of `result`.
        count: number of outputs.
    """
    none = {"statuses": [], "particles": {"lon": [], "lat": [], "status": []}}
    try:
        with opened_file(request, PARTICLES) as data:
            tracks = data[["lon", "lat", "status"]].isel(trajectory=slice(MOST_PARTICLES)).load()
            if tracks.sizes["time"] < count:
                return none
    except UserError:
        return none
    tracks = tracks.isel(time=slice(count)).transpose("time", "trajectory")
    known = np.isfinite(tracks["lon"].values) & np.isfinite(tracks["lat"].values)
    return {
        "statuses": [status.name.lower() for status in sorted(Status)],
        "particles": {
            "lon": np.where(known, tracks["lon"].values, 0.0).round(4).tolist(),
            "lat": np.where(known, tracks["lat"].values, 0.0).round(4).tolist(),
            "status": np.where(known, tracks["status"].values, int(Status.PENDING))
            .astype(int)
            .tolist(),
        },
    }


def _areas(data: xr.Dataset, wanted: str, times: list[str]) -> Iterator[dict[str, Any]]:
    """Yield the areas of a scenario at all times as features."""
    forecast = Forecast(data, ())
    for k, time in enumerate(times):
        own = next(
            one for one in by_scenario.forecasts_by_scenario(forecast, k) if one.name == wanted
        )
        yield from (feature_of_area(contour, time) for contour in own.forecast.contours)


def feature_of_area(contour: Contour, time: str) -> dict[str, Any]:
    """Return an area of a forecast as a GeoJSON feature.

    Args:
        contour: its outline.
        time: of its output, as the page writes it.
    """
    properties = {
        "time": time,
        "level": contour.share,
        "area_nmi2": round(contour.area / NMI**2, 3),
    }
    return geojson.feature(geojson.polygons(contour.polygon), properties)


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
            shown = dataset.displayed_scenarios(data)
            listed = shown.names([str(name) for name in data["scenario"].values])
            if request["scenario"] not in listed:
                raise UserError(f"{request['run']}: has no such scenario")
            which = listed.index(request["scenario"])
            mass = float(data["probability_by_scenario"].isel(cell)[which])
            weight = float(shown.sums(data["scenario_probability"].values[k])[which])
            mass, held = (mass / weight if weight > 0 else 0.0), float("nan")
    return {"per_nmi2": mass / square, "within": held if np.isfinite(held) else None}


def _opened(request: Mapping[str, Any]) -> AbstractContextManager[xr.Dataset]:
    return opened_file(request, NAME)


@contextmanager
def opened_file(
    request: Mapping[str, Any], name: str, what: str = "forecast"
) -> Iterator[xr.Dataset]:
    """Yield a file of a result; raise UserError if it has none that can be read.

    Args:
        request: `folder` and `run`.
        name: of the file.
        what: it holds, for the message.
    """
    folder, run = Path(request["folder"]), request["run"]
    try:
        handle, _ = shelf.file_of_run(folder, run, name)
        with open(handle, "rb"):
            path = folder / run / name
            fence.check_open(handle, path)
            with xr.open_dataset(path) as data:
                yield data
    except (
        OSError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        StopIteration,
    ) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f"{run}: holds no {what} that the page can show") from None
