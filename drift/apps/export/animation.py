"""A finished run as an animation, forecast.gif, for those who have no program for maps."""

from collections.abc import Callable, Sequence

import numpy as np
import shapely
import xarray as xr

from drift.apps.export.finished import Finished
from drift.forecast.build import Contour, Forecast
from drift.products.maps.imprint import Imprint, Setting
from geo.array import Array
from geo.box import Box
from geo.coast import shore
from geo.errors import UserError
from geo.notation import NMI


def files(run: Finished) -> dict[str, bytes]:
    """Return forecast.gif: a frame for each output that is wanted, with the sorties flown by then."""
    # not for other formats: Matplotlib takes long to import
    from drift.forecast.products import animation

    polygons, note = _land(run)
    caution = str(run.forecast.attrs.get("caution", ""))
    # the caution has a banner of its own
    footer = note + run.words.removeprefix(f"{caution}. ")
    setting = Setting(Imprint(run.title, footer, caution=caution), polygons=polygons)
    forecast = Forecast(_as_in_a_run(run), _contours(run))
    return {"forecast.gif": animation.animate(forecast, setting, _legs(run))}


def _land(run: Finished) -> tuple[Callable[[Box], Array], str]:
    """Return what returns the land in a box, and a sentence if the shoreline file is not here."""
    told = str(run.forecast.attrs.get("coast", "none"))
    source = "gshhg" if told.startswith("GSHHG") else told
    try:
        shore.read_land(source, Box(0.0, 0.0, 0.1, 0.1))
    except UserError:
        return lambda box: np.empty(0, object), f"Land is not drawn: {told} is not here. "
    return lambda box: shore.read_land(source, box).polygons, ""


def _as_in_a_run(run: Finished) -> xr.Dataset:
    """Return forecast.nc with what is ashore, and with the names of scenarios and statuses as
    coordinates, as a run has them.
    """
    data = run.cells_with_ashore()
    names = {"status_index": "status", "scenario_index": "scenario"}
    return data.swap_dims({index: name for index, name in names.items() if index in data.dims})


def _contours(run: Finished) -> tuple[Contour, ...]:
    """Return the outlines of areas, without the cut at the antimeridian."""
    middle = float(run.forecast["lon"].mean())
    found = []
    for time, share, geometry, told in run.areas():
        parts = [
            shapely.Polygon(rings[0], rings[1:])
            for rings in (
                [[_turned(at, middle) for at in ring] for ring in polygon]
                for polygon in geometry["coordinates"]
            )
        ]
        whole = shapely.union_all(shapely.make_valid(parts))
        polygons = [part for part in shapely.get_parts(whole) if part.geom_type == "Polygon"]
        area = float(told["area_nmi2"]) * NMI**2
        found.append(Contour(time, share, area, shapely.MultiPolygon(polygons)))
    return tuple(found)


def _turned(at: Sequence[float], middle: float) -> tuple[float, float]:
    """Return a position with its longitude within half a turn of the middle [deg]."""
    return middle + (at[0] - middle + 180) % 360 - 180, at[1]


def _legs(run: Finished) -> list[tuple[np.datetime64, Array]]:
    """Return when each sortie began, and a line of its legs [deg], (n, 2)."""
    return [
        (np.datetime64(told["start"].removesuffix("Z"), "ns"), np.array(line)[:, :2])
        for feature in run.search()
        if (told := feature["properties"])["shape"] == "legs"
        for line in feature["geometry"]["coordinates"]
    ]
