"""A finished run as its folder holds it: what files for other programs are made from."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift.apps.export import checked
from drift.apps.export.checked import Check, fraction, maybe, moment, number, words
from drift.case.values import units
from drift.products.files import publication
from geo import notation
from geo.errors import UserError

# variables of forecast.nc that no format has
LARGE = ["probability_by_scenario", "probability_ashore"]
FORECAST: Mapping[str, tuple[str, ...]] = {
    "time": ("time",),
    "share": ("share",),
    **{f"{name}_{axis}": ("time",) for name in ("mean", "datum") for axis in ("lon", "lat")},
}
CELLS: Mapping[str, tuple[str, ...]] = {
    "lon": ("lon",),
    "lat": ("lat",),
    "probability": ("time", "lat", "lon"),
    "containment": ("time", "lat", "lon"),
}
# What is read of the files of a run: checks of properties and columns by name.
READ: Mapping[str, Mapping[str, Check]] = {
    "contours.geojson": {"time": moment, "level": fraction, "area_nmi2": number},
    "sorties.geojson": {
        "kind": words,
        "shape": words,
        "time": maybe(moment),
        "start": maybe(moment),
        "end": maybe(moment),
    }
    | {name: maybe(number) for name in ("poc", "pod", "pos", "belief")},
    "plan.geojson": {"area": words, "unit": words, "shape": words, "pos": number}
    | dict.fromkeys(("takeoff", "home", "on_scene", "off_scene"), moment),
    "washup.geojson": {
        "name": words,
        "position": words,
        "access": words,
        "rank": number,
        "ever": number,
    }
    | dict.fromkeys(("length_km", "number_10", "number_90", "expected", "probability"), number),
    "patrols.geojson": {"patrol_unit": words, "time": moment, "stretch_id": words, "stretch": words}
    | dict.fromkeys(("length_km", "detection", "found"), number),
    "origin.geojson": {
        "kind": words,
        "time": maybe(moment),
        "level": maybe(fraction),
        "area_nmi2": maybe(number),
    },
    "finds.csv": {
        "time": moment,
        "lon_deg": number,
        "lat_deg": number,
        "probability_beforehand": number,
        "tail": number,
    }
    | {"none_of_ours": number}
    | dict.fromkeys(("number", "name", "position", "stretch", "class", "by", "odd"), words),
}


LINES, AREAS = ("MultiLineString",), ("MultiPolygon",)
KINDS: Mapping[str, tuple[str, ...]] = {
    "contours.geojson": AREAS,
    "washup.geojson": LINES,
    "patrols.geojson": LINES,
}


def _features(path: Path) -> list[dict[str, Any]]:
    return checked.features(path, READ[path.name], KINDS.get(path.name, tuple(checked.DEPTH)))


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
        """The description of the run in every file, beginning with what it must not be used for."""
        told = self.forecast.attrs
        parts = [str(told.get("caution", "")), f"run {self.run}", str(told.get("source", ""))]
        parts += [f"WARNING: {told['warning']}"] if told.get("warning") else []
        parts += [f"Errors: {told['uncertainty']}"] if told.get("uncertainty") else []
        return ". ".join(part for part in parts if part)

    @property
    def shares(self) -> list[float]:
        """The shares whose areas are told."""
        return [float(share) for share in self.forecast["share"].values]

    def features(self, name: str) -> list[dict[str, Any]]:
        """Return the features of a GeoJSON file of the run; none where it has no such file."""
        return _features(self.folder / name) if name in self.names else []

    def rows(self, name: str) -> list[dict[str, str]]:
        """Return the rows of a CSV file of the run; none where it has no such file."""
        return checked.rows(self.folder / name, READ[name]) if name in self.names else []

    def search(self) -> list[dict[str, Any]]:
        """Return the features of what was searched and told; of a plan without its own sorties,
        which are not flown.
        """
        found = [
            f
            for f in self.features("sorties.geojson")
            if f["properties"].get("status") != "planned"
        ]
        for feature in found:
            told = feature["properties"]
            times = (
                ("start", "end")
                if told["shape"] == "legs"
                else ("time",)
                if told["kind"] == "contact"
                else ()
            )
            wrong = [name for name in times if not told.get(name)]
            wrong += ["belief"] if told["kind"] == "contact" and told.get("belief") is None else []
            if wrong:
                raise checked.damaged(
                    self.folder / "sorties.geojson", f"a {told['kind']} has no {wrong[0]}"
                )
        return found

    def areas(self) -> list[tuple[np.datetime64, float, dict[str, Any], dict[str, Any]]]:
        """Return (time, share, geometry, properties) of each area at the outputs that are wanted,
        in their order.
        """
        wanted = {notation.iso(time): time for time in self.forecast["time"].values}
        shares, levels = (
            self.shares,
            {f["properties"]["level"] for f in self.features("contours.geojson")},
        )
        if not levels <= set(shares):
            strange = min(levels - set(shares))
            raise checked.damaged(
                self.folder / "contours.geojson", f"level {strange} is not a share of forecast.nc"
            )
        found = [
            (wanted[told["time"]], float(told["level"]), feature["geometry"], told)
            for feature in self.features("contours.geojson")
            if (told := feature["properties"])["time"] in wanted
        ]
        return sorted(found, key=lambda area: (area[0], area[1]))

    def positions(self, name: str) -> list[tuple[np.datetime64, float, float]]:
        """Return (time, lon, lat) [deg] of "mean" or "datum" where there is one; longitudes run on."""
        at = [self.forecast[key].values for key in ("time", f"{name}_lon", f"{name}_lat")]
        rows = zip(*at, strict=True)
        return [
            (time, float(lon), float(lat))
            for time, lon, lat in rows
            if np.isfinite(lat) and np.isfinite(lon)
        ]

    def cells(self) -> xr.Dataset:
        """Return the forecast with its cells, checked; raise UserError where they are damaged."""
        path = self.folder / "forecast.nc"
        for name, dims in CELLS.items():
            if name not in self.forecast or self.forecast[name].dims != dims:
                raise UserError(
                    f"results {self.folder}: forecast.nc has no {name} by {', '.join(dims)}; run the case again"
                )
        checked.within(
            path,
            self.forecast,
            {"lon": 720, "lat": 90, "probability": 1 + 1e-6, "containment": 1 + 1e-6},
        )
        for name, most in (("lon", 720), ("lat", 90)):
            edges = f"{name}_bnds"
            if edges not in self.forecast:
                raise UserError(
                    f"results {self.folder}: come from an older version, which wrote no cell edges; run the case again"
                )
            held = self.forecast[edges]
            count = self.forecast.sizes[name]
            flat = np.asarray(held.values).ravel()
            if (
                held.shape != (count, 2)
                or held.dtype.kind != "f"
                or not np.isfinite(flat).all()
                or not (np.diff(flat[::2]) > 0).all()
                or not flat[0] < flat[-1]
            ):
                raise UserError(
                    f"results {self.folder}: forecast.nc is damaged: {edges} are not cell edges; run the case again"
                )
            checked.within(path, self.forecast, {edges: most + 1})
        return self.forecast


@dataclass(frozen=True)
class Release:
    """A whole result of a backward run."""

    folder: Path
    names: frozenset[str]
    data: xr.Dataset

    @property
    def title(self) -> str:
        """The title of the case."""
        return str(self.data.attrs["title"])

    @property
    def run(self) -> str:
        """The run_id."""
        return str(self.data.attrs["run_id"])

    @property
    def words(self) -> str:
        """The description of the run in every file, beginning with what it must not be used for."""
        told = self.data.attrs
        parts = [
            str(told.get("caution", "")),
            f"run {self.run}",
            str(told.get("source", "")),
            str(told.get("comment", "")),
        ]
        return ". ".join(part for part in parts if part)

    def features(self) -> list[dict[str, Any]]:
        """Return areas, mean and finds."""
        return _features(self.folder / "origin.geojson")


def open_result(folder: str | os.PathLike[str], times: Sequence[str] = ()) -> Finished | Release:
    """Return what a folder holds; raise UserError unless it is the whole result of a run with a
    forecast, or of `drift origin`.

    times: of the outputs that are wanted, as case files write times; all by default. An origin has
    none.
    """
    folder = Path(folder)
    names = frozenset(path.name for path in publication.results(folder))
    if "forecast.nc" not in names and {"origin.nc", "origin.geojson"} <= names:
        if times:
            raise UserError(
                f"results {folder}: come from drift origin, which has no output times; remove --time"
            )
        data = checked.dataset(folder / "origin.nc", ["probability", "prior"], {"time": ("time",)})
        return Release(folder, names, data)
    if "forecast.nc" not in names:
        raise UserError(
            f"results {folder}: hold no forecast.nc; give a folder written by drift run, drift plan or drift origin"
        )
    path = folder / "forecast.nc"
    forecast = checked.dataset(path, LARGE, FORECAST)
    checked.within(
        path,
        forecast,
        {"mean_lat": 90, "datum_lat": 90, "mean_lon": 720, "datum_lon": 720, "share": 1},
    )
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
        # a date-time group has no seconds
        found = np.flatnonzero(minutes == time.astype("datetime64[m]")).tolist()
        if not found:
            ends = f"{notation.group(outputs[0])} to {notation.group(outputs[-1])}"
            raise UserError(
                f'--time "{text}": there is no output in that minute; they go from {ends}, see track.csv'
            )
        wanted.update(found)
    return [k for k in order if k in wanted]
