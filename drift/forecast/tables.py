"""The forecast's numbers as text: the summary, the contours as GeoJSON, tables as CSV. Writes no file."""

import csv
import hashlib
import io
import re
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from drift.case import shares, units
from drift.forecast.build import Forecast
from drift.forecast.cells import Array

NMI = units.NMI
FORMULAS = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")  # with what a spreadsheet's formula begins
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def iso(time: np.datetime64 | Array) -> str:
    """Return a time as 2026-11-21T18:30:00Z."""
    return f"{np.datetime_as_string(time, unit='s')}Z"


def position(lon: float, lat: float) -> str | None:
    """Return a position in degrees and decimal minutes, 28-42.0N 087-30.0W; None for none."""
    if not (np.isfinite(lon) and np.isfinite(lat)):
        return None
    lon = (lon + 180) % 360 - 180
    return f"{_minutes(lat, 2)}{'N' if lat >= 0 else 'S'} {_minutes(lon, 3)}{'E' if lon >= 0 else 'W'}"


def _minutes(angle: float, digits: int) -> str:
    tenths = round(abs(angle) * 600)
    return f"{tenths // 600:0{digits}d}-{tenths % 600 / 10:04.1f}"


def plain(value: Any) -> Any:
    """Return a value that JSON can hold: numbers as numbers, NaN as null, times as ISO text."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return [plain(v) for v in value] if value.ndim else plain(value[()])
    if isinstance(value, np.datetime64):
        return None if np.isnat(value) else iso(value)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, (np.bool_, np.integer, np.floating)):
        value = value.item()
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Iterable):
        return [plain(v) for v in value]
    return str(value)


def run_id(attributes: Mapping[str, Any]) -> str:
    """Return a short name of a run, the same in all its files: a digest of what made it (case, forcing, versions), the seed.

    No spreadsheet takes it for a number or a date.
    """
    names = ("case", "seed", "forcing", "coast", "versions", "backend")
    text = "\0".join(f"{name}={attributes.get(name, '')}" for name in names)
    return f"{hashlib.sha256(text.encode()).hexdigest()[:10]}-s{attributes.get('seed', '')}"


def numbers(forecast: Forecast) -> dict[str, Any]:
    """Return the forecast's numbers for the summary: `scenarios` and, by time, `outputs`."""
    data = forecast.data
    names = [str(name) for name in data["scenario"].values]
    weights = data["scenario_probability"].values
    return {
        "scenarios": [
            {"name": name, "prior": weights[0, i], "posterior": weights[-1, i]} for i, name in enumerate(names)
        ],
        "outputs": [_output(forecast, i) for i in range(data.sizes["time"])],
    }


def _output(forecast: Forecast, i: int) -> dict[str, Any]:
    data, at = forecast.data, forecast.data.isel(time=i)
    held = [f"{shares.percent(share)}%" for share in at["share"].values]
    areas = at["containment_area"].values
    status = [str(s) for s in at["status"].values]
    return {
        "time": at["time"].values[()],
        "date_time_group": units.group(at["time"].values[()]),
        "mean": _place(at["mean_lon"].item(), at["mean_lat"].item()),
        "datum": _place(at["datum_lon"].item(), at["datum_lat"].item()),
        "area_nmi2": dict(zip(held, areas / NMI**2, strict=True)),
        "area_km2": dict(zip(held, areas / 1e6, strict=True)),
        "held_out": dict(zip(held, at["held_out"].values, strict=True)),
        "probability": dict(zip(status, at["status_probability"].values, strict=True)),
        **counts(data, i),
        "effective_by_status": dict(zip(status, at["status_effective"].values, strict=True)),
        "scenarios": {
            str(name): {
                "probability": at["scenario_probability"].values[j],
                "effective_particles": at["scenario_effective"].values[j],
                "mean": _place(at["scenario_mean_lon"].values[j], at["scenario_mean_lat"].values[j]),
            }
            for j, name in enumerate(at["scenario"].values)
        },
    }


def counts(data: Any, i: int) -> dict[str, float]:
    """Return how many particles, and worlds where there are any, a map stands on, by column of a table."""
    names = [name for name in ("effective_particles", "effective_worlds") if name in data]
    return {name: float(data[name].values[i]) for name in names}


def _place(lon: float, lat: float) -> dict[str, Any] | None:
    if not np.isfinite(lat):
        return None
    return {"lon": (lon + 180) % 360 - 180, "lat": lat, "text": position(lon, lat)}


