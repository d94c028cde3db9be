"""Tables of sensors in closed form, and the netCDF files in which they come.

It knows nothing of `drift.evidence.sensors`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from geo.array import Array

BEARING = np.arange(0.0, 360.0, 15.0)  # [deg]
RANGE = np.array([100.0, 500.0, 2000.0, 9000.0, 40_000.0, 41_000.0, 90_000.0])  # [m] uneven
# [deg] across the antimeridian
LON, LAT = np.array([-178.0, 179.0, 176.5, -179.5]), np.array([31.0, 36.0, 30.0, 33.0])
FACTORS = {"m": 1.0, "km": 1e-3, "nmi": 1 / 1852, "degree": 1.0, "rad": np.pi / 180}


def loss(bearing: Array, metres: Array, place: Array | None = None) -> Array:
    """Loss [dB] (p, b, r), in hundredths: different in every place, asymmetric in bearing."""
    where = np.zeros(1) if place is None else place
    turn = np.radians(bearing)[None, :, None]
    spread = 20 * np.log10(metres)[None, None, :] + 3.0 * where[:, None, None]
    return np.round(
        spread + 4 * np.cos(turn) + 2 * np.sin(2 * turn - 0.4) * (1 + where[:, None, None]), 2
    )


@dataclass(frozen=True)
class Table:
    """A file of losses as it is to be written; each field is one thing in which files differ."""

    bearing: Array | None = field(default_factory=lambda: BEARING)  # [deg]; None: no such dimension
    metres: Array = field(default_factory=lambda: RANGE)
    values: Array | None = None  # (p, b, r) instead of those of `loss`
    places: tuple[Array, Array] | None = None  # lon, lat [deg]
    dims: Sequence[str] = ("place", "bearing", "range")
    names: Mapping[str, str] = field(default_factory=dict)  # of dimensions, instead of these
    # instead of dB, degree, m; None: no attribute
    units: Mapping[str, str | None] = field(default_factory=dict)
    attributes: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # more of them
    further: Mapping[str, Array] = field(
        default_factory=dict
    )  # more dimensions; the table is 1 dB higher at each entry
    variable: str = "tl"
    dtype: str = "f8"  # "i2": packed in hundredths, with a fill value
    missing: float = np.nan  # stands where values are not finite
    rows: Sequence[Array] = ()  # order of the entries of place, bearing and range

    def write(self, path: Path) -> Path:
        """Write the file."""
        bearing = np.zeros(1) if self.bearing is None else self.bearing
        count = 1 if self.places is None else len(self.places[0])
        values = (
            loss(bearing, self.metres, np.arange(count) * 1.0)
            if self.values is None
            else self.values
        )
        lon, lat = self.places or (np.zeros(1), np.zeros(1))
        axes = {"place": (lon, lat), "bearing": (bearing,), "range": (self.metres,)}
        if self.rows:
            values = values[np.ix_(*self.rows)]
            axes = {
                key: tuple(v[rows] for v in along)
                for (key, along), rows in zip(axes.items(), self.rows, strict=True)
            }
        units = {"bearing": "degree", "range": "m", self.variable: "dB", **self.units}
        held = (
            ["place"] * (self.places is not None)
            + ["bearing"] * (self.bearing is not None)
            + ["range"]
        )
        squeezed = values.reshape(
            [values.shape[["place", "bearing", "range"].index(d)] for d in held]
        )
        named = [self.names.get(d, d) for d in held]
        data = xr.Dataset({self.variable: (named, squeezed)})
        for dim in held[-2:] if self.bearing is not None else ["range"]:
            unit = units[dim]
            data[self.names.get(dim, dim)] = (
                self.names.get(dim, dim),
                axes[dim][0] * FACTORS.get(unit or "", 1.0),
            )
        if self.places is not None:
            data["lon"] = (
                self.names.get("place", "place"),
                axes["place"][0],
                {"units": "degrees_east"},
            )
            data["lat"] = (
                self.names.get("place", "place"),
                axes["place"][1],
                {"units": "degrees_north"},
            )
        for dim, entries in self.further.items():
            data[self.variable] = data[self.variable].expand_dims({dim: entries}) + xr.DataArray(
                np.arange(len(entries)) * 1.0, dims=dim
            )
        order = [self.names.get(d, d) for d in self.dims if d in held or d in self.further]
        order = [d for d in self.further if d not in order] + order
        data[self.variable] = data[self.variable].transpose(*order)
        for key, unit in units.items():
            if unit is not None and self.names.get(key, key) in data:
                data[self.names.get(key, key)].attrs["units"] = unit
        for key, more in self.attributes.items():
            data[key].attrs.update(more)
        how: dict[str, Any] = {"dtype": self.dtype, "_FillValue": None}
        if self.dtype == "i2":
            how |= {"scale_factor": 0.01, "add_offset": 100.0, "_FillValue": -32768}
        if not np.isnan(self.missing):
            how |= {"_FillValue": self.missing}
        data.to_netcdf(path, encoding={self.variable: how})
        return path

    def but(self, **changes: Any) -> "Table":
        """Return the table with changes."""
        return replace(self, **changes)
