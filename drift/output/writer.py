"""What a run hands out, and how it is written: one folder, complete or not there at all (see drift.output.publication).

Files: forecast.nc, particles.nc, summary.json, contours.geojson, track.csv, ashore.csv, the figures, and manifest.json, which
lists the others. Data depend on the forecast alone; the date of creation stands in attributes only.
"""

import json
import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift.forecast import tables
from drift.forecast.build import Forecast
from drift.motion.status import Status
from drift.output import formats, manifest, publication
from drift.output.interrupt import undisturbed
from geo import notation, sphere
from geo.cells import Array
from geo.errors import UserError

Figure = Callable[[Path], None]

SUMMARY = "summary.json"
USUAL = (  # what every forecast writes
    "forecast.nc",
    "particles.nc",
    "contours.geojson",
    "track.csv",
    "ashore.csv",
    "map.png",
    "snapshots.png",
    SUMMARY,
    manifest.NAME,
)
EPOCH = "seconds since 1970-01-01 00:00:00"


@dataclass(frozen=True)
class Trajectories:
    """A subsample's tracks; NaN-free: a particle that has ended stays where it ended."""

    time: Array  # datetime64, (t,)
    slot: Array  # int, (m,): number of the particle
    scenario: Array  # int, (m,)
    lon: Array  # int32 binary angle, (m, t)
    lat: Array  # int32 binary angle, (m, t)
    status: Array  # drift.motion.status.Status, (m, t)
    weight: Array  # probability of the particle [1], (m, t)
    # int32 [s] in the direction of the run after its start, (m,); -1: none; None: not known
    release: Array | None = None
    ended: Array | None = None  # when it went ashore, outside the forcing or left the domain
    edge: Array | None = None  # int32 (m,), edge of the shoreline where it went ashore; -1: none; None: not known


@dataclass(frozen=True)
class Product:
    """A file beside the forecast's own: its name, and what makes its contents from the attributes of all files."""

    name: str
    make: Callable[[Mapping[str, str]], xr.Dataset | str | dict[str, Any]]


def check_folder(folder: Path, overwrite: bool = False) -> None:
    """Raise UserError unless results may be written to the folder; made before the work starts. Creates nothing."""
    publication.check(folder, overwrite, USUAL)


def write(
    folder: Path,
    forecast: Forecast,
    trajectories: Trajectories,
    summary: Mapping[str, Any],
    figures: Mapping[str, Figure],
    *,
    attributes: Mapping[str, str],
    more: Sequence[Product] = (),
    overwrite: bool = False,
) -> list[Path]:
    """Write all results of a forecast and return their paths; see `publish`. The forecast's numbers join the summary."""
    tracks = particles(trajectories, forecast).assign_attrs(featureType="trajectory")
    products = (
        Product("forecast.nc", lambda stamped: forecast.data),
        Product("particles.nc", lambda stamped: tracks),
        Product("contours.geojson", lambda stamped: tables.geojson(forecast, stamped)),
        Product("track.csv", lambda stamped: tables.track(forecast, stamped["run_id"])),
        Product("ashore.csv", lambda stamped: tables.ashore(forecast, stamped["run_id"])),
        *more,
    )
    whole = {**summary, **tables.numbers(forecast)}
    return publish(folder, products, whole, figures, attributes=attributes, overwrite=overwrite)


def publish(
    folder: Path,
    products: Sequence[Product],
    summary: Mapping[str, Any],
    figures: Mapping[str, Figure],
    *,
    attributes: Mapping[str, str],
    overwrite: bool = False,
) -> list[Path]:
    """Write products, figures and a summary into a folder, complete or not at all, and return their paths.

    summary: what the run knows besides its products (case, versions, forcing, wall time). figures: file name -> function
    that draws it to a path. attributes: what every file carries (title, case, seed, versions, forcing); `run_id`,
    `history` and `date_created` are added. With `overwrite` what an earlier run wrote into the folder and this one does
    not is taken away.
    """
    publication.check(folder, overwrite)
    now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    stamped = {
        "Conventions": "CF-1.11",
        **attributes,
        "run_id": formats.run_id(attributes),
        "history": f"{now} {attributes.get('source', 'casp-drift')}",
        "date_created": now,
    }
    try:
        with publication.staged(folder) as stage:
            for product in products:
                _product(product, stamped, stage.new)
            for name, draw in figures.items():
                draw(stage.new / name)
            _json({**stamped, **summary}, stage.new / SUMMARY, indent=1)
            return publication.publish(stage, stamped["run_id"], overwrite)
    except OSError as error:
        file = f" at {os.path.basename(error.filename)}" if isinstance(error.filename, str) else ""
        raise UserError(
            f"output folder {folder}: cannot be written ({error.strerror or error}{file}), and nothing of this run was; "
            "make room, or name another with --out"
        ) from error


def _product(product: Product, stamped: Mapping[str, str], staging: Path) -> None:
    """Write what a product holds: a dataset with the run's attributes, a GeoJSON object, or the text of a table."""
    made, path = product.make(stamped), staging / product.name
    if isinstance(made, xr.Dataset):
        _netcdf(made.assign_attrs({**stamped, **made.attrs}), path)
    elif isinstance(made, str):
        path.write_text(made, encoding="utf-8", newline="\n")
    else:
        _json(made, path, indent=None)