def track(forecast: Forecast, run: str) -> str:
    """Return the mean track with areas and account by time, as CSV; run: its run_id, in the last column."""
    data = forecast.data
    held = [shares.percent(share) for share in data["share"].values]
    status = [str(s) for s in data["status"].values]
    rows = []
    for i in range(data.sizes["time"]):
        at = data.isel(time=i)
        when = at["time"].values[()]
        mean, datum = ((at[f"{n}_lon"].item(), at[f"{n}_lat"].item()) for n in ("mean", "datum"))
        rows.append(
            [
                iso(when),
                units.group(when),
                *_numbers((mean[0] + 180) % 360 - 180, mean[1], form=".6f"),
                position(*mean) or "",
                *_numbers((datum[0] + 180) % 360 - 180, datum[1], form=".6f"),
                position(*datum) or "",
                *_numbers(*(at["containment_area"].values / NMI**2), form=".6g"),
                *_numbers(*at["status_probability"].values, form=".6f"),
                *_numbers(*counts(data, i).values(), form=".6g"),
                run,
            ]
        )
    return csv_text(
        [
            "time",
            "date_time_group",
            "mean_lon",
            "mean_lat",
            "mean_position",
            "datum_lon",
            "datum_lat",
            "datum_position",
            *(f"area_{share}_nmi2" for share in held),
            *(f"probability_{s}" for s in status),
            *counts(data, 0),
            "run_id",
        ],
        rows,
    )


def ashore(forecast: Forecast, run: str) -> str:
    """Return where the object may be ashore at the end, cell by cell, likeliest first, and by when, as CSV.

    run: its run_id, in the last column. first_time is the first output time at which half of the cell's final probability had landed there.
    effective_particles: how many of those ashore count, in all cells together.
    """
    data = forecast.data
    every = data["probability_ashore"].values.astype(np.float64)
    last = every[-1].ravel()
    cells = np.flatnonzero(last > 0)
    cells = cells[np.argsort(-last[cells], kind="stable")]
    half = np.argmax(every.reshape(len(every), -1)[:, cells] >= 0.5 * last[cells], axis=0)
    lon, lat = np.meshgrid(data["lon"].values, data["lat"].values)
    many = f"{data['status_effective'].sel(status='ashore').values[-1]:.6g}"
    rows = []
    for cell, first in zip(cells, half, strict=True):
        x, y = (float(lon.ravel()[cell]) + 180) % 360 - 180, float(lat.ravel()[cell])
        when = iso(data["time"].values[first])
        rows.append([*_numbers(x, y, form=".6f"), position(x, y), f"{last[cell]:.4g}", when, many, run])
    header = ["lon", "lat", "position", "probability_ashore", "first_time", "effective_particles", "run_id"]
    return csv_text(header, rows)


def _numbers(*values: float, form: str) -> list[str]:
    return [format(value, form) if np.isfinite(value) else "" for value in values]


def csv_text(header: list[str], rows: list[list[Any]]) -> str:
    """Return a table as CSV that a spreadsheet shows and does not run; every CSV file of ours is made here.

    A text that a spreadsheet would take for a formula gets an apostrophe before it (OWASP, CSV injection), numbers stay
    numbers, negative ones too, and line breaks inside a cell become spaces: readers split there.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([map(_cell, row) for row in (header, *rows)])
    return text.getvalue()


def _cell(value: Any) -> Any:
    """Return a value as it may stand in a cell."""
    if not isinstance(value, str):
        return value
    # Letters that stand for a formula's in full width, and blanks before it, which spreadsheets pass over
    runs = value.lstrip().startswith(FORMULAS) or value.startswith(("\t", "\r", "\n"))
    flat = " ".join(value.splitlines())
    return f"'{flat}" if runs and not NUMBER.fullmatch(value) else flat


def geojson(forecast: Forecast, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the containment contours as a GeoJSON FeatureCollection (RFC 7946), cut at the antimeridian."""
    features, times = [], forecast.data["time"].values
    for one in forecast.contours:
        geometry = cut(one.polygon)
        if geometry.is_empty:
            continue
        features.append(
            {
                "type": "Feature",
                "geometry": {
                    "type": "MultiPolygon",
                    "coordinates": [
                        [np.round(ring.coords, 7).tolist() for ring in (part.exterior, *part.interiors)]
                        for part in geometry.geoms
                    ],
                },
                "properties": {
                    "time": iso(one.time),
                    "level": one.share,
                    "area_nmi2": one.area / NMI**2,
                    "area_km2": one.area / 1e6,
                    **counts(forecast.data, int(np.flatnonzero(times == one.time)[0])),
                },
            }
        )
    return {"type": "FeatureCollection", **{k: attributes[k] for k in sorted(attributes)}, "features": features}


def cut(polygon: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """Return polygons of unwrapped longitudes cut at the antimeridian, in [-180, 180], outer rings anticlockwise."""
    parts: list[Any] = []
    for turn in (-360, 0, 360):
        inside = shapely.intersection(polygon, shapely.box(turn - 180, -90, turn + 180, 90))
        moved = shapely.set_precision(shapely.transform(inside, lambda xy, turn=turn: _moved(xy, turn)), 1e-7)
        parts += [p for p in shapely.get_parts(moved) if p.geom_type == "Polygon" and p.area > 0]
    return shapely.MultiPolygon([shapely.geometry.polygon.orient(part) for part in parts])


def _moved(xy: Array, turn: int) -> Array:
    return np.asarray(xy - np.array([turn, 0.0]))
