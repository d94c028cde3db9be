"""The contents of compare.nc: CF-1.11 maps of both cases and their difference, and all figures."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from drift.assess.compare.maps import Maps
from drift.assess.compare.units import GROUPS, Difference
from geo.cells import Cells

MAP = ("time", "lat", "lon")
SMOOTHING = (
    "both cases are smoothed with the same kernels, so that a difference comes from the particles: "
    "these maps differ a little from those of drift run"
)
GROUPED = f"estimated from {GROUPS} groups of particles; its own error is about 13 %"
# Long name and comment of each map, in the order of drift.assess.compare.maps.Maps.
MAPS: dict[str, tuple[str, str]] = {
    "probability_a": (
        "probability that the object is in the cell, adrift or ashore, in case A",
        SMOOTHING,
    ),
    "probability_b": (
        "probability that the object is in the cell, adrift or ashore, in case B",
        SMOOTHING,
    ),
    "difference": ("probability in case B minus that in case A", SMOOTHING),
    "difference_error": ("standard error of the difference (sampling only)", GROUPED),
}
TEXTS = {
    "quantity": "quantity of the figure",
    "name": "scenario, status, area, sortie or stretch of the figure",
    "unit": "unit of the figure",
}
NUMBERS = {
    "a": "the figure in case A; NaN where only the difference is meaningful",
    "b": "the figure in case B; NaN where only the difference is meaningful",
    "difference": "the figure of B minus that of A",
    "error": "standard error of the difference (sampling only)",
}


def build_comparison(
    times: Sequence[np.datetime64], grid: Cells, maps: Sequence[Maps], rows: Sequence[Difference]
) -> xr.Dataset:
    """Return the maps at each common output time, and the figures along the dimension `figure`."""
    values = [
        np.stack([getattr(maps_at_time, name) for maps_at_time in maps])
        for name in ("a", "b", "difference", "error")
    ]
    data: dict[str, tuple[Sequence[str], object, dict[str, str]]] = {
        name: (
            MAP,
            stack.astype(np.float32),
            {"units": "1", "long_name": words, "comment": comment},
        )
        for (name, (words, comment)), stack in zip(MAPS.items(), values, strict=True)
    }
    data["cell_area"] = (
        MAP[1:],
        np.repeat(grid.area()[:, None], grid.nlon, axis=1),
        {"units": "m2", "standard_name": "cell_area", "long_name": "area of the cell"},
    )
    for field, words in TEXTS.items():
        texts = np.array([getattr(row, field) for row in rows], object)
        data[f"figure_{field}"] = (("figure",), texts, {"long_name": words})
    for field, words in NUMBERS.items():
        numbers = np.array([getattr(row, field) for row in rows], float)
        data[f"figure_{field}"] = (
            ("figure",),
            numbers,
            {"long_name": words, "comment": "in the unit of figure_unit"},
        )
    when = np.array([row.time for row in rows], "datetime64[ns]")
    data["figure_time"] = (("figure",), when, {"long_name": "time of the figure, UTC"})
    axes = (("lat", "latitude", "Y", "degrees_north"), ("lon", "longitude", "X", "degrees_east"))
    coordinates: dict[str, tuple[str, object, dict[str, str]]] = {
        "time": (
            "time",
            np.array(times, "datetime64[ns]"),
            {
                "standard_name": "time",
                "long_name": "time, UTC",
                "axis": "T",
            },
        )
    }
    for name, long, axis, unit in axes:
        centres = grid.lat() if name == "lat" else grid.lon()
        about = {
            "standard_name": long,
            "long_name": f"{long} of the cell's centre",
            "axis": axis,
            "units": unit,
        }
        coordinates[name] = (name, centres, about)
    return xr.Dataset(data, coordinates)
