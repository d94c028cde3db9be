"""What a netCDF file says so that others find and read it: ACDD-1.3, read off its own coordinates,
and labels as CF has them.

What only a person can say (creator, institution, licence, project, naming authority) is left out.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from geo import notation, sphere

CONVENTIONS = "CF-1.11, ACDD-1.3"
KEYWORDS = "drift at sea, search and rescue, leeway, particle filter, probability"
VOCABULARY = "CF Standard Name Table v93"
EARTH = "crs"  # variable that says on which Earth positions lie
SPHERE = {
    "grid_mapping_name": "latitude_longitude",
    "long_name": "the sphere on which the run computes; longitudes and latitudes are those of charts, WGS 84",
    "earth_radius": sphere.RADIUS,  # [m]
    "longitude_of_prime_meridian": 0.0,
    "coverage_content_type": "auxiliaryInformation",
}
CLOCK = "leap_seconds: none"  # our seconds since 1970 count none (CF-1.11, section 4.4.1)


def described(data: xr.Dataset, stamped: Mapping[str, str], name: str) -> xr.Dataset:
    """Return a dataset as it is written: with a run's attributes, ACDD's, and labels that are no
    coordinate variables.

    name: of its file, without suffix. Where the dataset has an attribute itself, that one holds.
    """
    found = {
        **stamped,
        "Conventions": CONVENTIONS,
        "id": f"{stamped.get('run_id', '')}.{name}",
        "keywords": KEYWORDS,
        "standard_name_vocabulary": VOCABULARY,
        **_place(data),
        **_time(data),
    }
    whole = _labelled(data.assign_attrs({**found, **data.attrs}))
    for key, variable in whole.variables.items():
        if str(key).endswith("_bnds"):
            continue
        kind = "coordinate" if key in whole.coords else "modelResult"
        clock = (
            {"units_metadata": CLOCK}
            if variable.dtype.kind == "M" or "calendar" in variable.attrs
            else {}
        )
        variable.attrs = {"coverage_content_type": kind, **variable.attrs, **clock}
    return _on_the_sphere(whole)


def _on_the_sphere(data: xr.Dataset) -> xr.Dataset:
    """Return a dataset that says on which Earth its longitudes and latitudes lie (CF, 5.6), if it
    has any.

    Of variables those refer to it that lie along the axes of both.
    """
    along = [
        set(found[0].dims) for name in ("latitude", "longitude") if (found := _named(data, name))
    ]
    if not along:
        return data
    for name, variable in data.data_vars.items():
        if set().union(*along) <= set(variable.dims) and not str(name).endswith("_bnds"):
            variable.attrs["grid_mapping"] = EARTH
    return data.assign({EARTH: ((), np.int32(0), SPHERE)})


def _labelled(data: xr.Dataset) -> xr.Dataset:
    """Return a dataset in which words along a dimension are its labels: a coordinate variable is a
    number (CF, 1.3).

    Their dimension gets a name of its own; data.set_xindex("status") makes them an index again.
    """
    words = [name for name in data.dims if name in data.coords and data[name].dtype.kind in "OU"]
    return data.reset_index(words).rename_dims({name: f"{name}_index" for name in words})


def _place(data: xr.Dataset) -> dict[str, Any]:
    """Return where the values lie [deg], longitudes as they run in the file."""
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
    """Return from when to when the values are, UTC, and how far apart where that is always the
    same.
    """
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
    """Return what there is of a coordinate, by its standard name: of coordinates, else of other
    variables.
    """
    held = [np.ravel(variable.values) for variable in _named(data, standard_name)]
    every = np.concatenate(held) if held else np.array([])
    return every[~np.isnat(every)] if every.dtype.kind == "M" else every[np.isfinite(every)]


def _named(data: xr.Dataset, standard_name: str) -> list[xr.DataArray]:
    """Return the variables of a standard name: of coordinates, else others."""
    for variables in (data.coords, data.data_vars):
        if held := [v for v in variables.values() if v.attrs.get("standard_name") == standard_name]:
            return held
    return []


def _duration(length: np.timedelta64) -> str:
    """Return a length of time by ISO 8601."""
    return f"PT{int(length / np.timedelta64(1, 's'))}S"
