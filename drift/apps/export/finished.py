"""A finished run as read from its folder: the input of every export format."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from drift.apps.export import checked
from drift.apps.export.checked import (
    Check,
    allow_missing,
    is_finite_number,
    is_fraction,
    is_text,
    is_time,
)
from drift.case.values import units
from drift.products.files import publication
from geo import notation
from geo.errors import UserError

# variables of forecast.nc that no export format uses
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
# Checks of properties and columns by name, for the files of a run that are read.
READ: Mapping[str, Mapping[str, Check]] = {
    "contours.geojson": {"time": is_time, "level": is_fraction, "area_nmi2": is_finite_number},
    "sorties.geojson": {
        "kind": is_text,
        "shape": is_text,
        "time": allow_missing(is_time),
        "start": allow_missing(is_time),
        "end": allow_missing(is_time),
    }
    | {name: allow_missing(is_finite_number) for name in ("poc", "pod", "pos", "belief")},
    "plan.geojson": {"area": is_text, "unit": is_text, "shape": is_text, "pos": is_finite_number}
    | dict.fromkeys(("takeoff", "home", "on_scene", "off_scene"), is_time),
    "washup.geojson": {
        "name": is_text,
        "position": is_text,
        "access": is_text,
        "rank": is_finite_number,
        "ever": is_finite_number,
    }
    | dict.fromkeys(
        ("length_km", "number_10", "number_90", "expected", "probability"), is_finite_number
    ),
    "patrols.geojson": {
        "patrol_unit": is_text,
        "time": is_time,
        "stretch_id": is_text,
        "stretch": is_text,
    }
    | dict.fromkeys(("length_km", "detection", "found"), is_finite_number),
    "origin.geojson": {
        "kind": is_text,
        "time": allow_missing(is_time),
        "level": allow_missing(is_fraction),
        "area_nmi2": allow_missing(is_finite_number),
    },
    "finds.csv": {
        "time": is_time,
        "lon_deg": is_finite_number,
        "lat_deg": is_finite_number,
        "probability_beforehand": is_finite_number,
        "tail": is_finite_number,
    }
    | {"none_of_ours": is_finite_number}
    | dict.fromkeys(("number", "name", "position", "stretch", "class", "by", "odd"), is_text),
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
    """A complete result with a forecast."""

    folder: Path
    names: frozenset[str]  # of its files
    forecast: xr.Dataset  # at the requested outputs, in ascending order

    @property
    def title(self) -> str:
        """The title of the case."""
        return str(self.forecast.attrs["title"])

    @property
    def run(self) -> str:
        """The identifier of the run (run_id)."""
        return str(self.forecast.attrs["run_id"])

    @property
    def words(self) -> str:
        """The description of the run in every file; it starts with the caution."""
        attributes = self.forecast.attrs
        parts = [
            str(attributes.get("caution", "")),
            f"run {self.run}",
            str(attributes.get("source", "")),
        ]
        parts += [f"WARNING: {attributes['warning']}"] if attributes.get("warning") else []
        parts += [f"Errors: {attributes['uncertainty']}"] if attributes.get("uncertainty") else []
        return ". ".join(part for part in parts if part)

    @property
    def shares(self) -> list[float]:
        """The shares whose containment areas are reported, 0 to 1."""
        return [float(share) for share in self.forecast["share"].values]

    def features(self, name: str) -> list[dict[str, Any]]:
        """Return the features of a GeoJSON file of the run; [] if there is no such file."""
        return _features(self.folder / name) if name in self.names else []

    def rows(self, name: str) -> list[dict[str, str]]:
        """Return the rows of a CSV file of the run; an empty list if there is no such file."""
        return checked.rows(self.folder / name, READ[name]) if name in self.names else []

    def search(self) -> list[dict[str, Any]]:
        """Return the features of sorties, looks and contacts, without planned sorties."""
        found = [
            f
            for f in self.features("sorties.geojson")
            if f["properties"].get("status") != "planned"
        ]
        for feature in found:
            properties = feature["properties"]
            times = (
                ("start", "end")
                if properties["shape"] == "legs"
                else ("time",)
                if properties["kind"] == "contact"
                else ()
            )
            missing = [name for name in times if not properties.get(name)]
            missing += (
                ["belief"]
                if properties["kind"] == "contact" and properties.get("belief") is None
                else []
            )
            if missing:
                raise checked.damaged_file_error(
                    self.folder / "sorties.geojson", f"a {properties['kind']} has no {missing[0]}"
                )
        return found

    def areas(self) -> list[tuple[np.datetime64, float, dict[str, Any], dict[str, Any]]]:
        """Return (time, share, geometry, properties) of areas at the requested outputs, sorted."""
        wanted = {notation.iso(time): time for time in self.forecast["time"].values}
        shares, levels = (
            self.shares,
            {f["properties"]["level"] for f in self.features("contours.geojson")},
        )
        if not levels <= set(shares):
            strange = min(levels - set(shares))
            raise checked.damaged_file_error(
                self.folder / "contours.geojson", f"level {strange} is not a share of forecast.nc"
            )
        found = [
            (
                wanted[properties["time"]],
                float(properties["level"]),
                feature["geometry"],
                properties,
            )
            for feature in self.features("contours.geojson")
            if (properties := feature["properties"])["time"] in wanted
        ]
        return sorted(found, key=lambda area: (area[0], area[1]))

    def positions(self, name: str) -> list[tuple[np.datetime64, float, float]]:
        """Return (time, lon, lat) [deg] of "mean" or "datum" where known, unwrapped."""
        at = [self.forecast[key].values for key in ("time", f"{name}_lon", f"{name}_lat")]
        rows = zip(*at, strict=True)
        return [
            (time, float(lon), float(lat))
            for time, lon, lat in rows
            if np.isfinite(lat) and np.isfinite(lon)
        ]

    def cells_with_ashore(self) -> xr.Dataset:
        """Return `cells` with the probability ashore in each; raise UserError if it is damaged."""
        path = self.folder / "forecast.nc"
        left_out = [*CELLS, "probability_by_scenario"]
        wanted = {"probability_ashore": CELLS["probability"]}
        ashore = checked.dataset(path, left_out, wanted)["probability_ashore"]
        return self.cells().assign(probability_ashore=ashore)  # xarray takes the outputs it has

    def cells(self) -> xr.Dataset:
        """Return the forecast with checked grid cells; raise UserError if they are damaged."""
        path = self.folder / "forecast.nc"
        for name, dims in CELLS.items():
            if name not in self.forecast or self.forecast[name].dims != dims:
                raise UserError(
                    f"results {self.folder}: forecast.nc has no {name} by {', '.join(dims)}; run the case again"
                )
        checked.reject_beyond_limits(
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
            bounds = self.forecast[edges]
            count = self.forecast.sizes[name]
            flat = np.asarray(bounds.values).ravel()
            if (
                bounds.shape != (count, 2)
                or bounds.dtype.kind != "f"
                or not np.isfinite(flat).all()
                or not (np.diff(flat[::2]) > 0).all()
                or not flat[0] < flat[-1]
            ):
                raise UserError(
                    f"results {self.folder}: forecast.nc is damaged: {edges} are not cell edges; run the case again"
                )
            checked.reject_beyond_limits(path, self.forecast, {edges: most + 1})
        return self.forecast


@dataclass(frozen=True)
class Release:
    """A complete result of a backward run (`drift origin`)."""

    folder: Path
    names: frozenset[str]
    data: xr.Dataset

    @property
    def title(self) -> str:
        """The title of the case."""
        return str(self.data.attrs["title"])

    @property
    def run(self) -> str:
        """The identifier of the run (run_id)."""
        return str(self.data.attrs["run_id"])

    @property
    def words(self) -> str:
        """The description of the run in every file; it starts with the caution."""
        attributes = self.data.attrs
        parts = [
            str(attributes.get("caution", "")),
            f"run {self.run}",
            str(attributes.get("source", "")),
            str(attributes.get("comment", "")),
        ]
        return ". ".join(part for part in parts if part)

    def features(self) -> list[dict[str, Any]]:
        """Return the features of release areas, mean position and finds."""
        return _features(self.folder / "origin.geojson")


def open_result(folder: str | os.PathLike[str], times: Sequence[str] = ()) -> Finished | Release:
    """Open the complete result in a folder.

    Args:
        folder: results of a run with a forecast, or of `drift origin`.
        times: outputs to export, as case files write times; () for all. An origin has none.

    Returns:
        The forecast or the release, checked.

    Raises:
        UserError: the folder contains no such result, or it is damaged.
    """
    folder = Path(folder)
    names = frozenset(path.name for path in publication.results(folder))
    if "forecast.nc" not in names and {"origin.nc", "origin.geojson"} <= names:
        if times:
            raise UserError(
                f"results {folder}: come from drift origin, which has no output times; remove --time TIME"
            )
        data = checked.dataset(folder / "origin.nc", ["probability", "prior"], {"time": ("time",)})
        return Release(folder, names, data)
    if "forecast.nc" not in names:
        raise UserError(
            f"results {folder}: contain no forecast.nc; give a folder written by drift run, "
            "drift plan or drift origin"
        )
    path = folder / "forecast.nc"
    forecast = checked.dataset(path, LARGE, FORECAST)
    checked.reject_beyond_limits(
        path,
        forecast,
        {"mean_lat": 90, "datum_lat": 90, "mean_lon": 720, "datum_lon": 720, "share": 1},
    )
    return Finished(folder, names, forecast.isel(time=_chosen(forecast["time"].values, times)))


def _chosen(outputs: Any, times: Sequence[str]) -> list[int]:
    """Return the indices of the requested outputs, in ascending order of time."""
    order: list[int] = np.argsort(outputs, kind="stable").tolist()
    if not times:
        return order
    minutes, wanted = outputs.astype("datetime64[m]"), set[int]()
    for text in times:
        try:
            time = units.resolve(units.time(text), outputs[0].astype("datetime64[s]"))
        except ValueError as error:
            raise UserError(f"--time TIME: {error}") from None
        # a date-time group has no seconds
        found = np.flatnonzero(minutes == time.astype("datetime64[m]")).tolist()
        if not found:
            ends = f"{notation.format_dtg(outputs[0])} to {notation.format_dtg(outputs[-1])}"
            raise UserError(
                f'--time TIME: there is no output in the minute of "{text}"; outputs go from {ends}, '
                "see track.csv"
            )
        wanted.update(found)
    return [k for k in order if k in wanted]
