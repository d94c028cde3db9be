"""The only writer of files: a run's results in one folder, complete or not there at all.

Everything is written into a hidden folder beside the target and renamed at the end: a killed run leaves no half
file. Files: forecast.nc, particles.nc, summary.json, contours.geojson, track.csv, ashore.csv, and the figures.
Data depend on the forecast alone; the date of creation stands in attributes only.
"""

import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift import tables
from drift.cells import Array
from drift.products import Forecast
from drift.status import Status
from geo import sphere
from geo.errors import UserError

Figure = Callable[[Path], None]

EPOCH = "seconds since 1970-01-01 00:00:00"


@dataclass(frozen=True)
class Trajectories:
    """A subsample's tracks; NaN-free: a particle that has ended stays where it ended."""

    time: Array  # datetime64, (t,)
    slot: Array  # int, (m,): number of the particle
    scenario: Array  # int, (m,)
    lon: Array  # int32 binary angle, (m, t)
    lat: Array  # int32 binary angle, (m, t)
    status: Array  # drift.status.Status, (m, t)
    weight: Array  # probability of the particle [1], (m, t)


def check_folder(folder: Path, overwrite: bool = False) -> None:
    """Raise UserError unless results may be written to the folder; made before the work starts. Creates nothing."""
    advice = "name another with --out, or add --overwrite"
    if folder.is_symlink() or folder.exists():
        if not folder.is_dir():
            raise UserError(f"output folder {folder}: is a file, not a folder; {advice.split(',')[0]}")
        if any(folder.iterdir()) and not overwrite:
            raise UserError(f"output folder {folder}: is not empty; {advice}")
    ground = folder if folder.is_dir() else next(p for p in folder.absolute().parents if p.exists())
    if not ground.is_dir() or not os.access(ground, os.W_OK):
        raise UserError(f"output folder {folder}: cannot write in {ground}; name another with --out")


def write(
    folder: Path,
    forecast: Forecast,
    trajectories: Trajectories,
    summary: Mapping[str, Any],
    figures: Mapping[str, Figure],
    *,
    attributes: Mapping[str, str],
    overwrite: bool = False,
) -> list[Path]:
    """Write all results and return their paths.

    summary: what the run knows besides the forecast (case, versions, forcing, wall time); the forecast's numbers are
    added. figures: file name -> function that draws it to a path. attributes: what every file carries
    (title, case, seed, versions, forcing); `history` and `date_created` are added.
    """
    check_folder(folder, overwrite)
    now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    stamped = {
        "Conventions": "CF-1.11",
        **attributes,
        "history": f"{now} {attributes.get('source', 'casp-drift')}",
        "date_created": now,
    }
    with _staging(folder) as staging:
        _netcdf(forecast.data.assign_attrs(stamped), staging / "forecast.nc")
        _netcdf(
            particles(trajectories, forecast).assign_attrs({**stamped, "featureType": "trajectory"}),
            staging / "particles.nc",
        )
        _json({**stamped, **summary, **tables.numbers(forecast)}, staging / "summary.json", indent=1)
        _json(tables.geojson(forecast, stamped), staging / "contours.geojson", indent=None)
        header = "; ".join(f"{k}: {' '.join(str(v).split())}" for k, v in attributes.items() if len(str(v)) < 200)
        for name, text in (("track.csv", tables.track(forecast)), ("ashore.csv", tables.ashore(forecast))):
            (staging / name).write_text(f"# {header}\n{text}", encoding="utf-8", newline="\n")
        for name, draw in figures.items():
            draw(staging / name)
        names = sorted(path.name for path in staging.iterdir())
        _publish(staging, folder, names)
    return [folder / name for name in names]


@contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    """A hidden folder beside the target, gone afterwards; what a killed run left a day ago goes too."""
    parent = folder.absolute().parent
    parent.mkdir(parents=True, exist_ok=True)
    prefix = f".{folder.absolute().name}.partial-"
    for old in parent.glob(f"{prefix}*"):
        if time.time() - old.stat().st_mtime > 86_400:
            shutil.rmtree(old, ignore_errors=True)
    staging = Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
    try:
        staging.chmod(0o777 & ~_umask())
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _publish(staging: Path, folder: Path, names: list[str]) -> None:
    """Move the finished files: the folder at once where there is none yet, else file by file."""
    if folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir()):
        folder.rmdir()
    if not folder.exists():
        os.rename(staging, folder)
        return
    for name in names:
        os.replace(staging / name, folder / name)


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
    data.to_netcdf(path, engine="netcdf4", format="NETCDF4", encoding=encoding)


def particles(tracks: Trajectories, forecast: Forecast) -> xr.Dataset:
    """Return a subsample's tracks as CF trajectories that share their times, (trajectory, time)."""
    codes = np.array([int(s) for s in Status], np.int8)
    both = ("trajectory", "time")
    names = [str(name) for name in forecast.data["scenario"].values]
    around = float(forecast.data["lon"][0]) - 180
    lon = around + (sphere.to_degrees(tracks.lon) - around) % 360  # no jump at the antimeridian
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
                    "flag_meanings": " ".join("_".join(name.split()) for name in names),
                },
            ),
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


def _json(value: Any, path: Path, indent: int | None) -> None:
    path.write_text(json.dumps(tables.plain(value), indent=indent, allow_nan=False) + "\n", encoding="utf-8")
