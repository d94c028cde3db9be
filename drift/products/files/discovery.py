"""Metadata of netCDF files: ACDD-1.3 attributes derived from the coordinates, and CF labels.

Attributes that only a person can give (creator, institution, licence, project, naming authority)
are left out.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from geo import notation, sphere

CONVENTIONS = "CF-1.11, ACDD-1.3"
KEYWORDS = "drift at sea, search and rescue, leeway, particle filter, probability"
VOCABULARY = "CF Standard Name Table v93"
EARTH = "crs"  # grid mapping variable: the Earth that positions refer to
SPHERE = {
    "grid_mapping_name": "latitude_longitude",
    "long_name": "the sphere on which the run computes; longitudes and latitudes are those of charts, WGS 84",
    "earth_radius": sphere.RADIUS,  # [m]
    "longitude_of_prime_meridian": 0.0,
    "coverage_content_type": "auxiliaryInformation",
}
CLOCK = "leap_seconds: none"  # seconds since 1970 count no leap seconds (CF-1.11, section 4.4.1)


def with_metadata(data: xr.Dataset, stamped: Mapping[str, str], name: str) -> xr.Dataset:
    """Return a dataset with all its metadata, as it is written.

    Args:
        data: the dataset; its own attributes take precedence.
        stamped: attributes of every file of the run.
        name: name of the file, without suffix.

    Returns:
        The dataset with ACDD attributes, CF labels and a grid mapping.
    """
    attributes = {
        **stamped,
        "Conventions": CONVENTIONS,
        "id": f"{stamped.get('run_id', '')}.{name}",
        "keywords": KEYWORDS,
        "standard_name_vocabulary": VOCABULARY,
        **_place(data),
        **_time(data),
    }
    labelled = _with_labels(data.assign_attrs({**attributes, **data.attrs}))
    for key, variable in labelled.variables.items():
        if str(key).endswith("_bnds"):
            continue
        kind = "coordinate" if key in labelled.coords else "modelResult"
        clock = (
            {"units_metadata": CLOCK}
            if variable.dtype.kind == "M" or "calendar" in variable.attrs
            else {}
        )
        variable.attrs = {"coverage_content_type": kind, **variable.attrs, **clock}
    return _add_grid_mapping(labelled)


def _add_grid_mapping(data: xr.Dataset) -> xr.Dataset:
    """Add a grid mapping (CF, 5.6) to a dataset with longitudes and latitudes.

    Variables with the dimensions of both refer to it.
    """
    axes = [
        set(found[0].dims)
        for name in ("latitude", "longitude")
        if (found := _variables_of(data, name))
    ]
    if not axes:
        return data
    for name, variable in data.data_vars.items():
        if set().union(*axes) <= set(variable.dims) and not str(name).endswith("_bnds"):
            variable.attrs["grid_mapping"] = EARTH
    return data.assign({EARTH: ((), np.int32(0), SPHERE)})


def _with_labels(data: xr.Dataset) -> xr.Dataset:
    """Return a dataset in which text along a dimension is a label, as CF coordinates are numbers.

    The dimension gets a new name; data.set_xindex("status") makes the labels an index again.
    """
    text_dims = [
        name for name in data.dims if name in data.coords and data[name].dtype.kind in "OU"
    ]
    return data.reset_index(text_dims).rename_dims({name: f"{name}_index" for name in text_dims})


def _place(data: xr.Dataset) -> dict[str, Any]:
    """Return the extent of the values [deg]; longitudes as in the file."""
    lat, lon = (_values(data, name) for name in ("latitude", "longitude"))
    if not (lat.size and lon.size):
        return {}
    south, north, west, east = (float(f(axis)) for axis in (lat, lon) for f in (np.min, np.max))
    corners = ((south, west), (north, west), (north, east), (south, east), (south, west))
    return {
        "geospatial_lat_min": south,
        "geospatial_lat_max": north,
        "geospatial_lat_units": "degrees_north",
        "geospatial_lon_min": west,
        "geospatial_lon_max": east,
        "geospatial_lon_units": "degrees_east",
        "geospatial_bounds": f"POLYGON (({', '.join(f'{y:.7g} {x:.7g}' for y, x in corners)}))",
        "geospatial_bounds_crs": "EPSG:4326",  # latitude first
    }


def _time(data: xr.Dataset) -> dict[str, str]:
    """Return first and last time of the values, UTC, and their interval if it is constant."""
    times = _values(data, "time")
    if not times.size:
        return {}
    first, last = times.min(), times.max()
    found = {
        "time_coverage_start": notation.iso(first),
        "time_coverage_end": notation.iso(last),
        "time_coverage_duration": _duration(last - first),
    }
    apart = np.unique(np.diff(np.unique(times)))
    return {**found, "time_coverage_resolution": _duration(apart[0])} if apart.size == 1 else found


def _values(data: xr.Dataset, standard_name: str) -> Any:
    """Return the finite values of a coordinate, by its standard name."""
    parts = [np.ravel(variable.values) for variable in _variables_of(data, standard_name)]
    values = np.concatenate(parts) if parts else np.array([])
    return values[~np.isnat(values)] if values.dtype.kind == "M" else values[np.isfinite(values)]


def _variables_of(data: xr.Dataset, standard_name: str) -> list[xr.DataArray]:
    """Return the variables of a standard name: coordinates, else data variables."""
    for variables in (data.coords, data.data_vars):
        if found := [
            v for v in variables.values() if v.attrs.get("standard_name") == standard_name
        ]:
            return found
    return []


def _duration(length: np.timedelta64) -> str:
    """Return a duration in ISO 8601."""
    return f"PT{int(length / np.timedelta64(1, 's'))}S"
