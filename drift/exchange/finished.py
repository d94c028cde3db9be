"""A finished run as its folder holds it: what files for other programs are made from."""

import csv
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift.case import units
from drift.output import publication
from geo import notation
from geo.errors import UserError

LARGE = ["probability_by_scenario", "probability_ashore"]  # variables of forecast.nc that no format has


@dataclass(frozen=True)
class Finished:
    """A whole result that holds a forecast."""

    folder: Path
    names: frozenset[str]  # of its files
    forecast: xr.Dataset  # at the outputs that are wanted, in ascending order

    @property
    def title(self) -> str:
        """The title of the case."""
        return str(self.forecast.attrs["title"])

    @property
    def run(self) -> str:
        """The run_id."""
        return str(self.forecast.attrs["run_id"])

    @property
    def words(self) -> str:
        """What every file says of the run: what it must not be used for first."""
        told = self.forecast.attrs
        parts = [told.get("caution", ""), f"run {self.run}", str(told.get("source", ""))]
        parts += [f"WARNING: {told['warning']}"] if told.get("warning") else []
        parts += [f"Errors: {told['uncertainty']}"] if told.get("uncertainty") else []
        return ". ".join(part for part in parts if part)

    @property
    def shares(self) -> list[float]:
        """The shares whose areas are told."""
        return [float(share) for share in self.forecast["share"].values]

    def features(self, name: str) -> list[dict[str, Any]]:
        """Return the features of a GeoJSON file of the run; none where it has no such file."""
        if name not in self.names:
            return []
        features: list[dict[str, Any]] = json.loads((self.folder / name).read_bytes())["features"]
        return features

    def rows(self, name: str) -> list[dict[str, str]]:
        """Return the rows of a CSV file of the run; none where it has no such file."""
        if name not in self.names:
            return []
        with open(self.folder / name, newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))

    def search(self) -> list[dict[str, Any]]:
        """Return the features of what was searched and told; of a plan without its own sorties, which are not flown."""
        return [f for f in self.features("sorties.geojson") if f["properties"].get("status") != "planned"]

    def areas(self) -> list[tuple[np.datetime64, float, dict[str, Any], dict[str, Any]]]:
        """Return (time, share, geometry, properties) of each area at the outputs that are wanted, in their order."""
        wanted = {notation.iso(time): time for time in self.forecast["time"].values}
        found = [
            (wanted[told["time"]], float(told["level"]), feature["geometry"], told)
            for feature in self.features("contours.geojson")
            if (told := feature["properties"])["time"] in wanted
        ]
        return sorted(found, key=lambda area: (area[0], area[1]))

    def positions(self, name: str) -> list[tuple[np.datetime64, float, float]]:
        """Return (time, lon, lat) [deg] of "mean" or "datum" where there is one; longitudes run on."""
        at = [self.forecast[key].values for key in ("time", f"{name}_lon", f"{name}_lat")]
        return [(time, float(lon), float(lat)) for time, lon, lat in zip(*at, strict=True) if np.isfinite(lat)]


def opened(folder: str | os.PathLike[str], times: Sequence[str] = ()) -> Finished:
    """Return what a folder holds; raise UserError unless it is the whole result of a run with a forecast.

    times: of the outputs that are wanted, as case files write times; all by default.
    """
    folder = Path(folder)
    names = frozenset(path.name for path in publication.results(folder))
    if "forecast.nc" not in names:
        raise UserError(f"results {folder}: hold no forecast.nc; export what drift run or drift plan wrote")
    forecast = xr.load_dataset(folder / "forecast.nc", drop_variables=LARGE)
    return Finished(folder, names, forecast.isel(time=_chosen(forecast["time"].values, times)))


def _chosen(outputs: Any, times: Sequence[str]) -> list[int]:
    """Return which outputs are wanted, in ascending order of time."""
    order: list[int] = np.argsort(outputs, kind="stable").tolist()
    if not times:
        return order
    minutes, wanted = outputs.astype("datetime64[m]"), set[int]()
    for text in times:
        try:
            time = units.resolve(units.time(text), outputs[0].astype("datetime64[s]"))
        except ValueError as error:
            raise UserError(f"--time: {error}") from None
        found = np.flatnonzero(minutes == time.astype("datetime64[m]")).tolist()  # a date-time group has no seconds
        if not found:
            ends = f"{notation.group(outputs[0])} to {notation.group(outputs[-1])}"
            raise UserError(f'--time "{text}": there is no output in that minute; they go from {ends}, see track.csv')
        wanted.update(found)
    return [k for k in order if k in wanted]
