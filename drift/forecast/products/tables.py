"""The forecast as text: values for the summary, contours as GeoJSON, tables as CSV; writes
no file.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drift.forecast import mapped
from drift.forecast.build import Forecast
from drift.forecast.likeliest import Shown
from drift.forecast.products import dataset
from drift.products.files import formats, geojson
from geo import notation, sphere
from geo.notation import NMI


def summary_of_forecast(forecast: Forecast, opens: np.datetime64 | None = None) -> dict[str, Any]:
    """Return the forecast's entries of the summary: `scenarios` and, by time, `outputs`.

    opens: the time that the map and the report show first (drift.forecast.mapped.opening_output); it is
    included.
    """
    data = forecast.data
    names = [str(name) for name in data["scenario"].values]
    weights = data["scenario_probability"].values
    return {
        "scenarios": [
            {"name": name, "prior": weights[0, i], "posterior": weights[-1, i]}
            for i, name in enumerate(names)
        ],
        "outputs": [_output(forecast, i) for i in range(data.sizes["time"])],
        "opens": data["time"].values[mapped.opening_output(data, opens)],
    }


def _output(forecast: Forecast, i: int) -> dict[str, Any]:
    data, at = forecast.data, forecast.data.isel(time=i)
    held = [f"{notation.hundredths(share)}%" for share in at["share"].values]
    areas = at["containment_area"].values
    status = [str(s) for s in at["status"].values]
    return {
        "time": at["time"].values[()],
        "date_time_group": notation.format_dtg(at["time"].values[()]),
        "mean": _place(at["mean_lon"].item(), at["mean_lat"].item()),
        "datum": _place(at["datum_lon"].item(), at["datum_lat"].item()),
        "area_nmi2": dict(zip(held, areas / NMI**2, strict=True)),
        "area_km2": dict(zip(held, areas / 1e6, strict=True)),
        "held_out": dict(zip(held, at["held_out"].values, strict=True)),
        "probability": dict(zip(status, at["status_probability"].values, strict=True)),
        **_counts(data, i),
        "effective_by_status": dict(zip(status, at["status_effective"].values, strict=True)),
        "scenarios": _scenarios(at, dataset.displayed_scenarios(data)),
    }


def _scenarios(at: Any, shown: Shown) -> dict[str, Any]:
    """Return the values at a time of each scenario with its own map, and the probability of the
    rest.
    """
    names = [str(name) for name in at["scenario"].values]
    scenarios: dict[str, Any] = {
        names[j]: {
            "probability": at["scenario_probability"].values[j],
            "effective_particles": at["scenario_effective"].values[j],
            "mean": _place(at["scenario_mean_lon"].values[j], at["scenario_mean_lat"].values[j]),
        }
        for j in shown.alone
    }
    if shown.rest:
        scenarios[shown.names(names)[-1]] = {
            "probability": shown.sums(at["scenario_probability"].values)[-1]
        }
    return scenarios


def _counts(data: Any, i: int) -> dict[str, float]:
    """Return the effective numbers of a map, of particles and of worlds if there are any, by column
    name.
    """
    names = [name for name in ("effective_particles", "effective_worlds") if name in data]
    return {name: float(data[name].values[i]) for name in names}


def _place(lon: float, lat: float) -> dict[str, Any] | None:
    if not np.isfinite(lat):
        return None
    return {"lon": sphere.wrap_degrees(lon), "lat": lat, "text": notation.position(lon, lat)}


def track(forecast: Forecast, run: str) -> str:
    """Return the mean track with areas and status shares by time, as CSV; run: run_id for the last
    column.
    """
    data = forecast.data
    held = [f"area_{notation.hundredths(share)}_nmi2" for share in data["share"].values]
    status = [f"probability_{name}" for name in data["status"].values]
    rows = []
    for i in range(data.sizes["time"]):
        at = data.isel(time=i)
        when = at["time"].values[()]
        row = {"time": when, "date_time_group": notation.format_dtg(when)}
        for name in ("mean", "datum"):
            lon, lat = at[f"{name}_lon"].item(), at[f"{name}_lat"].item()
            row[f"{name}_lon"], row[f"{name}_lat"] = _decimals(sphere.wrap_degrees(lon), lat)
            row[f"{name}_position"] = notation.position(lon, lat)
        row |= zip(held, at["containment_area"].values / NMI**2, strict=True)
        row |= zip(status, _decimals(*at["status_probability"].values), strict=True)
        rows.append(row | _counts(data, i))
    return formats.csv_rows(rows, run=run, digits=".6g")


def ashore(forecast: Forecast, run: str) -> str:
    """Return the cells where the object may be ashore at the end, likeliest first, as CSV.

    run: run_id for the last column. first_time is the first output time by which half of the cell's
    final probability had stranded there. effective_particles is the effective number of stranded
    particles in all cells together.
    """
    data = forecast.data
    every = data["probability_ashore"].values
    last = every[-1].ravel().astype(np.float64)
    cells = np.flatnonzero(last > 0)
    cells = cells[np.argsort(-last[cells], kind="stable")]
    half = np.argmax(
        every.reshape(len(every), -1)[:, cells].astype(np.float64) >= 0.5 * last[cells], axis=0
    )
    row, column = np.unravel_index(cells, every.shape[1:])
    lon, lat = sphere.wrap_degrees(data["lon"].values)[column], data["lat"].values[row]
    times = [notation.iso(time) for time in data["time"].values]
    many = data["status_effective"].sel(status="ashore").values[-1]
    rows = [
        [*_decimals(x, y), notation.position(x, y), f"{share:.4g}", times[first], many]
        for x, y, share, first in zip(
            lon.tolist(), lat.tolist(), last[cells].tolist(), half.tolist(), strict=True
        )
    ]
    header = ["lon", "lat", "position", "probability_ashore", "first_time", "effective_particles"]
    return formats.csv_text(header, rows, run=run, digits=".6g")


def _decimals(*values: float) -> list[str]:
    """Return degrees or shares to six decimals; "" if they are unknown."""
    return [f"{value:.6f}" if np.isfinite(value) else "" for value in values]


def contours(forecast: Forecast, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the containment contours as a GeoJSON FeatureCollection (RFC 7946), cut at the
    antimeridian.
    """
    features, times = [], forecast.data["time"].values
    for contour in forecast.contours:
        geometry = geojson.polygons(contour.polygon)
        if not geometry["coordinates"]:
            continue
        properties = {
            "time": notation.iso(contour.time),
            "level": contour.share,
            "area_nmi2": contour.area / NMI**2,
            "area_km2": contour.area / 1e6,
            **_counts(forecast.data, int(np.flatnonzero(times == contour.time)[0])),
        }
        features.append(geojson.feature(geometry, properties))
    return geojson.collection(features, attributes)
