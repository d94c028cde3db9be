"""What of a forecast its maps show: which part of its grid, and which output first."""

import numpy as np
import xarray as xr

from geo.box import Box

SHOWN = 0.995  # containment of the cells that are shaded
MORE = 0.15  # of a side: how far a box reaches beyond them


def box(data: xr.Dataset) -> Box:
    """Return the box of all that the map of any time shows, and somewhat more; that of the grid
    where there is none.
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


def opening(data: xr.Dataset, opens: np.datetime64 | None) -> int:
    """Return the number of the output that is shown first: the one nearest to a time;

    None: the last.
    """
    times = data["time"].values
    return len(times) - 1 if opens is None else int(np.argmin(np.abs(times - opens)))
