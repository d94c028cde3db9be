"""The washup as text: stretches (worst first) as CSV and GeoJSON, over time, and the account."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from drift.products.files import formats, geojson
from drift.products.maps import gazetteer
from drift.spills.worlds import washup
from geo import notation, sphere
from geo.array import Array
from geo.coast.segments import Segments

Columns = dict[str, Any]  # arrays or lists of the same length, by the column's name


def washup_csv(data: xr.Dataset, run: str) -> str:
    """Return the touched stretches at the end of the run, worst first, as CSV.

    run: the run_id, for the last column. Arrival times are in UTC and in hours after the run's
    start; an unknown value is empty.
    """
    columns = stretch_columns(data)
    rows = zip(*columns.values(), strict=True)
    return formats.csv_text(list(columns), rows, run=run, digits=".10g")


def stretch_columns(data: xr.Dataset) -> Columns:
    """Return the figures of the touched stretches at the end, worst first; NaN if unknown."""
    order = washup.worst_stretches(data)
    at = data.isel(time=-1, segment=order)
    lon, lat = sphere.wrap_degrees(at["lon"].values), at["lat"].values
    length = at["length"].values / 1000
    dense = at["expected"].values / np.maximum(length, 1e-9)
    columns: Columns = {
        "rank": np.arange(1, len(order) + 1),
        "segment": at["segment"].values,
        "stretch_id": at["stretch_id"].values,
        "name": at["name"].values,
        "access": at["access"].values,
        "lon": np.round(lon, geojson.DIGITS),
        "lat": np.round(lat, geojson.DIGITS),
        "position": [notation.position(x, y) or "" for x, y in zip(lon, lat, strict=True)],
        "near": at["near"].values,
        "near_km": _significant(at["near_distance"].values / 1000),
        "near_across_water": np.where(at["near_across_water"].values > 0, "yes", "no"),
        "length_km": _significant(length),
        "rank_per_km": np.argsort(np.argsort(-dense, kind="stable"), kind="stable") + 1,
        "expected_per_km": _significant(dense),
        **_figures(at),
        "ever": _significant(at["ever"].values),
        "ever_se": _significant(at["ever_se"].values),
    }
    start = notation.epochs(data["start"].values)
    for short, name in (("first", "first_arrival"), ("bulk", "bulk_arrival")):
        for j, share in enumerate(_shares(data)):
            moment = at[name].values[j]
            columns[f"{short}_{share}"] = [
                notation.iso(when) for when in np.rint(moment).astype("datetime64[s]")
            ]
            columns[f"{short}_{share}_h"] = _significant((moment - start) / 3600)
            columns[f"{short}_{share}_se_h"] = _significant(at[f"{name}_se"].values[j] / 3600)
    if data.sizes["kind"] > 1:
        for j, kind in enumerate(data["kind"].values):
            for end in ("", "_se"):
                columns[f"expected_{kind}{end}"] = _significant(
                    at[f"expected_by_kind{end}"].values[j]
                )
    columns["effective_worlds"] = np.full(len(order), _worlds(data))
    return columns


def stretch_name(number: int, name: str, place: str) -> str:
    """Return the name of a stretch; with its number if the name is only its position."""
    return f"stretch {number}, {name}" if name == place else name


def stretch_with_town(segments: Segments, number: int) -> str:
    """Return the name of a stretch; with the nearest town if the name is only its position."""
    lon, lat, name = float(segments.lon[number]), float(segments.lat[number]), segments.name[number]
    place = notation.position(lon, lat) or ""
    (found,) = gazetteer.nearest_towns(np.array([lon]), np.array([lat]), segments.land)
    town = gazetteer.place_in_words(found) if place and place in name else ""
    return stretch_name(number, name, place) + (f", {town}" if town else "")


def washup_times_csv(data: xr.Dataset, run: str) -> str:
    """Return the stretches with any arrival so far at each output time, worst first, as CSV."""
    rows: list[list[Any]] = []
    header, worlds = [*_figures(data.isel(time=0)), "effective_worlds"], _worlds(data)
    for t, when in enumerate(data["time"].values):
        order = washup.worst_stretches(data, time=t)
        order = order[data["arrived"].values[t, order] > 0]
        at = data.isel(time=t, segment=order)
        names = at["segment"].values, at["name"].values
        moment = [notation.iso(when), notation.format_dtg(when)]
        rows += [
            [*moment, *row, worlds] for row in zip(*names, *_figures(at).values(), strict=True)
        ]
    header = ["time", "date_time_group", "segment", "name", *header]
    return formats.csv_text(header, rows, run=run, digits=".10g")


def totals_csv(data: xr.Dataset, run: str) -> str:
    """Return the account as CSV, by time and fate; expected numbers of a time add up to N."""
    mean, number = (
        [_significant(data[name + end].values) for end in ("", "_se")]
        for name in ("total", "total_number")
    )
    rows = [
        {
            "time": when,
            "date_time_group": notation.format_dtg(when),
            "fate": fate,
            "expected": mean[0][f, t],
            "expected_se": mean[1][f, t],
            **{
                f"number_{share}{end}": values[q, f, t]
                for end, values in zip(("", "_se"), number, strict=True)
                for q, share in enumerate(_shares(data))
            },
            "effective_worlds": _worlds(data),
        }
        for t, when in enumerate(data["time"].values)
        for f, fate in enumerate(data["fate"].values)
    ]
    return formats.csv_rows(rows, run=run, digits=".10g")


def washup_geojson(
    data: xr.Dataset, segments: Segments, attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the touched stretches as a GeoJSON FeatureCollection of lines (RFC 7946), worst first.

    Lines are cut at 180 degrees. A feature's id is that of the stretch; its properties are the
    columns of `stretches`, null if unknown.
    """
    columns = stretch_columns(data)
    features = []
    for number, row in zip(columns["segment"], zip(*columns.values(), strict=True), strict=True):
        properties = {name: _number(value) for name, value in zip(columns, row, strict=True)}
        own = {"id": segments.id[number]} if segments.id else {}
        features.append(geojson.feature(geojson.lines([segments.lines[number]]), properties, **own))
    return geojson.collection(features, attributes)


def _worlds(data: xr.Dataset) -> float:
    """Return the effective number of worlds, to six digits."""
    return float(f"{data['effective_worlds'].item():.6g}")


def _shares(data: xr.Dataset) -> list[str]:
    return [f"{100 * share:.0f}" for share in data["quantile"].values]


def _figures(at: xr.Dataset) -> dict[str, Array]:
    """Return the figures of one output time by column, each (segment,)."""
    columns: dict[str, Array] = {}
    for name in ("expected", "probability", "number", "arrived"):
        for end in ("", "_se"):
            values = _significant(at[name + end].values)
            if name == "number":
                columns |= {
                    f"number_{share}{end}": values[j] for j, share in enumerate(_shares(at))
                }
            else:
                columns[name + end] = values
    return columns


def _significant(values: Array) -> Array:
    """Return numbers rounded to six digits."""
    power = 5 - np.floor(np.log10(np.maximum(np.abs(values), 1e-30)))
    return np.asarray(np.round(values * 10.0**power) / 10.0**power)


def _number(value: Any) -> Any:
    """Return a value that JSON can hold: null if unknown."""
    if isinstance(value, float):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else str(value)