def _netcdf(data: xr.Dataset, path: Path) -> None:
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in data.variables.items():
        encoding[str(name)] = {"_FillValue": None}
        if variable.dtype.kind == "f":
            if name not in data.dims:
                encoding[str(name)] = {"_FillValue": variable.dtype.type(np.nan)}
            if variable.ndim > 1:
                chunks = (*([1] * (variable.ndim - 2)), *variable.shape[-2:])
                encoding[str(name)] |= {"zlib": True, "complevel": 1, "shuffle": True, "chunksizes": chunks}
        elif variable.ndim > 1:
            encoding[str(name)] |= {"zlib": True, "complevel": 1, "shuffle": True}
        if variable.dtype.kind == "M":
            encoding[str(name)] = {"units": EPOCH, "calendar": "standard", "dtype": "int64", "_FillValue": None}
    try:
        with undisturbed():  # an exception in the middle of it leaves HDF5's lock taken: closing waits for ever
            data.to_netcdf(path, engine="netcdf4", format="NETCDF4", encoding=encoding)
    except RuntimeError as error:  # what netCDF4 raises where HDF5 cannot write
        raise OSError(f"{path.name}: {error}") from error


def particles(tracks: Trajectories, forecast: Forecast) -> xr.Dataset:
    """Return a subsample's tracks as CF trajectories that share their times, (trajectory, time)."""
    codes = np.array([int(s) for s in Status], np.int8)
    both = ("trajectory", "time")
    names = [str(name) for name in forecast.data["scenario"].values]
    around = float(forecast.data["lon"][0]) - 180
    lon = sphere.east_of_degrees(sphere.to_degrees(tracks.lon), around)  # no jump at the antimeridian
    return xr.Dataset(
        {
            "status": (
                both,
                tracks.status.astype(np.int8),
                {
                    "long_name": "what became of the particle",
                    "flag_values": codes,
                    "flag_meanings": " ".join(s.name.lower() for s in Status),
                },
            ),
            "weight": (both, tracks.weight.astype(np.float64), {"long_name": "particle's probability", "units": "1"}),
            "scenario": (
                "trajectory",
                tracks.scenario.astype(np.int32),
                {
                    "long_name": "scenario",
                    "flag_values": np.arange(len(names), dtype=np.int32),
                    "flag_meanings": " ".join(_flags(names)),
                },
            ),
            **_events(tracks),
        },
        {
            "trajectory": (
                "trajectory",
                tracks.slot.astype(np.int64),
                {"cf_role": "trajectory_id", "long_name": "number of the particle"},
            ),
            "time": (
                "time",
                tracks.time.astype("datetime64[ns]"),
                {"standard_name": "time", "long_name": "time, UTC", "axis": "T"},
            ),
            "lon": (both, lon, {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east"}),
            "lat": (
                both,
                sphere.to_degrees(tracks.lat),
                {"standard_name": "latitude", "long_name": "latitude", "units": "degrees_north"},
            ),
        },
    )


def _flags(names: Sequence[str]) -> list[str]:
    """Return names as words of CF's flag_meanings, each another: letters, digits and _-.+@ alone, no blank."""
    made: list[str] = []
    for name in names:
        plain = word = re.sub(r"[^\w.+@-]", "_", "_".join(name.split()))
        number = 1
        while word in made:
            number += 1
            word = f"{plain}_{number}"
        made.append(word)
    return made


def _events(tracks: Trajectories) -> dict[str, tuple[str, Array, dict[str, str]]]:
    """Return as variables when each trajectory was released and ended, and where on the coast; none that is not known."""
    found: dict[str, tuple[str, Array, dict[str, str]]] = {}
    direction = -1 if tracks.time[-1] < tracks.time[0] else 1
    halted = np.isin(tracks.status[:, -1], (Status.ASHORE, Status.OUTSIDE, Status.LEFT))

    clock = {"units": EPOCH, "calendar": "standard"}  # written as numbers: xarray cannot encode times that are all NaT
    begin = notation.epoch(tracks.time[0])

    def times(seconds: Array, known: Array) -> Array:
        return np.where(known & (seconds >= 0), begin + direction * seconds.astype(np.float64), np.nan)

    if tracks.release is not None:
        released = times(tracks.release, np.ones(len(tracks.slot), bool))
        found["time_released"] = ("trajectory", released, {"long_name": "time of release, UTC", **clock})
    if tracks.ended is not None:
        words = {"long_name": "time of going ashore, out of the forcing or out of the domain, UTC; see status", **clock}
        found["time_ended"] = ("trajectory", times(tracks.ended, halted), words)
    if tracks.edge is not None:
        words = {"long_name": "edge of the run's shoreline where it went ashore", "comment": "-1: not ashore"}
        found["coast_edge"] = ("trajectory", tracks.edge.astype(np.int32), words)
    return found


def _json(value: Any, path: Path, indent: int | None) -> None:
    path.write_text(json.dumps(formats.plain(value), indent=indent, allow_nan=False) + "\n", encoding="utf-8")
