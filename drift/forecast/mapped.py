"""The part of a forecast's grid that its maps show, and the output they open with."""

import numpy as np
import xarray as xr

from geo.box import Box

SHOWN = 0.995  # containment of the cells that are shaded
MORE = 0.15  # margin of the box, as a share of its side


def box(data: xr.Dataset) -> Box:
    """Return the box shown by the maps of any time, with a margin; the whole grid if there is no
    probability.
    """
    inside = np.any(data["containment"].values <= SHOWN, axis=0)
    rows, columns = inside.any(axis=1), inside.any(axis=0)
    lat, lon = (
        data[name].values[shown] if shown.any() else data[name].values
        for name, shown in (("lat", rows), ("lon", columns))
    )
    west, south, east, north = lon.min(), lat.min(), lon.max(), lat.max()
    wide, high = MORE * (east - west), MORE * (north - south)
    return Box(
        float(west - wide),
        max(float(south - high), -90.0),
        float(east + wide),
        min(float(north + high), 90.0),
    )


def opening_output(data: xr.Dataset, opens: np.datetime64 | None) -> int:
    """Return the index of the output nearest to a time, which is shown first; None: the last
    output.
    """
    times = data["time"].values
    return len(times) - 1 if opens is None else int(np.argmin(np.abs(times - opens)))
